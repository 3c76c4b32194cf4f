//! How much of what was written the other side has not acknowledged yet. No safe wrapper of this one
//! question is in the crates that we have, so this file holds the only unsafe blocks of the link.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::os::fd::AsFd;

use rustix::ioctl::{Getter, Opcode, ioctl};

/// SIOCOUTQ; for a socket it has the number of TIOCOUTQ.
const QUESTION: Opcode = libc::TIOCOUTQ as Opcode;

/// Bytes written to a TCP socket that its peer's system has not acknowledged, those that are not
/// sent yet included. `None` if the system does not tell. What the peer's program has not read yet
/// is not among them.
pub(super) fn unacknowledged(socket: impl AsFd) -> Option<usize> {
    // SAFETY: Linux answers SIOCOUTQ with one int (tcp(7)), which is what the getter has room for.
    let getter = unsafe { Getter::<QUESTION, c_int>::new() };
    // SAFETY: the getter's opcode only writes that int and changes nothing else.
    let answer = unsafe { ioctl(socket, getter) }.ok()?;
    usize::try_from(answer).ok()
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::{TcpListener, TcpStream};

    use super::*;

    #[test]
    fn what_the_peer_has_taken_is_acknowledged_and_what_it_has_no_room_for_is_not() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (mut far, _) = listener.accept().unwrap();
        near.write_all(&[7; 100]).unwrap();
        far.read_exact(&mut [0; 100]).unwrap();
        while unacknowledged(&near) != Some(0) {
            std::thread::yield_now();
        }
        near.set_nonblocking(true).unwrap();
        while near.write(&[7; 65_536]).is_ok() {}
        assert!(unacknowledged(&near).unwrap() > 0);
    }

    #[test]
    fn what_is_no_socket_gives_no_answer() {
        let file = tempfile::tempfile().unwrap();
        assert_eq!(unacknowledged(&file), None);
    }
}
