//! Finds robots: one question to every network of this computer (`PROTOCOL.md`, *Discovery
//! datagrams*).

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

use serde::Serialize;
use tokio::net::UdpSocket;
use tokio::time::{Instant, sleep_until};

use crate::clock::every;
use crate::wire::PORT;
use crate::wire::discovery::{MAX_REPLY_LEN, REQUEST, Reply};

/// Datagrams get lost: the question is repeated at this interval.
const REPEAT: Duration = Duration::from_millis(400);
/// More robots than any room holds; limits a flood of forged replies.
const MAX_FOUND: usize = 256;
/// The robot's own network (`PROTOCOL.md`, *Network*).
const ROBOT_NETWORK: Ipv4Addr = Ipv4Addr::new(172, 17, 6, 255);

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Found {
    /// The address of its reply; its TCP port has the same number.
    pub addr: SocketAddr,
    /// Such as `SPYKEE0001`.
    pub uid: String,
    pub connected_user: Option<String>,
}

/// Asks every network of this computer, this computer itself (a simulator), and `extra`, and
/// listens until `timeout` is over. Sorted by address; each robot appears once per address.
/// Fails if no datagram socket can be created. A network that cannot be asked is not an error.
pub async fn discover(timeout: Duration, extra: &[SocketAddr]) -> io::Result<Vec<Found>> {
    let targets = [&broadcast_targets(), extra].concat();
    ask(&targets, timeout).await
}

/// Every broadcast address of this computer, the robot's own network, and loopback.
pub fn broadcast_targets() -> Vec<SocketAddr> {
    let interfaces = if_addrs::get_if_addrs().unwrap_or_default();
    let broadcasts = interfaces
        .iter()
        .filter_map(|interface| match &interface.addr {
            if_addrs::IfAddr::V4(v4) => v4.broadcast,
            if_addrs::IfAddr::V6(_) => None,
        });
    let always = [Ipv4Addr::BROADCAST, ROBOT_NETWORK, Ipv4Addr::LOCALHOST];
    let mut targets: Vec<Ipv4Addr> = broadcasts.chain(always).collect();
    targets.sort_unstable();
    targets.dedup();
    targets
        .into_iter()
        .map(|ip| SocketAddr::from((ip, PORT)))
        .collect()
}

/// Asks only `targets`, and listens until `timeout` is over. IPv6 targets are asked only if all
/// targets are IPv6.
pub async fn ask(targets: &[SocketAddr], timeout: Duration) -> io::Result<Vec<Found>> {
    let mut found = BTreeMap::new();
    let listen = |reply: Found| {
        let key = (reply.addr, reply.uid.clone());
        if found.len() < MAX_FOUND || found.contains_key(&key) {
            found.insert(key, reply);
        }
        false
    };
    question(targets, timeout, listen).await?;
    Ok(found.into_values().collect())
}

/// The user connected to the robot at `addr`, if it answers within `timeout`.
pub(super) async fn connected_user(addr: SocketAddr, timeout: Duration) -> Option<String> {
    let mut user = None;
    let listen = |reply: Found| {
        let is_it = reply.addr.ip() == addr.ip();
        if is_it {
            user = reply.connected_user;
        }
        is_it
    };
    question(&[addr], timeout, listen).await.ok()?;
    user
}

/// Repeats the question and passes each reply to `enough` until that returns true or time is over.
async fn question(
    targets: &[SocketAddr],
    timeout: Duration,
    mut enough: impl FnMut(Found) -> bool,
) -> io::Result<()> {
    let end = Instant::now() + timeout;
    let socket = socket_for(targets).await?;
    let mut ticker = every(REPEAT);
    loop {
        tokio::select! {
            biased;
            () = sleep_until(end) => return Ok(()),
            _ = ticker.tick() => send_all(&socket, targets).await,
            reply = receive(&socket) => {
                if reply.is_some_and(&mut enough) {
                    return Ok(());
                }
            }
        }
    }
}

async fn socket_for(targets: &[SocketAddr]) -> io::Result<UdpSocket> {
    let only_v6 = !targets.is_empty() && targets.iter().all(SocketAddr::is_ipv6);
    let any: IpAddr = if only_v6 {
        Ipv6Addr::UNSPECIFIED.into()
    } else {
        Ipv4Addr::UNSPECIFIED.into()
    };
    let socket = UdpSocket::bind((any, 0)).await?;
    socket.set_broadcast(true)?;
    Ok(socket)
}

/// A network that is down or refuses broadcasts must not keep the others from being asked.
async fn send_all(socket: &UdpSocket, targets: &[SocketAddr]) {
    for target in targets {
        if let Err(error) = socket.send_to(&REQUEST, target).await {
            tracing::debug!(%target, %error, "cannot ask this network for robots");
        }
    }
}

/// Receives one datagram; `None` if it is not a reply, such as our own request. An error comes from
/// an earlier send to a closed port.
async fn receive(socket: &UdpSocket) -> Option<Found> {
    let mut datagram = [0; MAX_REPLY_LEN];
    let (length, addr) = socket.recv_from(&mut datagram).await.ok()?;
    let Reply {
        uid,
        connected_user,
    } = Reply::parse(&datagram[..length])?;
    Some(Found {
        addr,
        uid,
        connected_user,
    })
}
