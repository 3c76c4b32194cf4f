//! Starts and ends hosts: processes of this executable with a hidden argument, a socket pair as
//! standard input and no other open files. In virtual time a host is a task on this thread instead,
//! with the same code and messages but without the isolation of a process.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite};
use tokio::net::UnixStream;
use tokio::process::{Child, ChildStderr, Command};
use tokio::runtime::Handle as Runtime;
use tokio::sync::{mpsc, watch};
use tokio::task::{AbortHandle, JoinHandle};
use tokio::time::{Instant, timeout};

use super::account::{Account, Accounts};
use super::host::{Launch, Receiver, Sender, Time, ToHost, serve};
use super::inspection::Inspector;
use super::library::Library;
use super::name::validate_name;
use crate::files::Folder;
use crate::robot::channel::Request;
use crate::robot::{BehaviourId, Bus, EndReason, Pictures, Priority, ViewerChannel};
use crate::sandbox::{self, SandboxPolicy};
use crate::script::{FromHost, ModuleName, NoModule, ScriptExit};

/// The hidden argument that makes the executable run as a host.
pub const HOST_ARGUMENT: &str = "__host";
/// Maximum number of bytes kept of what a failing host writes to its standard error.
const MAX_LAST_WORDS: u64 = 4096;

/// Capacity of an in-memory pipe in bytes: a few frames. A writer waits while it is full.
const PIPE_LEN: usize = 64 * 1024;

pub(super) type PipeReader = Box<dyn AsyncRead + Send + Unpin>;
pub(super) type PipeWriter = Box<dyn AsyncWrite + Send + Unpin>;

#[derive(Debug, Clone)]
pub struct Launcher {
    /// `None`: hosts are tasks of this process.
    executable: Option<PathBuf>,
}

impl Launcher {
    /// Starts hosts from this executable, which must be `spykee`.
    pub fn new(executable: PathBuf) -> Launcher {
        Launcher {
            executable: Some(executable),
        }
    }

    /// Runs hosts as tasks of this thread, for virtual time. Only within a
    /// [`tokio::runtime::LocalRuntime`], on a thread with [`super::STACK`] of stack. Only the VM's
    /// own limits confine such a script: no Landlock, no seccomp, no kernel limits.
    pub fn in_this_thread() -> Launcher {
        Launcher { executable: None }
    }

    pub fn this_executable() -> io::Result<Launcher> {
        std::env::current_exe().map(Launcher::new)
    }

    /// Returns an inspector that uses the same executable; `None` in virtual time, which uses no
    /// processes.
    pub fn inspector(&self) -> Option<Inspector> {
        self.executable.clone().map(Inspector::new)
    }

    /// Whether hosts are tasks of this thread. If so, the caller must not wait for other threads.
    pub(super) fn is_in_this_thread(&self) -> bool {
        self.executable.is_none()
    }

    /// Starts a host that can open only files in `folders`, which are created if necessary. The
    /// runtime `core` serves the agent's ends of its pipe. Blocks on the disk and on the new
    /// process: not for the driving core. The calling thread must live as long as the agent: the
    /// host dies with it. Fails if a folder is a symbolic link.
    pub(super) fn start(
        &self,
        folders: &[&Path],
        core: &Runtime,
    ) -> io::Result<(HostProcess, PipeReader, PipeWriter)> {
        for folder in folders {
            make_private(folder)?;
        }
        match &self.executable {
            Some(executable) => start_child(executable, folders, core),
            None => Ok(start_task()),
        }
    }
}

fn start_child(
    executable: &Path,
    folders: &[&Path],
    core: &Runtime,
) -> io::Result<(HostProcess, PipeReader, PipeWriter)> {
    let policy = SandboxPolicy {
        write: folders.iter().map(|folder| folder.to_path_buf()).collect(),
        ..SandboxPolicy::default()
    };
    let (command, ours) = sandbox::command(executable, &[HOST_ARGUMENT], &policy)?;
    ours.set_nonblocking(true)?;
    let child = Command::from(command).kill_on_drop(true).spawn()?;
    let (reader, writer) = {
        let _served_by = core.enter();
        UnixStream::from_std(ours)?.into_split()
    };
    Ok((
        HostProcess::Child(child),
        Box::new(reader),
        Box::new(writer),
    ))
}

fn start_task() -> (HostProcess, PipeReader, PipeWriter) {
    let (to_host, host_reader) = tokio::io::duplex(PIPE_LEN);
    let (host_writer, from_host) = tokio::io::duplex(PIPE_LEN);
    let task = tokio::task::spawn_local(serve(host_reader, host_writer, Time::Virtual));
    (
        HostProcess::Task(task),
        Box::new(from_host),
        Box::new(to_host),
    )
}

/// Creates a folder that only its user can access. If it cannot be created nothing can be saved,
/// but the behaviour runs anyway; a symbolic link in its place is an error, because its author
/// would decide where this user's files are written.
fn make_private(folder: &Path) -> io::Result<()> {
    match Folder::make(folder) {
        Ok(_) => Ok(()),
        Err(error) if folder.is_symlink() => Err(error),
        Err(error) => {
            tracing::debug!("cannot make {}: {error}", folder.display());
            Ok(())
        }
    }
}

/// A running host. Dropping it kills it.
#[derive(Debug)]
pub(super) enum HostProcess {
    Child(Child),
    Task(JoinHandle<io::Result<()>>),
    Over,
}

impl HostProcess {
    /// Sends SIGKILL and reaps the process; a task is aborted at its current await point.
    pub(super) async fn kill(&mut self) -> io::Result<String> {
        match self {
            HostProcess::Child(child) => child.start_kill()?,
            HostProcess::Task(task) => task.abort(),
            HostProcess::Over => {}
        }
        self.wait().await
    }

    /// Waits until the host has ended on its own; returns how. Cancel-safe.
    pub(super) async fn wait(&mut self) -> io::Result<String> {
        let ended = match self {
            HostProcess::Child(child) => return Ok(child.wait().await?.to_string()),
            HostProcess::Task(task) => task.await,
            HostProcess::Over => return Ok("returned".to_owned()),
        };
        *self = HostProcess::Over;
        Ok(match ended {
            Ok(Ok(())) => "returned".to_owned(),
            Ok(Err(error)) => error.to_string(),
            Err(error) if error.is_cancelled() => "killed".to_owned(),
            Err(_) => "it panicked".to_owned(),
        })
    }

    /// Returns what a host that has ended wrote to its standard error: nothing, unless it failed.
    pub(super) async fn last_words(&mut self) -> String {
        let HostProcess::Child(child) = self else {
            return String::new();
        };
        let mut words = Vec::new();
        if let Some(stderr) = child.stderr.take() {
            let _ = <ChildStderr as AsyncReadExt>::take(stderr, MAX_LAST_WORDS)
                .read_to_end(&mut words)
                .await;
        }
        String::from_utf8_lossy(&words).trim().to_owned()
    }
}

impl Drop for HostProcess {
    fn drop(&mut self) {
        if let HostProcess::Task(task) = self {
            task.abort();
        }
    }
}

/// Capacity of the queue of messages to a host.
const MAX_WAITING: usize = 128;
/// Maximum number of modules that a host may request in its lifetime; an honest one requests fewer.
const MAX_MODULES: usize = 256;
/// How long a host may take to load its script.
const LOAD_TIME: Duration = Duration::from_secs(5);
/// How long a host may take to exit after it reported its end.
pub(super) const EXIT_TIME: Duration = Duration::from_millis(100);

/// What hosts need of their agent.
#[derive(Debug, Clone)]
pub struct HostContext {
    pub launcher: Launcher,
    /// Serves their pipes.
    pub core: Runtime,
    pub requests: mpsc::Sender<Request>,
    pub frames: watch::Receiver<Pictures>,
    /// How long a host may be silent before it is ended, whether it drives or not. While it drives,
    /// the watchdog is stricter.
    pub longest_silence: Duration,
    /// Publishes the scripts' detections in frames, and their parameters.
    pub viewers: ViewerChannel,
    /// Publishes the scripts' reports (entries, notices, pictures).
    pub bus: Bus,
    /// What the behaviours have written today.
    pub accounts: Accounts,
}

/// A behaviour whose script is loaded but does not run yet.
#[derive(Debug)]
pub struct Prepared {
    pub(super) by: BehaviourId,
    pub(super) name: String,
    pub(super) priority: Priority,
    pub(super) process: HostProcess,
    pub(super) from_host: Receiver<FromHost>,
    pub(super) to_host: mpsc::Sender<ToHost>,
    pub(super) modules: mpsc::Sender<ModuleName>,
    pump: AbortHandle,
    /// False in virtual time, in which no sign of life is expected.
    pub(super) in_real_time: bool,
    pub(super) account: Account,
}

impl Prepared {
    /// Starts a host and lets it load the script. The error is in words for the script's author.
    pub async fn start(
        context: &HostContext,
        by: BehaviourId,
        priority: Priority,
        mut launch: Launch,
    ) -> Result<Prepared, ScriptExit> {
        let HostContext { launcher, core, .. } = context;
        let name = launch.options.name.clone();
        let broken = |error: io::Error| {
            exit(
                EndReason::Error,
                &format!("{name}: its host cannot be started: {error}"),
            )
        };
        validate_name(&name).map_err(|error| exit(EndReason::Error, &error.to_string()))?;
        let account = context.accounts.open(&launch.options);
        if !launcher.is_in_this_thread() {
            let left = account.weigh(Instant::now());
            let left = left.map_err(|why| exit(EndReason::Error, &format!("{name}: {why}")))?;
            launch.options.bytes_left = Some(left);
        }
        let started = launcher.start(&launch.options.folders(), core);
        let (process, reader, writer) = started.map_err(broken)?;
        let (from_host, to_host, pump) = connect(reader, writer, core);
        let modules = serve_modules(
            launch.library.clone(),
            to_host.clone(),
            launcher.is_in_this_thread(),
        );
        let mut prepared = Prepared {
            by,
            name: name.clone(),
            priority,
            process,
            from_host,
            to_host,
            modules,
            pump,
            in_real_time: !launcher.is_in_this_thread(),
            account,
        };
        let _ = prepared.to_host.try_send(ToHost::Load(Box::new(launch)));
        match timeout(LOAD_TIME, prepared.from_host.next()).await {
            Ok(Ok(Some(FromHost::Ready))) => Ok(prepared),
            Ok(Ok(Some(FromHost::Ended(exit)))) => Err(exit),
            Ok(Ok(_)) => Err(prepared.failure_exit().await),
            Ok(Err(error)) => Err(broken(error)),
            Err(_) => Err(broken(io::ErrorKind::TimedOut.into())),
        }
    }

    /// Describes the end of a host that exited without reporting a reason.
    pub(super) async fn failure_exit(&mut self) -> ScriptExit {
        let status = match timeout(EXIT_TIME, self.process.wait()).await {
            Ok(status) => status,
            Err(_) => self.process.kill().await,
        };
        let status = status.unwrap_or_else(|error| error.to_string());
        let words = timeout(EXIT_TIME, self.process.last_words())
            .await
            .unwrap_or_default();
        let text = format!(
            "{}: its process ended unexpectedly ({status}) {words}",
            self.name
        );
        exit(EndReason::Error, text.trim_end())
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        self.pump.abort();
    }
}

fn connect(
    reader: PipeReader,
    writer: PipeWriter,
    core: &Runtime,
) -> (Receiver<FromHost>, mpsc::Sender<ToHost>, AbortHandle) {
    let (to_host, waiting) = mpsc::channel(MAX_WAITING);
    let pump = core.spawn(Sender::new(writer).pump(waiting)).abort_handle();
    (Receiver::new(reader), to_host, pump)
}

/// Reads modules for a host, one by one, on a thread that may block on the disk; with `here`, for
/// virtual time, on the current thread.
fn serve_modules(
    library: Library,
    to_host: mpsc::Sender<ToHost>,
    here: bool,
) -> mpsc::Sender<ModuleName> {
    let (ask, mut asked) = mpsc::channel::<ModuleName>(MAX_MODULES);
    tokio::spawn(async move {
        let mut left = MAX_MODULES;
        while let Some(name) = asked.recv().await {
            left = match left.checked_sub(1) {
                Some(left) => left,
                None => return,
            };
            let source = library.clone();
            let wanted = name.clone();
            let fetch = move || source.fetch(&wanted);
            let file = if here {
                fetch()
            } else {
                let fetched = tokio::task::spawn_blocking(fetch).await;
                fetched.unwrap_or_else(|error| Err(NoModule(error.to_string())))
            };
            if to_host.send(ToHost::Module(name, file)).await.is_err() {
                return;
            }
        }
    });
    ask
}

pub(super) fn exit(reason: EndReason, message: &str) -> ScriptExit {
    ScriptExit {
        reason,
        message: Some(message.to_owned()),
    }
}
