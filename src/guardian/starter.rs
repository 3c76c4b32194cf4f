//! Starts guardian processes on a thread, because that takes time that the driving core does not
//! have.

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};
use tokio::sync::mpsc;

use super::process::GUARDIAN_ARGUMENT;
use crate::rate_limit::Backoff;

/// The pause before another guardian is started; after each further one it is twice as long, up to
/// the longest.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
const LONGEST_PAUSE: Duration = Duration::from_secs(5);
/// After a guardian that has lived this long the pauses begin anew.
const GOOD_LIFE: Duration = Duration::from_secs(60);

#[derive(Debug, Clone, Default)]
pub struct GuardianFiles {
    /// Where it tells people what it does without the agent; see
    /// [`record_path`](super::record_path).
    pub record: Option<PathBuf>,
    /// Where it listens for a person's STOP; see [`request_stop`](super::request_stop).
    pub stop_socket: Option<PathBuf>,
}

/// When it is dropped the thread ends; a guardian lives on until its agent is gone.
#[derive(Debug)]
pub(super) struct Starter {
    lost: SyncSender<OwnedFd>,
    started: mpsc::Receiver<OwnedFd>,
}

impl Starter {
    /// Blocks until the first guardian's process is started. If that fails it is tried again, as
    /// after the loss of a guardian.
    pub(super) fn start(
        executable: &Path,
        files: GuardianFiles,
    ) -> io::Result<(Starter, io::Result<OwnedFd>)> {
        // The program's file may be replaced while this one runs.
        let executable = File::open(executable)?;
        let (lost, losses) = sync_channel(1);
        let (starts, started) = mpsc::channel(1);
        let (process, first) = match start_process(&executable, &files) {
            Ok((process, socket)) => (Some(process), Ok(socket)),
            Err(error) => (None, Err(error)),
        };
        thread::Builder::new()
            .name("guardian".into())
            .spawn(move || keep_running(&executable, &files, process, &losses, &starts))?;
        Ok((Starter { lost, started }, first))
    }

    /// Requests another guardian in place of one that is gone, or is killed because it does not
    /// answer. Never blocks. Only one request is pending at a time.
    pub(super) fn replace(&self, socket: OwnedFd) {
        let _ = self.lost.try_send(socket);
    }

    /// The socket of the requested guardian, if it runs. Never blocks.
    pub(super) fn poll(&mut self) -> Option<OwnedFd> {
        self.started.try_recv().ok()
    }

    /// The same, when it runs. Cancel-safe.
    pub(super) async fn started(&mut self) -> OwnedFd {
        match self.started.recv().await {
            Some(socket) => socket,
            None => std::future::pending().await,
        }
    }
}

fn keep_running(
    executable: &File,
    files: &GuardianFiles,
    mut process: Option<Child>,
    losses: &Receiver<OwnedFd>,
    started: &mpsc::Sender<OwnedFd>,
) {
    let mut backoff = Backoff::new(FIRST_PAUSE, LONGEST_PAUSE);
    let mut began = Instant::now();
    loop {
        if let Some(mut lost) = process.take() {
            let Ok(socket) = losses.recv() else {
                return;
            };
            let _ = lost.kill();
            let _ = lost.wait();
            // Only after its death: at the end of its socket it would write to the robot.
            drop(socket);
            if began.elapsed() >= GOOD_LIFE {
                backoff.reset();
            }
        } else if matches!(losses.try_recv(), Err(TryRecvError::Disconnected)) {
            return;
        }
        thread::sleep(backoff.step());
        if let Ok((next, socket)) = start_process(executable, files) {
            process = Some(next);
            began = Instant::now();
            if started.blocking_send(socket).is_err() {
                return;
            }
        }
    }
}

fn start_process(executable: &File, files: &GuardianFiles) -> io::Result<(Child, OwnedFd)> {
    let flags = SocketFlags::CLOEXEC;
    let (ours, theirs) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
    let path = |path: &Option<PathBuf>| path.clone().unwrap_or_default();
    let child = Command::new(format!("/proc/self/fd/{}", executable.as_raw_fd()))
        .arg0("robot-guardian")
        .arg(GUARDIAN_ARGUMENT)
        .arg(path(&files.record))
        .arg(path(&files.stop_socket))
        .env_clear()
        .current_dir("/")
        .stdin(Stdio::from(theirs))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()?;
    Ok((child, ours))
}
