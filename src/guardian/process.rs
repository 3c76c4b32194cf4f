//! The guardian's own process: waits for notes and deadlines, and writes to the robot's socket.

use std::fs::DirEntry;
use std::io;
use std::os::fd::{AsFd, OwnedFd, RawFd};
use std::process::ExitCode;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::Shutdown;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::time::Instant;

use super::first_power;
use super::guard::{Guard, PendingWrite};
use super::note::{MAX_NOTE_LEN, Note, Received};

/// The hidden argument that makes the executable run as a guardian.
pub const GUARDIAN_ARGUMENT: &str = "__guardian";
/// The highest file descriptor that a program is meant to inherit.
const STANDARD_ERROR: RawFd = 2;
/// How long to retry a socket that accepts no data.
const WRITE_LIMIT: Duration = Duration::from_secs(3);
/// How long the socket is held open while the kernel retransmits the last words.
const LINGER: Duration = Duration::from_secs(3);
/// Signals that end or stop a program, but not the guardian: it ends after the agent.
const OUTLIVED: [SignalKind; 8] = [
    SignalKind::hangup(),
    SignalKind::interrupt(),
    SignalKind::terminate(),
    SignalKind::quit(),
    SignalKind::user_defined1(),
    SignalKind::user_defined2(),
    SignalKind::alarm(),
    SignalKind::from_raw(libc::SIGTSTP),
];

/// Runs the guardian process until the agent's end of its standard input is closed.
pub fn guardian_main() -> ExitCode {
    close_inherited();
    // In its own session no terminal signals reach it. Fails only for the leader of a process
    // group.
    let _ = rustix::process::setsid();
    let (mut guard, mut robot) = (Guard::default(), None);
    let served = outlive_signals()
        .and_then(|_outlived| serve(&rustix::stdio::stdin(), &mut guard, &mut robot));
    if let Some(robot) = robot.as_ref().filter(|_| guard.is_login()) {
        first_power::wait(robot);
    }
    // After an error, too: nobody else would stop the robot.
    if let (Some(robot), Some(pending)) = (&robot, guard.end()) {
        write(robot, &pending.bytes);
        linger(robot);
    }
    match served {
        Ok(()) => ExitCode::SUCCESS,
        Err(_) => ExitCode::FAILURE,
    }
}

/// Closes the descriptors inherited from the agent: files, pipes and terminals stay open for as
/// long as any process holds them. Standard input is the channel from the agent; standard output
/// and error lead nowhere.
fn close_inherited() {
    let Ok(open) = std::fs::read_dir("/proc/self/fd") else {
        return;
    };
    let number = |entry: io::Result<DirEntry>| entry.ok()?.file_name().to_str()?.parse().ok();
    let numbers: Vec<RawFd> = open.filter_map(number).collect();
    for number in numbers {
        if number > STANDARD_ERROR {
            // The descriptor of the listed folder is closed already.
            let _ = nix::unistd::close(number);
        }
    }
}

/// Ignores the signals for as long as the returned value lives.
fn outlive_signals() -> io::Result<(tokio::runtime::Runtime, Vec<Signal>)> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_io()
        .build()?;
    let signals = {
        let _within = runtime.enter();
        let signals = OUTLIVED.into_iter().map(signal);
        signals.collect::<io::Result<_>>()?
    };
    Ok((runtime, signals))
}

/// Serves the agent until its end, or until nothing can be received any more.
fn serve(notes: &impl AsFd, guard: &mut Guard, robot: &mut Option<OwnedFd>) -> io::Result<()> {
    let mut buffer = vec![0; MAX_NOTE_LEN];
    loop {
        wait_readable(notes, guard.next_deadline())?;
        // Drain pending notes before evaluating timeouts: the whole machine may have slept.
        loop {
            match Note::receive(notes, &mut buffer)? {
                Received::Note(note, socket) => {
                    if note == Note::Beat {
                        // An agent that does not read its answers does not miss this one.
                        let _ = Note::Beat.send(notes, None);
                    }
                    *robot = match note {
                        Note::Release => None,
                        _ => socket.or(robot.take()),
                    };
                    guard.take(note, Instant::now());
                }
                Received::Nothing => break,
                Received::End => return Ok(()),
            }
        }
        if guard.is_login() && !robot.as_ref().is_some_and(first_power::has_come) {
            guard.defer(Instant::now());
        }
        if let (Some(robot), Some(pending)) = (&*robot, guard.poll(Instant::now())) {
            write_pending(robot, &pending);
        }
    }
}

fn write_pending(robot: &OwnedFd, pending: &PendingWrite) {
    write(robot, &pending.bytes);
    if pending.closes {
        let _ = rustix::net::shutdown(robot, Shutdown::Both);
    }
}

/// Writes all bytes, as long as the socket accepts them, for at most [`WRITE_LIMIT`].
fn write(robot: &OwnedFd, mut bytes: &[u8]) {
    let until = Instant::now() + WRITE_LIMIT;
    while !bytes.is_empty() && Instant::now() < until {
        match rustix::io::write(robot, bytes) {
            Ok(count) => bytes = &bytes[count..],
            Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => wait(robot, PollFlags::OUT, Some(until)).unwrap_or(()),
            Err(_) => return,
        }
    }
}

/// Closes the write half, and reads what the robot still sends: unread data would make the kernel
/// reset the connection and drop what is not delivered yet.
fn linger(robot: &OwnedFd) {
    let until = Instant::now() + LINGER;
    let _ = rustix::net::shutdown(robot, Shutdown::Write);
    let mut chunk = [0; 16 * 1024];
    while Instant::now() < until {
        match rustix::io::read(robot, &mut chunk) {
            Ok(0) => return,
            Ok(_) | Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => wait(robot, PollFlags::IN, Some(until)).unwrap_or(()),
            Err(_) => return,
        }
    }
}

fn wait_readable(socket: &impl AsFd, until: Option<Instant>) -> io::Result<()> {
    wait(socket, PollFlags::IN, until)
}

/// Waits until the socket is ready, or until the deadline; a signal may end the wait early.
fn wait(socket: &impl AsFd, ready: PollFlags, until: Option<Instant>) -> io::Result<()> {
    let left = until.map(|until| until.saturating_duration_since(Instant::now()));
    let left = left.and_then(|left| Timespec::try_from(left).ok());
    match poll(&mut [PollFd::new(socket, ready)], left.as_ref()) {
        Ok(_) | Err(Errno::INTR) => Ok(()),
        Err(error) => Err(error.into()),
    }
}
