//! The guardian's own process: waits for messages and deadlines, and writes to the robot's socket.

use std::fs::DirEntry;
use std::io;
use std::os::fd::{AsFd, OwnedFd, RawFd};
use std::process::ExitCode;
use std::thread::sleep;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use rustix::net::{RecvFlags, Shutdown, recv};
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::time::Instant;

use super::dead_man::{DeadMan, LOOK, PendingWrite};
use super::message::{Datagram, GuardianMessage, MAX_MESSAGE_LEN};
use crate::socket_outq::unacknowledged;

/// The hidden argument that makes the executable run as a guardian.
pub const GUARDIAN_ARGUMENT: &str = "__guardian";
/// The highest file descriptor that a program is meant to inherit.
const STANDARD_ERROR: RawFd = 2;
/// How long to retry a socket that accepts no data.
const WRITE_LIMIT: Duration = Duration::from_secs(3);
/// How long the socket is held open while the kernel retransmits what was written last.
const LINGER: Duration = Duration::from_secs(3);
/// How long the robot may take to close its half, once it has acknowledged everything.
const CLOSING: Duration = Duration::from_millis(300);
/// How often to check whether the robot has acknowledged everything.
const RECHECK: Duration = Duration::from_millis(10);
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
    let mut dead_man = DeadMan::default();
    let mut robot = None;
    let served = outlive_signals()
        .and_then(|_outlived| serve(&rustix::stdio::stdin(), &mut dead_man, &mut robot));
    if let Some(robot) = &robot
        && dead_man.is_login()
    {
        wait_for_first_power(robot);
    }
    // After an error, too: nobody else would stop the robot.
    if let Some(robot) = &robot {
        if let Some(pending) = dead_man.end() {
            write(robot, &pending.bytes);
        }
        // Without last words, too: what the agent wrote last may still be on its way.
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
fn serve(
    messages: &impl AsFd,
    dead_man: &mut DeadMan,
    robot: &mut Option<OwnedFd>,
) -> io::Result<()> {
    let mut buffer = vec![0; MAX_MESSAGE_LEN];
    loop {
        wait_readable(messages, dead_man.next_deadline())?;
        // Drain pending messages before evaluating timeouts: the whole machine may have slept.
        loop {
            match GuardianMessage::receive(messages, &mut buffer)? {
                Datagram::Message(message, socket) => {
                    if message == GuardianMessage::Heartbeat {
                        // An agent that does not read its answers does not miss this one.
                        let _ = GuardianMessage::Heartbeat.send(messages, None);
                    }
                    *robot = match message {
                        GuardianMessage::Release => None,
                        _ => socket.or(robot.take()),
                    };
                    dead_man.handle(message, Instant::now());
                }
                Datagram::Nothing => break,
                Datagram::End => return Ok(()),
            }
        }
        if dead_man.is_login() && !robot.as_ref().is_some_and(has_first_power) {
            dead_man.defer(Instant::now());
        }
        if let (Some(robot), Some(pending)) = (&*robot, dead_man.poll(Instant::now())) {
            write_pending(robot, &pending);
            // An agent that resumes must know that the robot no longer does what it was last told.
            let _ = GuardianMessage::Wrote.send(messages, None);
        }
    }
}

/// Writes, and closes the write half if messages could be mixed otherwise: if the data completes a
/// message of the agent, or was not written in one piece, so that an agent that resumes may have
/// written in between. The read half stays open: closed, it would make the kernel reset the
/// connection when the robot sends something, and drop what is not delivered yet.
fn write_pending(robot: &OwnedFd, pending: &PendingWrite) {
    let in_one_piece = write(robot, &pending.bytes);
    if pending.closes || !in_one_piece {
        let _ = rustix::net::shutdown(robot, Shutdown::Write);
    }
}

/// Writes all bytes, as long as the socket accepts them, for at most [`WRITE_LIMIT`]. Returns
/// whether it accepted either all of them at once, or none.
fn write(robot: &OwnedFd, bytes: &[u8]) -> bool {
    let until = Instant::now() + WRITE_LIMIT;
    let mut left = bytes;
    let mut in_one_piece = true;
    while !left.is_empty() && Instant::now() < until {
        match rustix::io::write(robot, left) {
            Ok(count) => {
                left = &left[count..];
                in_one_piece &= left.is_empty();
            }
            Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => wait(robot, PollFlags::OUT, Some(until)).unwrap_or(()),
            Err(_) => break,
        }
    }
    in_one_piece
}

/// Closes the write half, and reads what the robot still sends: unread data would make the kernel
/// reset the connection and drop what is not delivered yet. Returns when the robot has closed its
/// half, [`CLOSING`] after it has acknowledged everything, or after [`LINGER`].
fn linger(robot: &OwnedFd) {
    let _ = rustix::net::shutdown(robot, Shutdown::Write);
    let mut until = Instant::now() + LINGER;
    let mut acknowledged = false;
    let mut chunk = [0; 16 * 1024];
    loop {
        let now = Instant::now();
        if !acknowledged && unacknowledged(robot) == Some(0) {
            acknowledged = true;
            until = until.min(now + CLOSING);
        }
        if until <= now {
            return;
        }
        let check = if acknowledged { until } else { now + RECHECK };
        match rustix::io::read(robot, &mut chunk) {
            Ok(0) => return,
            Ok(_) | Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => wait(robot, PollFlags::IN, Some(check)).unwrap_or(()),
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

/// How long to wait for it, as long as an agent does by default; the robot's only connection is
/// held open meanwhile.
const FIRST_POWER_LIMIT: Duration = Duration::from_secs(10);
const POWER: [u8; 5] = [b'P', b'K', 3, 0, 1];

/// Waits for the first POWER of a robot that has accepted a login. If the robot is sent a MOVE
/// before, it disconnects, and may drive on (`PROTOCOL.md`, *Order after login*).
fn wait_for_first_power(robot: &OwnedFd) {
    let until = Instant::now() + FIRST_POWER_LIMIT;
    while !has_first_power(robot) && Instant::now() < until {
        sleep(LOOK);
    }
}

/// Whether it has come, or the connection has ended, so that there is nothing to wait for. Reads
/// nothing away from the agent, which may resume.
fn has_first_power(robot: &OwnedFd) -> bool {
    let mut chunk = [0_u8; 16 * 1024];
    match recv(robot, &mut chunk[..], RecvFlags::PEEK | RecvFlags::DONTWAIT) {
        Ok((0, _)) => true,
        Ok((count, _)) => chunk[..count]
            .windows(POWER.len())
            .any(|part| part == POWER),
        Err(Errno::AGAIN | Errno::INTR) => false,
        Err(_) => true,
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{TcpListener, TcpStream};
    use std::os::unix::net::UnixStream;

    use rustix::net::sockopt::set_socket_send_buffer_size;

    use super::*;

    /// Many times what the socket takes at once.
    const LONG: usize = 256 * 1024;

    #[test]
    fn a_link_on_which_messages_could_be_mixed_is_closed_for_writing_only() {
        for (len, closes, closed) in [(20, false, false), (20, true, true), (LONG, false, true)] {
            let (near, mut far) = UnixStream::pair().unwrap();
            near.set_nonblocking(true).unwrap();
            far.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
            set_socket_send_buffer_size(&near, 4096).unwrap();
            let reader = std::thread::spawn(move || {
                far.read_exact(&mut vec![0; len]).unwrap();
                far
            });
            let robot = OwnedFd::from(near);
            let bytes = vec![7; len];
            write_pending(&robot, &PendingWrite { bytes, closes });
            let mut far = reader.join().unwrap();
            let refused = matches!(rustix::io::write(&robot, b"agent"), Err(Errno::PIPE));
            assert_eq!(refused, closed, "{len} bytes, {closes}");
            assert!(far.write_all(b"video").is_ok());
        }
    }

    #[test]
    fn the_battery_level_is_found_and_stays_to_be_read() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (mut robot, _) = listener.accept().unwrap();
        let near = OwnedFd::from(near);
        assert!(!has_first_power(&near));
        robot.write_all(b"PK\x10\x00\x01\x01").unwrap();
        assert!(!has_first_power(&near));
        robot.write_all(b"PK\x03\x00\x01\x50").unwrap();
        wait_for_first_power(&near);
        assert!(has_first_power(&near), "again");
    }

    #[test]
    fn a_connection_that_has_ended_is_not_waited_for() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        drop(listener.accept().unwrap());
        let near = OwnedFd::from(near);
        wait_for_first_power(&near);
        assert!(has_first_power(&near));
    }
}
