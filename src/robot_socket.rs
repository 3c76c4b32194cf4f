//! The TCP socket of a connection to the robot, as the agent and its guardian open it.

use std::io;
use std::net::SocketAddr;
use std::os::fd::AsFd;
use std::time::Duration;

use socket2::{Domain, Protocol, SockRef, Socket, TcpKeepalive, Type};

/// Keepalive probes before a silent robot is given up. From three seconds on, all fit into
/// `dead_after`.
const PROBES: u32 = 3;
const MIN_PROBE_INTERVAL: Duration = Duration::from_secs(1);

/// The addresses of a link that was lost. A robot that has not noticed believes in it and refuses
/// other logins, until its system repeats something. A request for a connection from the same port
/// makes both systems find out at once (RFC 9293, *half-open connections*).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FormerLink {
    local: SocketAddr,
    pub peer: SocketAddr,
}

impl FormerLink {
    /// The link of this socket. `None` if the socket has no address any more.
    pub fn new(socket: &impl AsFd, peer: SocketAddr) -> Option<FormerLink> {
        let local = SockRef::from(socket).local_addr().ok()?.as_socket()?;
        Some(FormerLink { local, peer })
    }

    /// A socket like that of [`open`], with the port of this link: connecting it to the robot resets
    /// the link there, or succeeds if the robot has forgotten it.
    pub fn open(self, dead_after: Duration) -> io::Result<Socket> {
        let socket = open(self.peer, dead_after)?;
        socket.set_reuse_address(true)?;
        socket.bind(&self.local.into())?;
        Ok(socket)
    }
}

/// A socket with its options, to be connected to this address; it does not block.
pub fn open(peer: SocketAddr, dead_after: Duration) -> io::Result<Socket> {
    let domain = Domain::for_address(peer);
    let socket = Socket::new(domain, Type::STREAM, Some(Protocol::TCP))?;
    socket.set_nonblocking(true)?;
    set_options(&socket, dead_after)?;
    Ok(socket)
}

/// Sends small commands without delay; ends the connection after `dead_after` if data stays
/// unacknowledged or a silent robot does not answer the kernel's probes.
pub fn set_options(socket: &impl AsFd, dead_after: Duration) -> io::Result<()> {
    let probe_interval = (dead_after / PROBES).max(MIN_PROBE_INTERVAL);
    let keepalive = TcpKeepalive::new()
        .with_time(probe_interval)
        .with_interval(probe_interval)
        .with_retries(PROBES);
    let socket = SockRef::from(socket);
    socket.set_tcp_nodelay(true)?;
    socket.set_tcp_keepalive(&keepalive)?;
    socket.set_tcp_user_timeout(Some(dead_after))
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    const DEAD_AFTER: Duration = Duration::from_secs(3);

    #[test]
    fn the_socket_is_set_to_detect_a_dead_robot() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let socket = open(listener.local_addr().unwrap(), DEAD_AFTER).unwrap();
        let interval = Duration::from_secs(1);
        assert!(socket.nonblocking().unwrap());
        assert!(socket.tcp_nodelay().unwrap());
        assert!(socket.keepalive().unwrap());
        assert_eq!(socket.tcp_keepalive_time().unwrap(), interval);
        assert_eq!(socket.tcp_keepalive_interval().unwrap(), interval);
        assert_eq!(socket.tcp_keepalive_retries().unwrap(), PROBES);
        assert_eq!(socket.tcp_user_timeout().unwrap(), Some(DEAD_AFTER));
    }

    #[test]
    fn a_former_link_is_taken_up_from_its_port_unless_that_is_in_use() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let peer = listener.local_addr().unwrap();
        // An address of its own: no other test takes its port while that is free.
        let stream = Socket::new(Domain::IPV4, Type::STREAM, None).unwrap();
        let own = SocketAddr::from(([127, 11, 4, 7], 0));
        stream.bind(&own.into()).unwrap();
        stream.connect(&peer.into()).unwrap();
        let former = FormerLink::new(&stream, peer).unwrap();
        let connect = || {
            let socket = former.open(DEAD_AFTER)?;
            socket.set_nonblocking(false)?;
            socket.connect(&peer.into())?;
            Ok::<_, io::Error>(socket)
        };
        connect().expect_err("it is still open");
        // A reset leaves the port free at once.
        stream.set_linger(Some(Duration::ZERO)).unwrap();
        drop(stream);
        let again = connect().unwrap().local_addr().unwrap();
        assert_eq!(again.as_socket(), Some(former.local));
    }
}
