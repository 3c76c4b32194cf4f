//! How many of the written bytes the other side has not acknowledged yet. No crate in use has a
//! safe wrapper for this one query, so this file holds the only unsafe blocks about sockets.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::os::fd::AsFd;

use rustix::ioctl::{Getter, Opcode, ioctl};

/// SIOCOUTQ; on a socket it has the number of TIOCOUTQ.
const QUESTION: Opcode = libc::TIOCOUTQ as Opcode;

/// Bytes written to a TCP socket that the peer's system has not acknowledged, including those that
/// are not sent yet. `None` if the system does not tell. Bytes that the peer's program has not read
/// yet, but its system has acknowledged, are not counted.
pub fn unacknowledged(socket: impl AsFd) -> Option<usize> {
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
    fn data_is_acknowledged_as_long_as_the_peer_has_room() {
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
    fn a_file_that_is_not_a_socket_returns_none() {
        let file = tempfile::tempfile().unwrap();
        assert_eq!(unacknowledged(&file), None);
    }
}
