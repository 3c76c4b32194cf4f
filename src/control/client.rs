//! The asking side.

use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::UnixStream;
use tokio::time::timeout;

use super::errand::{Answer, Errand, Overview};
use super::error::AskError;
use super::folder::Folder;
use super::pipe::Pipe;
use super::web::Remote;

/// How long a run may take to say how things stand.
const OVERVIEW: Duration = Duration::from_secs(3);
/// And one on another computer, its name and its secrets included.
const CONNECTING: Duration = Duration::from_secs(8);

/// A run that is on.
#[derive(Debug, Clone)]
pub struct Client {
    way: Way,
    /// How things stood when it was found.
    pub overview: Overview,
}

/// How it is asked.
#[derive(Debug, Clone)]
enum Way {
    /// By its private socket in this data folder.
    Socket(PathBuf),
    /// By its JSON API.
    Web(Remote),
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
                way: Way::Socket(data.to_owned()),
                overview: *overview,
            }),
            // The run is just ending.
            Ok(_) | Err(AskError::Ended) => {}
            Err(_) => silent += 1,
        }
    }
    (clients, silent)
}

impl Client {
    /// The run that is served there.
    ///
    /// # Errors
    /// See [`AskError`].
    pub async fn of_service(remote: Remote) -> Result<Client, AskError> {
        match ask_web(remote.clone(), &Errand::Overview, CONNECTING).await? {
            Answer::Overview(overview) => Ok(Client {
                way: Way::Web(remote),
                overview: *overview,
            }),
            Answer::Refused(why) => Err(AskError::Denied(why)),
            _ => Err(AskError::Ended),
        }
    }

    /// As people call it: by its process here, by its address elsewhere.
    pub fn name(&self) -> String {
        match &self.way {
            Way::Socket(_) => format!("process {}", self.overview.pid),
            Way::Web(remote) => remote.url().to_owned(),
        }
    }

    /// It is asked by its API: what goes beyond that is not to be had.
    pub fn is_remote(&self) -> bool {
        matches!(self.way, Way::Web(_))
    }

    /// Asks for one thing, and waits so long for the answer. Dropping the wait gives the errand up.
    ///
    /// # Errors
    /// See [`AskError`].
    pub async fn ask(&self, errand: &Errand, limit: Duration) -> Result<Answer, AskError> {
        match &self.way {
            Way::Socket(data) => {
                let stream = Folder::open(data)?.connect_to(self.overview.pid)?;
                ask(stream, errand, limit).await
            }
            Way::Web(remote) => ask_web(remote.clone(), errand, limit).await,
        }
    }
}

/// On a thread of its own; the service gives up an errand when the process that asked ends.
async fn ask_web(remote: Remote, errand: &Errand, limit: Duration) -> Result<Answer, AskError> {
    let errand = errand.clone();
    let asked = tokio::task::spawn_blocking(move || remote.ask(&errand, limit));
    asked.await.unwrap_or(Err(AskError::Ended))
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
