//! The client side: asks a run by its private socket, or a service by its API.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use axum::body::{Body, to_bytes};
use axum::http::header::{CONNECTION, HOST};
use axum::http::{HeaderValue, StatusCode};
use hyper::client::conn::http1::handshake;
use hyper_util::rt::TokioIo;
use serde_json::Value;
use tokio::net::UnixStream;
use tokio::time::timeout;
use tokio_util::task::AbortOnDropHandle;

use super::folder::{Folder, guardian_socket};
use super::request::RunRequest;
use super::response::RunResponse;
use super::run_status::RunStatus;
use crate::config::ServiceUrl;
use crate::robot::StopOutcome;
use crate::{guardian, http, sanitize};

/// Maximum length of an answer, in bytes: that of a picture.
pub(super) const MAX_ANSWER: usize = 4 << 20;
/// Maximum length of a refusal that is shown, in characters.
const SHOWN: usize = 300;
const JPEG: &[u8] = &[0xff, 0xd8];
/// Timeout for a run's reply to [`RunRequest::Status`].
const STATUS_TIMEOUT: Duration = Duration::from_secs(3);
/// How long a run may take to show that it does not hang.
const ALIVE_TIMEOUT: Duration = Duration::from_secs(1);
const GUARDIAN_TIMEOUT: Duration = Duration::from_secs(1);
/// Timeout for a run's reply to [`RunRequest::Stop`], which waits for the robot.
const STOP_TIMEOUT: Duration = Duration::from_secs(4);
/// The same for a run on another computer, including name resolution and login.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(8);

#[derive(Debug, Clone)]
pub struct Client {
    transport: Transport,
    /// The run's state when it was found.
    pub status: RunStatus,
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
        match ask(stream, &RunRequest::Status, STATUS_TIMEOUT).await {
            Ok(RunResponse::Status(status)) => clients.push(Client {
                transport: Transport::Socket(data.to_owned()),
                status: *status,
            }),
            // The run is about to end.
            Ok(_) | Err(AskError::Ended) => {}
            Err(_) => silent += 1,
        }
    }
    (clients, silent)
}

#[derive(Debug)]
pub struct StoppedRun {
    pub pid: u32,
    /// Its state just before; `None` if it hangs.
    pub status: Option<RunStatus>,
    pub answer: StopAnswer,
}

#[derive(Debug)]
pub enum StopAnswer {
    Run {
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
pub async fn stop_runs(data: &Path, chosen: impl Fn(&RunStatus) -> bool) -> Vec<StoppedRun> {
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
    chosen: &impl Fn(&RunStatus) -> bool,
) -> Option<StoppedRun> {
    let stop = async |limit| ask(folder.connect_to(pid)?, &RunRequest::Stop, limit).await;
    let status = match ask(stream, &RunRequest::Status, ALIVE_TIMEOUT).await {
        Ok(RunResponse::Status(status)) if !chosen(&status) => return None,
        Ok(RunResponse::Status(status)) => Some(*status),
        Ok(_) | Err(AskError::Ended) => return None,
        Err(_) => None,
    };
    let (asked, guardian) = if status.is_some() {
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
        status,
        answer,
    })
}

impl Client {
    pub async fn of_service(remote: Remote) -> Result<Client, AskError> {
        match ask_web(remote.clone(), &RunRequest::Status, CONNECT_TIMEOUT).await? {
            RunResponse::Status(status) => Ok(Client {
                transport: Transport::Web(remote),
                status: *status,
            }),
            RunResponse::Refused { error } => Err(AskError::Denied(error)),
            _ => Err(AskError::Ended),
        }
    }

    /// The name shown to people: the process on this computer, the address of a remote run.
    pub fn name(&self) -> String {
        match &self.transport {
            Transport::Socket(_) => format!("process {}", self.status.process),
            Transport::Web(remote) => remote.url.to_string(),
        }
    }

    /// Sends one request and waits for the answer at most this long. Dropping the future cancels a
    /// request on this computer; a remote one is cancelled only when this process ends.
    pub async fn ask(
        &self,
        request: &RunRequest,
        limit: Duration,
    ) -> Result<RunResponse, AskError> {
        match &self.transport {
            Transport::Socket(data) => {
                let stream = Folder::open(data)?.connect_to(self.status.process)?;
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

/// Sends one request over this connection to a run's private socket. Dropping the future cancels it.
pub async fn ask(
    stream: std::os::unix::net::UnixStream,
    request: &RunRequest,
    limit: Duration,
) -> Result<RunResponse, AskError> {
    let stream = UnixStream::from_std(stream)?;
    let asked = timeout(limit, ask_socket(stream, request));
    asked.await.unwrap_or(Err(AskError::TimedOut(limit)))
}

async fn ask_socket(stream: UnixStream, request: &RunRequest) -> Result<RunResponse, AskError> {
    let mut request = request.to_http("").map_err(io::Error::other)?;
    let headers = request.headers_mut();
    headers.insert(HOST, HeaderValue::from_static("localhost"));
    headers.insert(CONNECTION, HeaderValue::from_static("close"));
    let (mut sender, connection) = handshake(TokioIo::new(stream)).await?;
    let _connection = AbortOnDropHandle::new(tokio::spawn(connection));
    let answer = sender.send_request(request.map(Body::from)).await?;
    let status = answer.status();
    let body = to_bytes(Body::new(answer.into_body()), MAX_ANSWER)
        .await
        .map_err(io::Error::other)?;
    parse_answer(status, body.into())
}

pub(super) fn parse_answer(status: StatusCode, body: Vec<u8>) -> Result<RunResponse, AskError> {
    if status == StatusCode::OK && body.starts_with(JPEG) {
        return Ok(RunResponse::Picture { jpeg: body });
    }
    let fields: Value = serde_json::from_slice(&body).unwrap_or_default();
    // Without what a terminal would obey.
    let fields = sanitize::with_texts(fields, &sanitize::line);
    if fields.get("answer").is_some() {
        let strange = |error| io::Error::other(format!("invalid reply: {error}"));
        return Ok(serde_json::from_value(fields).map_err(strange)?);
    }
    match status {
        StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN | StatusCode::MISDIRECTED_REQUEST => {
            let why = fields["error"].as_str().unwrap_or("no reason given");
            Err(AskError::Denied(why.chars().take(SHOWN).collect()))
        }
        _ => Err(AskError::UnexpectedStatus(status.as_u16())),
    }
}

/// Why a run did not answer.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    #[error("the run does not answer within {:.0} s", .0.as_secs_f64())]
    TimedOut(Duration),
    #[error("the run has ended")]
    Ended,
    /// An error of the system, or a reply that is not HTTP.
    #[error("the request to the run failed: {0}")]
    Io(#[from] io::Error),
    #[error("the token contains characters that are not allowed in a token")]
    Token,
    #[error("the service denies access: {0}")]
    Denied(String),
    #[error("the service replies with the HTTP status {0}: is it a different version?")]
    UnexpectedStatus(u16),
}

/// A run that ends closes its connections.
impl From<hyper::Error> for AskError {
    fn from(error: hyper::Error) -> AskError {
        if error.is_parse() {
            AskError::Io(io::Error::other(error))
        } else {
            AskError::Ended
        }
    }
}

/// The address of a service, and the token for access to it.
#[derive(Debug, Clone)]
pub struct Remote {
    pub url: ServiceUrl,
    token: Option<HeaderValue>,
}

impl Remote {
    pub fn new(url: ServiceUrl, token: Option<&str>) -> Result<Remote, AskError> {
        let token = token.map(|token| {
            let field = HeaderValue::from_str(&format!("Bearer {token}"));
            field.map(|mut field| {
                field.set_sensitive(true);
                field
            })
        });
        let token = token.transpose().map_err(|_| AskError::Token)?;
        Ok(Remote { url, token })
    }

    /// Sends one request and waits for the answer at most this long. Blocks the calling thread.
    pub fn ask(&self, request: &RunRequest, limit: Duration) -> Result<RunResponse, AskError> {
        let http_request = request.to_http(&self.url.to_string());
        let mut http_request = http_request.map_err(io::Error::other)?;
        if let Some(token) = &self.token {
            http_request
                .headers_mut()
                .insert("authorization", token.clone());
        }
        let failed = |error: ureq::Error| match error {
            ureq::Error::Timeout(_) => AskError::TimedOut(limit),
            ureq::Error::Io(error) => AskError::Io(error),
            other => AskError::Io(io::Error::other(other)),
        };
        let mut answer = http::agent(limit).run(http_request).map_err(failed)?;
        let status = answer.status();
        let body = answer.body_mut().with_config().limit(MAX_ANSWER as u64);
        let body = body.read_to_vec().map_err(failed)?;
        parse_answer(status, body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::DockEnd;

    fn parse(status: u16, body: &str) -> Result<RunResponse, AskError> {
        parse_answer(
            StatusCode::from_u16(status).unwrap(),
            body.as_bytes().to_vec(),
        )
    }

    #[test]
    fn an_answer_is_read_whatever_its_status_and_shown_without_control_characters() {
        assert_eq!(
            parse(200, r#"{"answer":"done"}"#).unwrap(),
            RunResponse::Done
        );
        let offline = r#"{"answer":"offline","error":"the robot is out of reach"}"#;
        assert_eq!(parse(503, offline).unwrap(), RunResponse::Offline);
        let refused = parse(409, r#"{"answer":"refused","error":"no\u001b[2J"}"#).unwrap();
        assert!(matches!(refused, RunResponse::Refused { error } if !error.contains('\u{1b}')));
        let docked =
            r#"{"answer":"docked","end":"timeout","attempts":3,"seconds":1.5,"error":"timeout"}"#;
        let end = DockEnd::Timeout;
        assert_eq!(parse(409, docked).unwrap().dock_end(), Some(end));
        assert!(
            matches!(parse(401, r#"{"error":"wrong token"}"#), Err(AskError::Denied(why)) if why == "wrong token")
        );
        assert!(matches!(
            parse(404, ""),
            Err(AskError::UnexpectedStatus(404))
        ));
        assert!(matches!(
            parse(200, r#"{"answer":"dance"}"#),
            Err(AskError::Io(_))
        ));
    }

    #[test]
    fn the_token_is_checked_and_never_shown() {
        let url: ServiceUrl = "http://10.0.0.7:7788".parse().unwrap();
        let remote = Remote::new(url.clone(), Some("s3cr3t")).unwrap();
        assert!(!format!("{remote:?}").contains("s3cr3t"));
        assert!(matches!(
            Remote::new(url, Some("a\nb")),
            Err(AskError::Token)
        ));
    }
}
