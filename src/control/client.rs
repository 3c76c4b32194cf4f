//! The client side.

use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::UnixStream;
use tokio::time::timeout;

use super::errand::{Answer, Errand, Overview};
use super::error::AskError;
use super::folder::Folder;
use super::pipe::Pipe;
use super::web::Remote;

/// Timeout for a run's reply to [`Errand::Overview`].
const OVERVIEW: Duration = Duration::from_secs(3);
/// The same for a run on another computer, including name resolution and login.
const CONNECTING: Duration = Duration::from_secs(8);

/// An active run.
#[derive(Debug, Clone)]
pub struct Client {
    way: Way,
    /// The run's state when it was found.
    pub overview: Overview,
}

/// How the run is reached.
#[derive(Debug, Clone)]
enum Way {
    /// Through its private socket in this data folder.
    Socket(PathBuf),
    /// Through its JSON API.
    Web(Remote),
}

/// Returns the active runs of this data folder, and the number of further runs that do not answer.
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
            // The run is about to end.
            Ok(_) | Err(AskError::Ended) => {}
            Err(_) => silent += 1,
        }
    }
    (clients, silent)
}

impl Client {
    /// Connects to the run that this service hosts.
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

    /// The name shown to people: the process on this computer, the address of a remote run.
    pub fn name(&self) -> String {
        match &self.way {
            Way::Socket(_) => format!("process {}", self.overview.pid),
            Way::Web(remote) => remote.url().to_owned(),
        }
    }

    /// Whether the run is reached through its API, which offers nothing beyond the errands.
    pub fn is_remote(&self) -> bool {
        matches!(self.way, Way::Web(_))
    }

    /// Sends one errand and waits for the answer at most this long. Dropping the future cancels an
    /// errand on this computer; a remote one is cancelled only when this process ends.
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

/// Sends the errand from a separate thread; the service cancels it when the calling process ends.
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
