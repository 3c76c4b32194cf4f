//! The first POWER of a robot that has accepted a login. If the robot is sent a MOVE before, it
//! disconnects, and may drive on (`PROTOCOL.md`, *Order after login*).

use std::os::fd::OwnedFd;
use std::thread::sleep;
use std::time::Duration;

use rustix::io::Errno;
use rustix::net::{RecvFlags, recv};
use tokio::time::Instant;

use super::dead_man::LOOK;

/// How long to wait for it, as long as an agent does by default; the robot's only connection is held
/// open meanwhile.
const LIMIT: Duration = Duration::from_secs(10);
/// The beginning of a POWER message.
const POWER: [u8; 5] = [b'P', b'K', 3, 0, 1];

/// Waits for it, but for at most [`LIMIT`].
pub(super) fn wait(robot: &OwnedFd) {
    let until = Instant::now() + LIMIT;
    while !has_come(robot) && Instant::now() < until {
        sleep(LOOK);
    }
}

/// Whether it has come, or the connection has ended, so that there is nothing to wait for. Reads
/// nothing away from the agent, which may resume.
pub(super) fn has_come(robot: &OwnedFd) -> bool {
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
    use std::io::Write;
    use std::net::{TcpListener, TcpStream};

    use super::*;

    #[test]
    fn the_battery_level_is_found_and_stays_to_be_read() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (mut robot, _) = listener.accept().unwrap();
        let near = OwnedFd::from(near);
        assert!(!has_come(&near));
        robot.write_all(b"PK\x10\x00\x01\x01").unwrap();
        assert!(!has_come(&near));
        robot.write_all(b"PK\x03\x00\x01\x50").unwrap();
        wait(&near);
        assert!(has_come(&near), "again");
    }

    #[test]
    fn a_connection_that_has_ended_is_not_waited_for() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        drop(listener.accept().unwrap());
        let near = OwnedFd::from(near);
        wait(&near);
        assert!(has_come(&near));
    }
}
