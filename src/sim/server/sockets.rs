//! The sockets of a simulator: TCP for clients and UDP for discovery, on the same port. A socket
//! bound to a single address receives no broadcasts, so these have separate sockets.

use std::future::poll_fn;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::task::Poll;
use std::time::Duration;

use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::ReadBuf;
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use wire::discovery;

use crate::faults::proxy::Breaker;

/// Number of attempts to find a port that is free for both TCP and UDP.
const PORT_TRIES: usize = 16;
/// Pause after a failure to accept a connection, for example for lack of file descriptors.
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

pub(super) struct Sockets {
    tcp: Option<TcpListener>,
    udp: Option<UdpSocket>,
    /// Sockets for broadcast requests, which are answered from `udp`.
    broadcasts: Vec<UdpSocket>,
    pub(super) address: SocketAddr,
    discovery: bool,
    /// The sockets are closed while the robot reboots.
    hidden: bool,
}

impl Sockets {
    /// Creates an instance without sockets; `address` is only reported.
    pub(super) fn none(address: SocketAddr) -> Sockets {
        Sockets {
            tcp: None,
            udp: None,
            broadcasts: Vec::new(),
            address,
            discovery: false,
            hidden: false,
        }
    }

    /// Opens the TCP socket and, if `discovery`, the UDP socket on the same port.
    pub(super) async fn open(listen: SocketAddr, discovery: bool) -> io::Result<Sockets> {
        let tries = if listen.port() == 0 { PORT_TRIES } else { 1 };
        let mut last = None;
        for _ in 0..tries {
            let tcp = TcpListener::bind(listen).await?;
            let address = tcp.local_addr()?;
            let mut sockets = Sockets {
                tcp: Some(tcp),
                discovery,
                ..Sockets::none(address)
            };
            if !discovery {
                return Ok(sockets);
            }
            match UdpSocket::bind(address).await {
                Ok(udp) => {
                    sockets.udp = Some(udp);
                    sockets.broadcasts = broadcasts(address);
                    return Ok(sockets);
                }
                Err(error) => last = Some(error),
            }
        }
        Err(last.unwrap_or_else(|| io::ErrorKind::AddrInUse.into()))
    }

    /// Closes the sockets, or opens them again at the same address; the next call tries again if
    /// that fails.
    pub(super) async fn set_visible(&mut self, visible: bool) {
        if !visible && self.tcp.is_some() {
            self.tcp = None;
            self.udp = None;
            self.broadcasts.clear();
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

    /// Accepts a client; also returns the breaker that can reset its connection.
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
                    tracing::warn!(target: "spykee::sim", %error, "cannot accept a connection");
                    tokio::time::sleep(ACCEPT_PAUSE).await;
                }
            }
        }
    }

    /// Receives a datagram; `None` on an error.
    pub(super) async fn receive(&self, datagram: &mut [u8]) -> Option<(usize, SocketAddr)> {
        poll_fn(|context| {
            for socket in self.udp.iter().chain(&self.broadcasts) {
                let mut buffer = ReadBuf::new(datagram);
                if let Poll::Ready(from) = socket.poll_recv_from(context, &mut buffer) {
                    return Poll::Ready(from.ok().map(|from| (buffer.filled().len(), from)));
                }
            }
            Poll::Pending
        })
        .await
    }

    pub(super) async fn answer(&self, reply: &discovery::Reply, datagram: &[u8], from: SocketAddr) {
        if let Some(udp) = &self.udp
            && discovery::is_request(datagram)
            && let Err(error) = udp.send_to(&reply.emit(), from).await
        {
            tracing::debug!(target: "spykee::sim", %error, "cannot answer a discovery request");
        }
    }
}

/// Opens sockets for broadcasts to the network of an address. A socket bound to all addresses
/// receives broadcasts anyway.
fn broadcasts(address: SocketAddr) -> Vec<UdpSocket> {
    let IpAddr::V4(own) = address.ip() else {
        return Vec::new();
    };
    let mut sockets = Vec::new();
    for (target, device) in targets(own) {
        match listen(
            SocketAddr::from((target, address.port())),
            device.as_deref(),
        ) {
            Ok(socket) => sockets.push(socket),
            Err(error) => {
                tracing::warn!(target: "spykee::sim", %error, "cannot receive broadcasts to {target}");
            }
        }
    }
    sockets
}

/// Returns the broadcast addresses for the network of an address, each with the interface to bind
/// to if the address alone does not determine it.
fn targets(own: Ipv4Addr) -> Vec<(Ipv4Addr, Option<String>)> {
    if own.is_unspecified() {
        return Vec::new();
    }
    if own.is_loopback() {
        return vec![(Ipv4Addr::new(127, 255, 255, 255), None)];
    }
    let interfaces = if_addrs::get_if_addrs().unwrap_or_default();
    for interface in interfaces {
        if let if_addrs::IfAddr::V4(v4) = interface.addr
            && v4.ip == own
            && let Some(directed) = v4.broadcast
        {
            let all = (Ipv4Addr::BROADCAST, Some(interface.name));
            return vec![(directed, None), all];
        }
    }
    Vec::new()
}

fn listen(address: SocketAddr, device: Option<&str>) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    // Other simulators may listen in the same network.
    socket.set_reuse_address(true)?;
    socket.bind_device(device.map(str::as_bytes))?;
    socket.set_nonblocking(true)?;
    socket.bind(&address.into())?;
    UdpSocket::from_std(socket.into())
}
