//! The asking side.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::UnixStream;
use tokio::time::timeout;

use super::errand::{Answer, Errand, Overview};
use super::folder::Folder;
use super::pipe::Pipe;

/// How long a run may take to say how things stand.
const OVERVIEW: Duration = Duration::from_secs(3);

/// Why a run did not answer.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// Not in time.
    #[error("the run does not answer within {:.0} s", .0.as_secs_f64())]
    Silent(Duration),
    /// It ended before it had answered.
    #[error("the run has ended")]
    Ended,
    /// What the system says.
    #[error("the run cannot be asked: {0}")]
    Io(#[from] io::Error),
}

/// A run that is on.
#[derive(Debug, Clone)]
pub struct Client {
    data: PathBuf,
    /// How things stood when it was found.
    pub overview: Overview,
}

/// The runs of this data folder that are on, and how many more there are that do not answer.
pub async fn runs(data: &Path) -> (Vec<Client>, usize) {
    let Ok(folder) = Folder::open(data) else {
        return (vec![], 0);
    };
    let (mut clients, mut silent) = (Vec::new(), 0);
    for stream in folder.connect_all() {
        match ask(stream, &Errand::Overview, OVERVIEW).await {
            Ok(Answer::Overview(overview)) => clients.push(Client {
                data: data.to_owned(),
                overview: *overview,
            }),
            // One that is just ending.
            Ok(_) | Err(AskError::Ended) => {}
            Err(_) => silent += 1,
        }
    }
    (clients, silent)
}

impl Client {
    /// Asks for one thing, and waits so long for the answer. Dropping the wait gives the errand up.
    ///
    /// # Errors
    /// See [`AskError`].
    pub async fn ask(&self, errand: &Errand, limit: Duration) -> Result<Answer, AskError> {
        let stream = Folder::open(&self.data)?.connect_to(self.overview.pid)?;
        ask(stream, errand, limit).await
    }
}

async fn ask(
    stream: std::os::unix::net::UnixStream,
    errand: &Errand,
    limit: Duration,
) -> Result<Answer, AskError> {
    let mut pipe = Pipe::new(UnixStream::from_std(stream)?);
    let answered = timeout(limit, async {
        pipe.send(errand).await?;
        pipe.receive().await
    });
    match answered.await {
        Ok(Ok(Some(answer))) => Ok(answer),
        Ok(Ok(None)) => Err(AskError::Ended),
        Ok(Err(error)) => Err(error.into()),
        Err(_) => Err(AskError::Silent(limit)),
    }
}
