//! The runs of the learners and the agents of the real robots: starts and ends their processes, tells
//! them what to do, and passes on what viewers ask of them. They end with their server: with the
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
use axum::http::header::{CONNECTION, CONTENT_TYPE, HOST, HeaderName, HeaderValue, UPGRADE};
use axum::http::{StatusCode, Uri};
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

use super::learner::{HOLD, LEARNER, RunNews, RunPlan};
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
const LOG: &str = "log.txt";
/// How long a run may take to answer.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Headers of a request that a run needs, and of its answer that a page needs.
const PASSED: [HeaderName; 3] = [
    CONTENT_TYPE,
    HeaderName::from_static("sec-websocket-key"),
    HeaderName::from_static("sec-websocket-version"),
];
const RETURNED: [HeaderName; 4] = [
    CONTENT_TYPE,
    CONNECTION,
    UPGRADE,
    HeaderName::from_static("sec-websocket-accept"),
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

/// Passes a request on to the process with this socket, under this path. Nothing else of the request
/// goes there but its method, its body and what a WebSocket needs, which is closed with the token.
pub(super) async fn pass_on(
    socket: &Path,
    path: &'static str,
    may_change: bool,
    closed: CancellationToken,
    request: Request,
) -> Response {
    let passed = timeout(
        ANSWER_TIMEOUT,
        pass(socket, path, may_change, closed, request),
    );
    match passed.await {
        Ok(Ok(response)) => response,
        _ => no_run().into_response(),
    }
}

/// The request as the process gets it.
fn onward(request: Request, path: &'static str, may_change: bool) -> Request {
    let (head, body) = request.into_parts();
    let is_socket = head.headers.contains_key(UPGRADE);
    let body = if is_socket { Body::empty() } else { body };
    let mut onward = Request::new(body);
    *onward.method_mut() = head.method;
    *onward.uri_mut() = Uri::from_static(path);
    let headers = onward.headers_mut();
    for name in PASSED {
        headers.extend(head.headers.get(&name).map(|value| (name, value.clone())));
    }
    headers.insert(HOST, HeaderValue::from_static("localhost"));
    if is_socket {
        headers.insert(CONNECTION, HeaderValue::from_static("upgrade"));
        headers.insert(UPGRADE, HeaderValue::from_static("websocket"));
    }
    if !may_change {
        headers.insert(ROLE, HeaderValue::from_static("viewer"));
    }
    onward
}

async fn pass(
    socket: &Path,
    path: &'static str,
    may_change: bool,
    closed: CancellationToken,
    mut request: Request,
) -> io::Result<Response> {
    let stream = UnixStream::connect(socket).await?;
    let (mut sender, connection) = handshake(TokioIo::new(stream))
        .await
        .map_err(io::Error::other)?;
    let connection = tokio::spawn(connection.with_upgrades());
    let page = hyper::upgrade::on(&mut request);
    let onward = onward(request, path, may_change);
    let mut answer = sender
        .send_request(onward)
        .await
        .map_err(io::Error::other)?;
    let run = hyper::upgrade::on(&mut answer);
    let (head, body) = answer.into_parts();
    let mut response = Response::new(Body::new(body));
    *response.status_mut() = head.status;
    for name in RETURNED {
        let value = head.headers.get(&name).cloned();
        response
            .headers_mut()
            .extend(value.map(|value| (name, value)));
    }
    if head.status == StatusCode::SWITCHING_PROTOCOLS {
        tokio::spawn(async move {
            let _connection = AbortOnDropHandle::new(connection);
            if let (Ok(page), Ok(run)) = (page.await, run.await) {
                let mut page = TokioIo::new(page);
                let mut run = TokioIo::new(run);
                let copied = copy_bidirectional(&mut page, &mut run);
                let _ = closed.run_until_cancelled(copied).await;
            }
        });
    }
    Ok(response)
}
