//! Starts guardian processes: the first one, and another whenever one is gone or no longer answers.
//! Starting a process takes time, so a thread does it; the driving core only sends a request and
//! polls for the new one.

use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};

use super::process::GUARDIAN_ARGUMENT;

/// The most consecutive attempts to start another guardian.
const MAX_TRIES: u32 = 8;
/// The pause before the first attempt; each further pause is twice as long.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// The count of attempts restarts after a guardian that has lived this long.
const GOOD_LIFE: Duration = Duration::from_secs(60);

/// The channel to the thread. When it is dropped the thread ends; the guardian lives on until its
/// agent is gone.
#[derive(Debug)]
pub(super) struct Starter {
    lost: SyncSender<OwnedFd>,
    started: Receiver<OwnedFd>,
}

/// The state of a requested guardian.
#[derive(Debug)]
pub(super) enum Started {
    /// It runs: the agent's end of its socket.
    Yes(OwnedFd),
    /// Not yet.
    NotYet,
    /// None will be started.
    Never,
}

impl Starter {
    /// Starts the first guardian, and the thread. Blocks until the process is started.
    ///
    /// # Errors
    /// Any error of the system; then there is no guardian.
    pub(super) fn start(executable: &Path) -> io::Result<(Starter, OwnedFd)> {
        let first = Process::start(executable)?;
        let (lost, losses) = sync_channel(1);
        let (start, started) = sync_channel(1);
        let executable = executable.to_owned();
        let (process, socket) = first;
        thread::Builder::new()
            .name("guardian".into())
            .spawn(move || replace(&executable, process, &losses, &start))?;
        Ok((Starter { lost, started }, socket))
    }

    /// Requests another guardian in place of one that is gone, or is killed because it does not
    /// answer. Never blocks. Only one request is pending at a time.
    pub(super) fn replace(&self, socket: OwnedFd) {
        let _ = self.lost.try_send(socket);
    }

    /// Whether the requested guardian runs. Never blocks.
    pub(super) fn poll(&self) -> Started {
        match self.started.try_recv() {
            Ok(socket) => Started::Yes(socket),
            Err(TryRecvError::Empty) => Started::NotYet,
            Err(TryRecvError::Disconnected) => Started::Never,
        }
    }
}

/// The thread's main loop.
fn replace(
    executable: &Path,
    mut process: Process,
    losses: &Receiver<OwnedFd>,
    started: &SyncSender<OwnedFd>,
) {
    let mut tries = 0;
    while let Ok(socket) = losses.recv() {
        if process.began.elapsed() >= GOOD_LIFE {
            tries = 0;
        }
        process.kill();
        // Only after its death: at the end of its socket it would write to the robot.
        drop(socket);
        let (next, socket) = loop {
            if tries == MAX_TRIES {
                return;
            }
            thread::sleep(FIRST_PAUSE * 2_u32.pow(tries));
            tries += 1;
            if let Ok(next) = Process::start(executable) {
                break next;
            }
        };
        process = next;
        if started.send(socket).is_err() {
            return;
        }
    }
}

/// A guardian's process. Dropping it leaves the process running.
#[derive(Debug)]
struct Process {
    child: Child,
    began: Instant,
}

impl Process {
    fn start(executable: &Path) -> io::Result<(Process, OwnedFd)> {
        let flags = SocketFlags::CLOEXEC;
        let (ours, theirs) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        let child = Command::new(executable)
            .arg(GUARDIAN_ARGUMENT)
            .env_clear()
            .current_dir("/")
            .stdin(Stdio::from(theirs))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        let began = Instant::now();
        Ok((Process { child, began }, ours))
    }

    /// Kills the process with SIGKILL, and reaps it.
    fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
