//! What the system knows of a connection: how many of the written bytes the other side has not
//! acknowledged yet, and how long a byte takes there and back. No crate in use has safe wrappers for
//! these queries, so this file holds the only unsafe blocks about sockets.
#![allow(unsafe_code)]

use std::ffi::c_int;
use std::mem::MaybeUninit;
use std::os::fd::{AsFd, AsRawFd};
use std::time::Duration;

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

/// The smoothed time that the network needs there and back, as TCP measures it. `None` if the system
/// does not tell.
pub fn round_trip(socket: impl AsFd) -> Option<Duration> {
    let mut info = MaybeUninit::<libc::tcp_info>::zeroed();
    let mut size = libc::socklen_t::try_from(size_of::<libc::tcp_info>()).ok()?;
    // SAFETY: the system writes at most `size` bytes to `info`, and their number to `size`.
    let failed = unsafe {
        libc::getsockopt(
            socket.as_fd().as_raw_fd(),
            libc::IPPROTO_TCP,
            libc::TCP_INFO,
            info.as_mut_ptr().cast(),
            &raw mut size,
        )
    };
    if failed != 0 {
        return None;
    }
    // SAFETY: all fields are integers, so that zeros are valid values where nothing was written.
    let info = unsafe { info.assume_init() };
    Some(Duration::from_micros(info.tcpi_rtt.into()))
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
        assert!(round_trip(&near).unwrap() < Duration::from_secs(60));
        near.set_nonblocking(true).unwrap();
        while near.write(&[7; 65_536]).is_ok() {}
        assert!(unacknowledged(&near).unwrap() > 0);
    }

    #[test]
    fn a_file_that_is_not_a_socket_returns_none() {
        let file = tempfile::tempfile().unwrap();
        assert_eq!(unacknowledged(&file), None);
        assert_eq!(round_trip(&file), None);
    }
}
