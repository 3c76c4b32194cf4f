//! A TCP connection whose socket detects a dead robot.

use std::io;
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::net::TcpStream;
use tokio::time::timeout;

use super::{LinkError, Options, Target};

/// Keepalive probes before a silent robot is given up. All fit into `dead_after`.
const PROBES: u32 = 3;

/// Connects, and sets the socket's options before a byte is sent.
pub(super) async fn open_tcp(target: &Target, options: &Options) -> Result<TcpStream, LinkError> {
    let connecting = TcpStream::connect((target.host.as_str(), target.port));
    let connected = timeout(options.connect_timeout, connecting).await;
    let unreachable = |source| LinkError::Unreachable {
        target: target.clone(),
        source,
    };
    let stream = connected
        .map_err(|_| LinkError::TimedOut {
            what: "a connection",
            after: options.connect_timeout,
        })?
        .map_err(unreachable)?;
    set_options(&stream, options.dead_after).map_err(unreachable)?;
    Ok(stream)
}

/// Sends small commands without delay; ends the connection after `dead_after` if data stays
/// unacknowledged or a silent robot does not answer the kernel's probes.
fn set_options(stream: &TcpStream, dead_after: Duration) -> io::Result<()> {
    stream.set_nodelay(true)?;
    let probe_interval = (dead_after / PROBES).max(Duration::from_secs(1));
    let keepalive = TcpKeepalive::new()
        .with_time(probe_interval)
        .with_interval(probe_interval)
        .with_retries(PROBES);
    let socket = SockRef::from(stream);
    socket.set_tcp_keepalive(&keepalive)?;
    socket.set_tcp_user_timeout(Some(dead_after))
}

/// Duplicates the socket, for writes outside a runtime.
pub(super) fn duplicate(stream: &TcpStream) -> Option<std::net::TcpStream> {
    SockRef::from(stream).try_clone().ok().map(Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn the_socket_is_set_to_detect_a_dead_robot() {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let target: Target = listener.local_addr().unwrap().to_string().parse().unwrap();
        let stream = open_tcp(&target, &Options::default()).await.unwrap();
        let socket = SockRef::from(&stream);
        assert!(socket.tcp_nodelay().unwrap());
        assert!(socket.keepalive().unwrap());
        assert_eq!(socket.tcp_keepalive_time().unwrap(), Duration::from_secs(1));
        assert_eq!(
            socket.tcp_keepalive_interval().unwrap(),
            Duration::from_secs(1)
        );
        assert_eq!(socket.tcp_keepalive_retries().unwrap(), PROBES);
        assert_eq!(
            socket.tcp_user_timeout().unwrap(),
            Some(Duration::from_secs(3))
        );
    }
}
