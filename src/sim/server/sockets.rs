//! The sockets of a simulator: TCP for clients and UDP for discovery, on one port.

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::{TcpListener, TcpStream, UdpSocket};

use crate::sim::faults::proxy::Breaker;
use crate::wire::discovery;

/// How often a port is tried that is free for TCP and UDP alike.
const PORT_TRIES: usize = 16;
/// A pause after the system could not accept a connection, such as for want of descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// The sockets of a simulator.
pub(super) struct Sockets {
    tcp: Option<TcpListener>,
    udp: Option<UdpSocket>,
    address: SocketAddr,
    discovery: bool,
    /// Closed for a while: the robot reboots.
    hidden: bool,
}

impl Sockets {
    /// No sockets at all; `address` is a name only.
    pub(super) fn none(address: SocketAddr) -> Sockets {
        Sockets {
            tcp: None,
            udp: None,
            address,
            discovery: false,
            hidden: false,
        }
    }

    /// Where clients connect.
    pub(super) fn address(&self) -> SocketAddr {
        self.address
    }

    /// Opens the TCP socket and, if `discovery`, the UDP socket of the same port.
    pub(super) async fn open(listen: SocketAddr, discovery: bool) -> io::Result<Sockets> {
        let tries = if listen.port() == 0 { PORT_TRIES } else { 1 };
        let mut last = None;
        for _ in 0..tries {
            let tcp = TcpListener::bind(listen).await?;
            let address = tcp.local_addr()?;
            if !discovery {
                return Ok(Sockets {
                    tcp: Some(tcp),
                    udp: None,
                    address,
                    discovery,
                    hidden: false,
                });
            }
            match UdpSocket::bind(address).await {
                Ok(udp) => {
                    return Ok(Sockets {
                        tcp: Some(tcp),
                        udp: Some(udp),
                        address,
                        discovery,
                        hidden: false,
                    });
                }
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or_else(|| io::ErrorKind::AddrInUse.into()))
    }

    /// Closes the sockets, or opens them again at the same address; tried again if that fails.
    pub(super) async fn appear(&mut self, visible: bool) {
        if !visible && self.tcp.is_some() {
            (self.tcp, self.udp) = (None, None);
            self.hidden = true;
        }
        if visible && self.hidden {
            match Sockets::open(self.address, self.discovery).await {
                Ok(sockets) => *self = sockets,
                Err(error) => {
                    tracing::warn!(target: "spykee::sim", %error, "cannot listen again yet");
                }
            }
        }
    }

    /// A client, and what resets its connection.
    pub(super) async fn accept(&self) -> (TcpStream, Option<Breaker>) {
        let Some(tcp) = &self.tcp else {
            return std::future::pending().await;
        };
        loop {
            match tcp.accept().await {
                Ok((stream, _)) => {
                    // Nagle's algorithm would delay small reports; without the option the
                    // connection still works.
                    let _ = stream.set_nodelay(true);
                    let socket = socket2::SockRef::from(&stream).try_clone();
                    return (stream, socket.ok().map(Breaker));
                }
                Err(error) => {
                    tracing::warn!(target: "spykee::sim", %error, "cannot accept");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    /// One datagram.
    pub(super) async fn receive(&self, datagram: &mut [u8]) -> Option<(usize, SocketAddr)> {
        let Some(udp) = &self.udp else {
            return std::future::pending().await;
        };
        udp.recv_from(datagram).await.ok()
    }

    /// Answers a datagram that asks who is there.
    pub(super) async fn answer(&self, reply: &discovery::Reply, datagram: &[u8], from: SocketAddr) {
        let Some(udp) = self
            .udp
            .as_ref()
            .filter(|_| discovery::is_request(datagram))
        else {
            return;
        };
        if let Err(error) = udp.send_to(&reply.emit(), from).await {
            tracing::debug!(target: "spykee::sim", %error, "cannot answer a discovery");
        }
    }
}
