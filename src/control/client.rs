//! The client side.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::net::UnixStream;
use tokio::time::timeout;

use super::folder::{Folder, guardian_socket};
use super::pipe::Pipe;
use super::request::{Overview, RunRequest, RunResponse};
use super::web::Remote;
use crate::guardian;
use crate::robot::StopOutcome;

/// Timeout for a run's reply to [`RunRequest::Overview`].
const OVERVIEW_TIMEOUT: Duration = Duration::from_secs(3);
/// How long a run may take to show that it does not hang.
const ALIVE_TIMEOUT: Duration = Duration::from_secs(1);
/// Timeout for a guardian's answer.
const GUARDIAN_TIMEOUT: Duration = Duration::from_secs(1);
/// Timeout for a run's reply to [`RunRequest::Stop`], which waits for the robot.
const STOP_TIMEOUT: Duration = Duration::from_secs(4);
/// The same for a run on another computer, including name resolution and login.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(8);

/// An active run.
#[derive(Debug, Clone)]
pub struct Client {
    transport: Transport,
    /// The run's state when it was found.
    pub overview: Overview,
}

#[derive(Debug, Clone)]
enum Transport {
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
    let mut clients = Vec::new();
    let mut silent = 0;
    for (_, stream) in folder.connect_all() {
        match ask(stream, &RunRequest::Overview, OVERVIEW_TIMEOUT).await {
            Ok(RunResponse::Overview(overview)) => clients.push(Client {
                transport: Transport::Socket(data.to_owned()),
                overview: *overview,
            }),
            // The run is about to end.
            Ok(_) | Err(AskError::Ended) => {}
            Err(_) => silent += 1,
        }
    }
    (clients, silent)
}

/// How a run answered a STOP.
#[derive(Debug)]
pub struct StoppedRun {
    /// Its process ID.
    pub pid: u32,
    /// Its state just before; `None` if it hangs.
    pub overview: Option<Overview>,
    /// Its answer, or that of its guardian.
    pub answer: StopAnswer,
}

/// Who answered a STOP for a run.
#[derive(Debug)]
pub enum StopAnswer {
    /// The run.
    Run {
        /// What is known of it.
        outcome: StopOutcome,
        /// Whether the run ends now; a service goes on.
        ends: bool,
    },
    /// The run hangs; its guardian stops the robot.
    Guardian(guardian::StopAnswer),
    /// Neither the run, for this reason, nor its guardian.
    Nobody(AskError),
}

/// Presses STOP at all runs of this data folder whose state passes `chosen`, at the same time. One
/// that hangs delays no other one, and takes two seconds at most. It is stopped in any case: nobody
/// knows which robot it uses.
pub async fn stop_runs(data: &Path, chosen: impl Fn(&Overview) -> bool) -> Vec<StoppedRun> {
    let Ok(folder) = Folder::open(data) else {
        return vec![];
    };
    let runs = folder.connect_all().into_iter();
    let runs = runs.map(|(pid, stream)| stop_run(data, &folder, pid, stream, &chosen));
    let stopped = futures_util::future::join_all(runs).await;
    stopped.into_iter().flatten().collect()
}

/// `None` if it is not chosen, or has ended.
async fn stop_run(
    data: &Path,
    folder: &Folder,
    pid: u32,
    stream: std::os::unix::net::UnixStream,
    chosen: &impl Fn(&Overview) -> bool,
) -> Option<StoppedRun> {
    let stop = async |limit| ask(folder.connect_to(pid)?, &RunRequest::Stop, limit).await;
    let overview = match ask(stream, &RunRequest::Overview, ALIVE_TIMEOUT).await {
        Ok(RunResponse::Overview(overview)) if !chosen(&overview) => return None,
        Ok(RunResponse::Overview(overview)) => Some(*overview),
        Ok(_) | Err(AskError::Ended) => return None,
        Err(_) => None,
    };
    let (asked, guardian) = if overview.is_some() {
        (stop(STOP_TIMEOUT).await, None)
    } else {
        // The run finds this request, and holds the robot, when it continues.
        let socket = guardian_socket(data, pid);
        let guardian = tokio::task::spawn_blocking(move || guardian::request_stop(&socket));
        tokio::join!(stop(GUARDIAN_TIMEOUT), async {
            let answer = timeout(GUARDIAN_TIMEOUT, guardian).await;
            answer.ok()?.ok()?.ok()
        })
    };
    let answer = match (asked, guardian) {
        (Ok(RunResponse::Stopped { outcome, ends }), _) => StopAnswer::Run { outcome, ends },
        (_, Some(answer)) if answer != guardian::StopAnswer::Alive => StopAnswer::Guardian(answer),
        (Err(AskError::Ended) | Ok(_), _) => return None,
        (Err(why), _) => StopAnswer::Nobody(why),
    };
    Some(StoppedRun {
        pid,
        overview,
        answer,
    })
}

impl Client {
    /// Connects to the run that this service hosts.
    ///
    /// # Errors
    /// See [`AskError`].
    pub async fn of_service(remote: Remote) -> Result<Client, AskError> {
        match ask_web(remote.clone(), &RunRequest::Overview, CONNECT_TIMEOUT).await? {
            RunResponse::Overview(overview) => Ok(Client {
                transport: Transport::Web(remote),
                overview: *overview,
            }),
            RunResponse::Refused(why) => Err(AskError::Denied(why)),
            _ => Err(AskError::Ended),
        }
    }

    /// The name shown to people: the process on this computer, the address of a remote run.
    pub fn name(&self) -> String {
        match &self.transport {
            Transport::Socket(_) => format!("process {}", self.overview.pid),
            Transport::Web(remote) => remote.url().to_string(),
        }
    }

    /// Whether the run is reached through its API, which offers nothing beyond these requests.
    pub fn is_remote(&self) -> bool {
        matches!(self.transport, Transport::Web(_))
    }

    /// Sends one request and waits for the answer at most this long. Dropping the future cancels a
    /// request on this computer; a remote one is cancelled only when this process ends.
    ///
    /// # Errors
    /// See [`AskError`].
    pub async fn ask(
        &self,
        request: &RunRequest,
        limit: Duration,
    ) -> Result<RunResponse, AskError> {
        match &self.transport {
            Transport::Socket(data) => {
                let stream = Folder::open(data)?.connect_to(self.overview.pid)?;
                ask(stream, request, limit).await
            }
            Transport::Web(remote) => ask_web(remote.clone(), request, limit).await,
        }
    }
}

/// Sends the request from a separate thread; the service cancels it when the calling process ends.
async fn ask_web(
    remote: Remote,
    request: &RunRequest,
    limit: Duration,
) -> Result<RunResponse, AskError> {
    let request = request.clone();
    let asked = tokio::task::spawn_blocking(move || remote.ask(&request, limit));
    asked.await.unwrap_or(Err(AskError::Ended))
}

async fn ask(
    stream: std::os::unix::net::UnixStream,
    request: &RunRequest,
    limit: Duration,
) -> Result<RunResponse, AskError> {
    let mut pipe = Pipe::new(UnixStream::from_std(stream)?);
    let answered = timeout(limit, async {
        pipe.send(request).await?;
        pipe.receive().await
    });
    match answered.await {
        Ok(Ok(Some(answer))) => Ok(answer),
        Ok(Ok(None)) => Err(AskError::Ended),
        Ok(Err(error)) => Err(error.into()),
        Err(_) => Err(AskError::TimedOut(limit)),
    }
}

/// Why a run did not answer.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// No answer in time.
    #[error("the run does not answer within {:.0} s", .0.as_secs_f64())]
    TimedOut(Duration),
    /// The run ended before it answered.
    #[error("the run has ended")]
    Ended,
    /// An error of the system.
    #[error("the request to the run failed: {0}")]
    Io(#[from] io::Error),
    /// A service on another computer denies access.
    #[error("the service denies access: {0}")]
    Denied(String),
    /// A service on another computer replies with an unexpected HTTP status.
    #[error("the service replies with the HTTP status {0}: is it a different version?")]
    UnexpectedStatus(u16),
}
