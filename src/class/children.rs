//! The runs of the learners and the agents of the real robots: starts and ends their processes, tells
//! them what to do, and connects their viewers with them. They end with their server: with the
//! connection to it, and the process of a run with this thread, too.

use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::{UnixListener, UnixStream as StdUnixStream};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use axum::body::Body;
use axum::extract::Request;
use axum::http::header::{
    CONNECTION, HOST, HeaderName, SEC_WEBSOCKET_ACCEPT, SEC_WEBSOCKET_KEY, SEC_WEBSOCKET_VERSION,
    UPGRADE,
};
use axum::http::{HeaderMap, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse as _, Response};
use futures_util::StreamExt as _;
use hyper::client::conn::http1::handshake;
use hyper_util::rt::TokioIo;
use serde::Serialize;
use serde::de::DeserializeOwned;
use tokio::io::{AsyncWriteExt as _, copy_bidirectional};
use tokio::net::UnixStream;
use tokio::process::{Child as Process, Command};
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout};
use tokio_util::codec::{FramedRead, LinesCodec};
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;

use super::learner::{HOLD, LEARNER, LOG_FILTER, RunNews, RunPlan};
use super::robot::RobotNews;
use crate::control::{self, AskError, RunRequest, RunResponse};
use crate::files::Folder;
use crate::http::{ROLE, Refusal};
use crate::sandbox::{self, SandboxPolicy, WORKER_ARGUMENT};

/// CPU time of a run, in seconds: an hour of work.
const CPU_SECONDS: u64 = 3600;
/// Maximum length of what a run tells its server at once, in bytes.
const MAX_NEWS: usize = 64 << 10;
/// Maximum number of lines that a run has not read.
const MAX_ORDERS: usize = 8;
/// The log of a robot's agent, in its folder.
pub(super) const LOG: &str = "log.txt";
/// How long a run may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// The headers of a WebSocket's request and of its answer.
const WEBSOCKET: [HeaderName; 5] = [
    CONNECTION,
    UPGRADE,
    SEC_WEBSOCKET_KEY,
    SEC_WEBSOCKET_VERSION,
    SEC_WEBSOCKET_ACCEPT,
];

/// Where runs are started.
#[derive(Debug)]
pub(super) struct Launcher {
    executable: PathBuf,
    /// The folder of their sockets.
    folder: Folder,
}

impl Launcher {
    /// Uses this folder for sockets, and removes those of a killed server.
    pub(super) fn new(sockets: &Path) -> io::Result<Launcher> {
        let folder = Folder::make(sockets)?;
        for name in folder.names()? {
            // Also lists the folder itself, which stays.
            let _ = folder.remove(&name);
        }
        Ok(Launcher {
            executable: std::env::current_exe()?,
            folder,
        })
    }

    /// Starts a run, and calls `hear` with what happens, at last with `None` when the process has
    /// ended. Only on a thread that lives as long as the server: the run dies with it.
    pub(super) fn start(
        &self,
        plan: &RunPlan,
        number: u64,
        hear: impl Fn(Option<RunNews>) + Send + 'static,
    ) -> io::Result<Child> {
        let policy = SandboxPolicy {
            read: vec![plan.folder.clone()],
            write: vec![plan.data.clone()],
            cpu_seconds: CPU_SECONDS,
            serves: true,
        };
        Folder::make(&plan.data)?;
        let arguments = [WORKER_ARGUMENT, LEARNER];
        let (mut command, _) = sandbox::command(&self.executable, &arguments, &policy)?;
        command.stderr(Stdio::null());
        let mut command = Command::from(command);
        command.kill_on_drop(true);
        let child = self.launch(&number.to_string(), command, hear)?;
        child.tell(plan)?;
        Ok(child)
    }

    /// Starts the agent of a real robot, which ends in an orderly way when the child is dropped. Its
    /// log is a file in its folder.
    pub(super) fn start_robot(
        &self,
        robot: &RobotSetup,
        hear: impl Fn(Option<RobotNews>) + Send + 'static,
    ) -> io::Result<Child> {
        Folder::make(&robot.data)?;
        let mut command = Command::new(&self.executable);
        command
            .args(&robot.arguments)
            .env("RUST_LOG", LOG_FILTER)
            .stdout(Stdio::null())
            .stderr(File::create(robot.data.join(LOG))?)
            // Ctrl-C in a terminal is meant for the server.
            .process_group(0);
        self.launch(&format!("robot-{}", robot.name), command, hear)
    }

    fn launch<News: DeserializeOwned>(
        &self,
        name: &str,
        mut command: Command,
        hear: impl Fn(Option<News>) + Send + 'static,
    ) -> io::Result<Child> {
        // That of a process that has ended.
        let _ = self.folder.remove(name);
        let listener = UnixListener::bind(self.folder.socket_path(name))?;
        let process = command.stdin(OwnedFd::from(listener)).spawn()?;
        let socket = PathBuf::from(self.folder.socket_path(name));
        // Nobody waits for a process that does not read.
        let server = StdUnixStream::connect(&socket)?;
        server.set_nonblocking(true)?;
        let (heard, mut told) = UnixStream::from_std(server)?.into_split();
        let (orders, mut waiting) = mpsc::channel::<String>(MAX_ORDERS);
        let telling = tokio::spawn(async move {
            while let Some(order) = waiting.recv().await {
                if told.write_all(order.as_bytes()).await.is_err() {
                    return;
                }
            }
        });
        let mut heard = FramedRead::new(heard, LinesCodec::new_with_max_length(MAX_NEWS));
        let hearing = tokio::spawn(async move {
            while let Some(Ok(line)) = heard.next().await {
                hear(serde_json::from_str(&line).ok());
            }
            hear(None);
        });
        Ok(Child {
            socket,
            process,
            orders,
            _connection: [telling, hearing].map(AbortOnDropHandle::new),
            ended: None,
        })
    }
}

/// A real robot of the class.
#[derive(Debug, Clone)]
pub struct RobotSetup {
    pub name: String,
    /// The data folder of its agent.
    pub data: PathBuf,
    /// The arguments of this program that start it.
    pub arguments: Vec<OsString>,
}

/// A process of the class. Dropping it ends it.
#[derive(Debug)]
pub(super) struct Child {
    socket: PathBuf,
    process: Process,
    /// Lines for the process.
    orders: mpsc::Sender<String>,
    /// The connection that the process ends with.
    _connection: [AbortOnDropHandle<()>; 2],
    /// Since when its script does not run.
    pub(super) ended: Option<Instant>,
}

impl Child {
    /// Where viewers reach it.
    pub(super) fn socket(&self) -> PathBuf {
        self.socket.clone()
    }

    /// Makes everything in it stand, or go on.
    pub(super) fn hold(&self, held: bool) -> io::Result<()> {
        self.tell(&if held { HOLD } else { "go on" })
    }

    /// Tells it something, as a line of JSON. Fails if it does not read.
    pub(super) fn tell(&self, order: &impl Serialize) -> io::Result<()> {
        let line = serde_json::to_string(order)? + "\n";
        self.orders.try_send(line).map_err(io::Error::other)
    }

    /// Ends a process that does not read: the guardian of an agent stops its robot.
    pub(super) fn kill(&mut self) {
        let _ = self.process.start_kill();
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.socket);
    }
}

/// Asks the process with this socket for something.
pub(super) async fn ask(socket: &Path, request: &RunRequest) -> Result<RunResponse, AskError> {
    let stream = UnixStream::connect(socket).await?.into_std()?;
    control::ask(stream, request, ANSWER_TIMEOUT).await
}

pub(super) fn no_run() -> Refusal {
    Refusal::new(StatusCode::NOT_FOUND, "there is no run: press Run first")
}

/// Connects a page's WebSocket with the process that has this socket, until the token is cancelled.
/// Nothing else of the request goes there.
pub(super) async fn pass_on(
    socket: &Path,
    looks_only: bool,
    closed: CancellationToken,
    request: Request,
) -> Response {
    let connected = connect(socket, looks_only, closed, request);
    match timeout(ANSWER_TIMEOUT, connected).await {
        Ok(Ok(response)) => response,
        _ => no_run().into_response(),
    }
}

async fn connect(
    socket: &Path,
    looks_only: bool,
    closed: CancellationToken,
    mut request: Request,
) -> io::Result<Response> {
    let stream = UnixStream::connect(socket).await?;
    let handshake = handshake(TokioIo::new(stream)).await;
    let (mut sender, connection) = handshake.map_err(io::Error::other)?;
    let connection = AbortOnDropHandle::new(tokio::spawn(connection.with_upgrades()));
    let page = hyper::upgrade::on(&mut request);
    let mut onward = Request::new(Body::empty());
    *onward.uri_mut() = Uri::from_static("/live");
    *onward.headers_mut() = of_websocket(request.headers());
    let host = HeaderValue::from_static("localhost");
    onward.headers_mut().insert(HOST, host);
    if looks_only {
        let viewer = HeaderValue::from_static("viewer");
        onward.headers_mut().insert(ROLE, viewer);
    }
    let answer = sender.send_request(onward).await;
    let mut answer = answer.map_err(io::Error::other)?;
    let run = hyper::upgrade::on(&mut answer);
    if answer.status() == StatusCode::SWITCHING_PROTOCOLS {
        tokio::spawn(async move {
            let _connection = connection;
            if let (Ok(page), Ok(run)) = (page.await, run.await) {
                let mut page = TokioIo::new(page);
                let mut run = TokioIo::new(run);
                let copied = copy_bidirectional(&mut page, &mut run);
                let _ = closed.run_until_cancelled(copied).await;
            }
        });
    }
    Ok((answer.status(), of_websocket(answer.headers())).into_response())
}

/// Those of the headers that a WebSocket needs.
fn of_websocket(headers: &HeaderMap) -> HeaderMap {
    let value = |name: HeaderName| Some((name.clone(), headers.get(name)?.clone()));
    WEBSOCKET.into_iter().filter_map(value).collect()
}
