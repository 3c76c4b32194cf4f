//! The guardian's ends of connections to the robot: the link that the agent has left, and the one
//! that the guardian has dialled. Nothing here blocks.

use std::io;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::time::Duration;

use rustix::event::PollFlags;
use rustix::io::Errno;
use rustix::net::{
    RecvFlags, SendFlags, Shutdown, connect_unspec, getpeername, recv, send, shutdown,
};
use socket2::{SockRef, Socket};

use super::debt::DebtEvent;
use crate::robot_socket::{self, FormerLink};
use crate::socket_outq::unacknowledged;
use crate::wire::{Decoder, Refusal, Report};

const CHUNK_LEN: usize = 16 * 1024;
/// The most chunks that are read at a time, so that a flood of data keeps nothing else waiting.
const MAX_CHUNKS: usize = 64;
/// What is searched for a login's first POWER while the agent lives; more than a robot is known to
/// send before.
const PEEK_LEN: usize = 1024 * 1024;
/// A POWER message but for its level. On the agent's link it must be found between any other bytes:
/// the agent may have read the beginning of a message.
const POWER: [u8; 5] = [b'P', b'K', 3, 0, 1];
/// How long what is written on a dialled connection may stay unacknowledged. Then it is dialled
/// anew: the kernel's own repetitions come at ever longer intervals.
const DEAD_AFTER: Duration = Duration::from_millis(1500);

#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Received {
    pub(super) powers: u32,
    /// [`DebtEvent::LinkClosed`] or [`DebtEvent::LinkBroken`], at the end of the link.
    pub(super) end: Option<DebtEvent>,
}

/// The link that the agent has used.
#[derive(Debug)]
pub(super) struct RobotLink {
    pub(super) stream: Stream,
    /// The last bytes read, which may be the beginning of a POWER.
    tail: Vec<u8>,
}

impl RobotLink {
    pub(super) fn new(socket: OwnedFd) -> RobotLink {
        RobotLink {
            stream: Stream::new(socket),
            tail: Vec::new(),
        }
    }

    /// Outlives an outage of this length, though the agent would not have.
    pub(super) fn outlive(&self, outage: Duration) {
        let _ = SockRef::from(&self.stream.socket).set_tcp_user_timeout(Some(outage));
    }

    /// Whether the first POWER has come, or the connection has ended, so that there is nothing to
    /// wait for. Reads nothing away from the agent, which may resume.
    pub(super) fn has_first_power(&self) -> bool {
        let mut bytes = vec![0_u8; PEEK_LEN];
        let flags = RecvFlags::PEEK | RecvFlags::DONTWAIT;
        match recv(&self.stream.socket, &mut bytes[..], flags) {
            Ok((0, _)) => true,
            Ok((count, _)) => powers_in(&bytes[..count]) > 0,
            Err(Errno::AGAIN | Errno::INTR) => false,
            Err(_) => true,
        }
    }

    pub(super) fn read(&mut self) -> Received {
        let mut powers = 0;
        let tail = &mut self.tail;
        let end = self.stream.read(|chunk| {
            tail.extend_from_slice(chunk);
            powers += powers_in(tail);
            tail.drain(..tail.len().saturating_sub(POWER.len() - 1));
            true
        });
        Received { powers, end }
    }

    /// Writes without blocking; what is not accepted now follows with [`Stream::flush`]. The
    /// write half is closed if messages could be mixed otherwise: if `closes`, or if the bytes were
    /// not accepted at once, so that an agent that resumes may write in between. The read half
    /// stays open: closed, it would make the kernel reset the connection when the robot sends
    /// something, and drop what is not delivered yet.
    pub(super) fn write_in_place_of_agent(&mut self, bytes: &[u8], closes: bool) -> bool {
        let alive = self.stream.write(bytes);
        if closes || !self.stream.unsent.is_empty() {
            self.half_close();
        }
        alive
    }

    /// Closes the write half when everything is written.
    pub(super) fn half_close(&mut self) {
        self.stream.closes = true;
        self.stream.flush();
    }

    /// Whether its write half is closed, or will be.
    pub(super) fn is_closing(&self) -> bool {
        self.stream.closes
    }

    /// Ends the connection at once, at the robot too if it is in reach: a robot that believes in it
    /// refuses other logins.
    pub(super) fn reset(&self) {
        // Disconnects whoever else holds the socket. A failure leaves it as it is.
        let _ = connect_unspec(&self.stream.socket);
    }
}

impl AsFd for RobotLink {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.socket.as_fd()
    }
}

/// The number of POWER messages among other bytes.
fn powers_in(bytes: &[u8]) -> u32 {
    let found = bytes.windows(POWER.len()).filter(|part| *part == POWER);
    u32::try_from(found.count()).unwrap_or(u32::MAX)
}

/// A connection that the guardian has opened itself.
#[derive(Debug)]
pub(super) struct DialledLink {
    pub(super) stream: Stream,
    connected: bool,
    decoder: Decoder,
    accepted: bool,
    obeys: bool,
}

impl DialledLink {
    /// Begins to connect, from the port of a former link if that is free.
    pub(super) fn begin(
        address: SocketAddr,
        former: Option<FormerLink>,
    ) -> io::Result<DialledLink> {
        if let Some(former) = former
            && let Ok(socket) = former.open(DEAD_AFTER)
            && let Ok(dialled) = DialledLink::begin_on(socket, former.peer)
        {
            return Ok(dialled);
        }
        DialledLink::begin_on(robot_socket::open(address, DEAD_AFTER)?, address)
    }

    fn begin_on(socket: Socket, address: SocketAddr) -> io::Result<DialledLink> {
        match socket.connect(&address.into()) {
            Ok(()) => {}
            Err(error) if error.raw_os_error() == Some(libc::EINPROGRESS) => {}
            Err(error) => return Err(error),
        }
        Ok(DialledLink {
            stream: Stream::new(socket.into()),
            connected: false,
            decoder: Decoder::new(),
            accepted: false,
            obeys: false,
        })
    }

    pub(super) fn interest(&self) -> PollFlags {
        if self.connected {
            self.stream.interest(true)
        } else {
            PollFlags::OUT
        }
    }

    /// Reads, writes, and returns what has changed.
    pub(super) fn progress(&mut self) -> Vec<DebtEvent> {
        let mut news = Vec::new();
        if !self.connected {
            if !matches!(SockRef::from(&self.stream.socket).take_error(), Ok(None)) {
                return vec![DebtEvent::DialFailed];
            }
            if getpeername(&self.stream.socket).is_err() {
                return news;
            }
            self.connected = true;
            news.push(DebtEvent::Connected);
        }
        let mut powers = 0;
        let mut refusal = None;
        let end = self.stream.read(|chunk| {
            let mut bytes = chunk;
            while let Ok(Some(packet)) = self.decoder.decode(&mut bytes) {
                match Report::parse(packet) {
                    Report::Accepted(_) => {
                        self.accepted = true;
                        news.push(DebtEvent::Accepted);
                    }
                    Report::Refused(why) => refusal = Some(why),
                    Report::Power(_) if self.obeys => powers += 1,
                    Report::Power(_) if self.accepted => {
                        self.obeys = true;
                        news.push(DebtEvent::LoggedIn);
                    }
                    _ => {}
                }
            }
            // Out of step: what is left is not a message.
            bytes.is_empty()
        });
        news.push(DebtEvent::DialledPowers(powers));
        if refusal == Some(Refusal::InUse) {
            news.push(DebtEvent::InUse);
        }
        if refusal.is_some() || end.is_some() || !self.stream.flush() {
            news.push(DebtEvent::DialFailed);
        }
        news
    }
}

impl AsFd for DialledLink {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.stream.socket.as_fd()
    }
}

/// A socket that does not block, with the bytes that it has not accepted yet.
#[derive(Debug)]
pub(super) struct Stream {
    socket: OwnedFd,
    unsent: Vec<u8>,
    /// Close the write half when everything is written.
    closes: bool,
    closed: bool,
}

impl Stream {
    fn new(socket: OwnedFd) -> Stream {
        Stream {
            socket,
            unsent: Vec::new(),
            closes: false,
            closed: false,
        }
    }

    /// Reads what has come; ends at the end of the connection, or when `take` returns `false`.
    fn read(&self, mut take: impl FnMut(&[u8]) -> bool) -> Option<DebtEvent> {
        let mut chunk = [0_u8; CHUNK_LEN];
        for _ in 0..MAX_CHUNKS {
            match recv(&self.socket, &mut chunk[..], RecvFlags::DONTWAIT) {
                Ok((0, _)) => return Some(DebtEvent::LinkClosed),
                Ok((count, _)) if take(&chunk[..count]) => {}
                Ok(_) => return Some(DebtEvent::LinkBroken),
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => return None,
                Err(_) => return Some(DebtEvent::LinkBroken),
            }
        }
        None
    }

    /// Returns whether the connection still works.
    pub(super) fn write(&mut self, bytes: &[u8]) -> bool {
        self.unsent.extend_from_slice(bytes);
        self.flush()
    }

    /// Returns whether the connection still works.
    pub(super) fn flush(&mut self) -> bool {
        while !self.unsent.is_empty() {
            let flags = SendFlags::DONTWAIT | SendFlags::NOSIGNAL;
            match send(&self.socket, &self.unsent, flags) {
                Ok(count) => {
                    self.unsent.drain(..count);
                }
                Err(Errno::INTR) => {}
                Err(Errno::AGAIN) => return true,
                Err(_) => return false,
            }
        }
        if self.closes && !self.closed {
            self.closed = true;
            let _ = shutdown(&self.socket, Shutdown::Write);
        }
        true
    }

    pub(super) fn is_acknowledged(&self) -> bool {
        self.unsent.is_empty() && unacknowledged(&self.socket).is_none_or(|count| count == 0)
    }

    /// What to wait for, besides the end of the connection.
    pub(super) fn interest(&self, reads: bool) -> PollFlags {
        let mut interest = PollFlags::empty();
        interest.set(PollFlags::IN, reads);
        interest.set(PollFlags::OUT, !self.unsent.is_empty());
        interest
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

    fn pair() -> (RobotLink, TcpStream) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (robot, _) = listener.accept().unwrap();
        (RobotLink::new(near.into()), robot)
    }

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
            let mut link = RobotLink::new(near.into());
            assert!(link.write_in_place_of_agent(&vec![7; len], closes));
            while link.stream.interest(false) != PollFlags::empty() {
                assert!(link.stream.flush());
                std::thread::yield_now();
            }
            let mut far = reader.join().unwrap();
            let refused = matches!(rustix::io::write(&link, b"agent"), Err(Errno::PIPE));
            assert_eq!(refused, closed, "{len} bytes, {closes}");
            assert!(far.write_all(b"video").is_ok());
        }
    }

    fn wait_for_first_power(link: &RobotLink) {
        while !link.has_first_power() {
            std::thread::yield_now();
        }
    }

    #[test]
    fn the_battery_level_is_found_behind_video_and_stays_to_be_read() {
        let (mut link, mut robot) = pair();
        assert!(!link.has_first_power());
        robot.write_all(b"PK\x10\x00\x01\x01").unwrap();
        robot.write_all(&[7; 3 * CHUNK_LEN]).unwrap();
        assert!(!link.has_first_power());
        robot.write_all(b"PK\x03\x00\x01\x50").unwrap();
        wait_for_first_power(&link);
        let mut powers = 0;
        while powers == 0 {
            powers += link.read().powers;
        }
        assert_eq!(powers, 1);
        assert!(!link.has_first_power(), "it was read");
    }

    #[test]
    fn battery_levels_are_counted_once_however_they_are_cut() {
        let (mut link, mut robot) = pair();
        let bytes = [
            &b"\x07PKPK\x03\x00\x01\x50"[..],
            b"PK\x03\x00\x01\x03PK\x03\x00",
        ]
        .concat();
        let mut powers = 0;
        for byte in bytes.chunks(1) {
            robot.write_all(byte).unwrap();
            powers += link.read().powers;
        }
        drop(robot);
        let end = loop {
            let received = link.read();
            powers += received.powers;
            if let Some(end) = received.end {
                break end;
            }
        };
        assert_eq!((powers, end), (2, DebtEvent::LinkClosed));
    }

    #[test]
    fn a_reset_reaches_a_robot_that_has_not_taken_everything() {
        let (mut link, mut robot) = pair();
        assert!(link.stream.write(&vec![7; LONG]));
        link.reset();
        robot
            .set_read_timeout(Some(Duration::from_secs(60)))
            .unwrap();
        let error = robot.read_to_end(&mut Vec::new()).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::ConnectionReset);
        assert!(!link.stream.write(b"more"));
    }

    #[test]
    fn a_connection_that_has_ended_is_not_waited_for() {
        let (link, robot) = pair();
        drop(robot);
        wait_for_first_power(&link);
    }
}
