//! The agent's messages to the guardian, and the guardian's answers, one datagram each.

use std::io::{self, IoSlice, IoSliceMut};
use std::mem::MaybeUninit;
use std::net::SocketAddr;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

use rustix::io::Errno;
use rustix::net::{
    RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SendAncillaryBuffer,
    SendAncillaryMessage, SendFlags, recvmsg, sendmsg,
};
use serde::{Deserialize, Serialize};

/// The longest message: last words of some bytes, and the rest of a partly written message.
pub(super) const MAX_MESSAGE_LEN: usize = 128 * 1024;

#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct LastWordsData {
    /// The rest of a partly written message. Must come first, or the framing breaks.
    pub(super) rest: Vec<u8>,
    /// Whole messages; none if the robot is best left alone.
    pub(super) last: Vec<u8>,
}

/// How to reach the robot again, and log in.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Route {
    pub address: SocketAddr,
    /// The bytes of the AUTH_REQUEST message.
    pub login: Vec<u8>,
}

/// Without the login, which holds a password.
impl std::fmt::Debug for Route {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Route {{ {} }}", self.address)
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) enum GuardianMessage {
    /// A link is open; its socket is sent along with this message.
    Watch(LastWordsData),
    /// The robot has accepted a login, but obeys only after its first POWER; the socket is sent
    /// along with this message.
    Login(LastWordsData),
    LastWords(LastWordsData),
    Route(Route),
    /// Whether a stop is owed: the robot may drive until a stop is executed.
    Debt(bool),
    /// The driving core is alive; the answer: so is the guardian.
    Heartbeat,
    /// The link is closed; nothing is left to write.
    Release,
    /// From the guardian: it has written to the robot, because the driving core was silent.
    Wrote,
    /// From the guardian: a person has told it to stop the robot.
    Stopped,
}

#[derive(Debug)]
pub(super) enum Datagram {
    /// A message, with the socket that was sent along.
    Message(GuardianMessage, Option<OwnedFd>),
    Nothing,
    End,
}

impl GuardianMessage {
    /// Never blocks; fails with `WouldBlock` if the guardian does not read.
    pub(super) fn send(&self, to: impl AsFd, socket: Option<BorrowedFd<'_>>) -> io::Result<()> {
        let bytes = postcard::to_allocvec(self).map_err(io::Error::other)?;
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut ancillary = SendAncillaryBuffer::new(&mut space);
        let sockets = socket.map(|socket| [socket]);
        if let Some(sockets) = &sockets {
            ancillary.push(SendAncillaryMessage::ScmRights(sockets));
        }
        let flags = SendFlags::DONTWAIT | SendFlags::NOSIGNAL;
        sendmsg(to, &[IoSlice::new(&bytes)], &mut ancillary, flags)?;
        Ok(())
    }

    /// Never blocks; fails if the datagram is not a message.
    pub(super) fn receive(from: impl AsFd, buffer: &mut [u8]) -> io::Result<Datagram> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut ancillary = RecvAncillaryBuffer::new(&mut space);
        let flags = RecvFlags::DONTWAIT | RecvFlags::CMSG_CLOEXEC;
        let mut receive = || recvmsg(&from, &mut [IoSliceMut::new(buffer)], &mut ancillary, flags);
        let mut received = receive();
        // The sender ended without having read all answers. The kernel reports that once, before
        // the messages that it left.
        if matches!(received, Err(Errno::CONNRESET)) {
            received = receive();
        }
        let count = match received {
            Ok(message) if message.bytes == 0 => return Ok(Datagram::End),
            Ok(message) => message.bytes,
            Err(Errno::AGAIN | Errno::INTR) => return Ok(Datagram::Nothing),
            Err(Errno::CONNRESET) => return Ok(Datagram::End),
            Err(error) => return Err(error.into()),
        };
        let socket = ancillary.drain().find_map(|message| match message {
            RecvAncillaryMessage::ScmRights(mut sockets) => sockets.next(),
            _ => None,
        });
        let message = postcard::from_bytes(&buffer[..count]).map_err(io::Error::other)?;
        Ok(Datagram::Message(message, socket))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair};
    use std::io::{Read, Write};

    fn pair() -> (OwnedFd, OwnedFd) {
        let flags = SocketFlags::CLOEXEC;
        socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None).unwrap()
    }

    /// The kernel reports the end of such a sender before the messages that it left.
    #[test]
    fn notes_are_received_after_the_end_of_a_sender_that_has_not_read_its_answers() {
        let (ours, theirs) = pair();
        let words = LastWordsData {
            rest: vec![],
            last: vec![1, 2, 3],
        };
        let message = GuardianMessage::LastWords(words);
        GuardianMessage::Heartbeat.send(&theirs, None).unwrap();
        message.send(&ours, None).unwrap();
        drop(ours);
        let mut buffer = vec![0; MAX_MESSAGE_LEN];
        let received = GuardianMessage::receive(&theirs, &mut buffer).unwrap();
        assert!(matches!(received, Datagram::Message(received, None) if received == message));
        let end = GuardianMessage::receive(&theirs, &mut buffer).unwrap();
        assert!(matches!(end, Datagram::End));
    }

    #[test]
    fn a_socket_is_received_with_its_note() {
        let (ours, theirs) = pair();
        let (mut near, far) = std::os::unix::net::UnixStream::pair().unwrap();
        let words = LastWordsData {
            rest: vec![1],
            last: vec![2, 3],
        };
        let message = GuardianMessage::Watch(words);
        message.send(&ours, Some(far.as_fd())).unwrap();
        GuardianMessage::Heartbeat.send(&ours, None).unwrap();
        drop((ours, far));
        let mut buffer = vec![0; MAX_MESSAGE_LEN];
        let Ok(Datagram::Message(received, Some(socket))) =
            GuardianMessage::receive(&theirs, &mut buffer)
        else {
            panic!("no socket")
        };
        assert_eq!(received, message);
        std::os::unix::net::UnixStream::from(socket)
            .write_all(b"stop")
            .unwrap();
        let mut heard = String::new();
        near.read_to_string(&mut heard).unwrap();
        assert_eq!(heard, "stop");
        let heartbeat = GuardianMessage::receive(&theirs, &mut buffer).unwrap();
        assert!(matches!(
            heartbeat,
            Datagram::Message(GuardianMessage::Heartbeat, None)
        ));
        let end = GuardianMessage::receive(&theirs, &mut buffer).unwrap();
        assert!(matches!(end, Datagram::End));
    }

    proptest! {
        #[test]
        fn random_bytes_do_not_panic(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = postcard::from_bytes::<GuardianMessage>(&bytes);
        }
    }
}
