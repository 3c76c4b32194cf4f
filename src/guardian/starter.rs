//! Starts guardian processes: the first one, and another whenever one is gone or answers no more. A
//! new process takes its time, so this has a thread of its own; the driving core only leaves a note
//! and looks whether there is a new one.

use std::io;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, SyncSender, TryRecvError, sync_channel};
use std::thread;
use std::time::{Duration, Instant};

use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};

use super::process::GUARDIAN_ARGUMENT;

/// Tries to start another guardian in a row before it is given up.
const MOST_TRIES: u32 = 8;
/// The pause before the first of them; each is twice as long as the one before.
const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// A guardian that has lived for so long was a good one: the tries count from the first again.
const GOOD_LIFE: Duration = Duration::from_secs(60);

/// The way to the thread. When it is dropped the thread ends; the guardian lives on until it has no
/// agent any more.
#[derive(Debug)]
pub(super) struct Starter {
    lost: SyncSender<OwnedFd>,
    started: Receiver<OwnedFd>,
}

/// What has become of a guardian that was asked for.
#[derive(Debug)]
pub(super) enum Started {
    /// It is there: the agent's end of its socket.
    Yes(OwnedFd),
    /// Not yet.
    NotYet,
    /// There will be none.
    Never,
}

impl Starter {
    /// Starts the first guardian, and the thread. Waits for the new process.
    ///
    /// # Errors
    /// Whatever the system says; then there is no guardian.
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

    /// Asks for another guardian in place of one that is gone, or does not answer and is killed. Never
    /// waits. One is asked for at a time.
    pub(super) fn replace(&self, socket: OwnedFd) {
        let _ = self.lost.try_send(socket);
    }

    /// Whether the guardian that was asked for is there. Never waits.
    pub(super) fn poll(&self) -> Started {
        match self.started.try_recv() {
            Ok(socket) => Started::Yes(socket),
            Err(TryRecvError::Empty) => Started::NotYet,
            Err(TryRecvError::Disconnected) => Started::Never,
        }
    }
}

/// The thread's life.
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
        // Not before it is dead: at the end of its socket it would speak to the robot.
        drop(socket);
        let (next, socket) = loop {
            if tries == MOST_TRIES {
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

/// A guardian's process. Dropping it does nothing to it.
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

    /// SIGKILL, and reaps it.
    fn kill(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
