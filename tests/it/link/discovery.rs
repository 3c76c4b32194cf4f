//! Discovery: robots on loopback that answer as `PROTOCOL.md` says, and peers that do not.

use super::*;
use spykee::link::discover;

/// Answers every datagram with each of `replies`, forever.
async fn answering(replies: &'static [&'static [u8]]) -> SocketAddr {
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let addr = socket.local_addr().unwrap();
    tokio::spawn(async move {
        let mut datagram = [0; 64];
        loop {
            let (_, from) = socket.recv_from(&mut datagram).await.unwrap();
            for reply in replies {
                socket.send_to(reply, from).await.unwrap();
            }
        }
    });
    addr
}

#[tokio::test]
async fn robots_are_listed_once_and_garbage_is_ignored() {
    let free = answering(&[
        b"DSCV\x01",
        b"",
        b"HELLO",
        b"DSCV\x02\x0Euid=SPYKEE0001",
        b"DSCV\x02\x0Euid=SPYKEE0001",
    ]);
    let busy = answering(&[b"DSCV\x02\x23uid=SPYKEE0002,connected-user=berta"]);
    let free = free.await;
    let busy = busy.await;
    let nobody = SocketAddr::from(([127, 0, 0, 1], 9));
    // Long enough for three requests, and a stall of the machine.
    let found = discover::ask(&[nobody, free, busy], Duration::from_secs(4))
        .await
        .unwrap();
    let mut uids: Vec<_> = found.iter().map(|robot| robot.uid.as_str()).collect();
    uids.sort_unstable();
    assert_eq!(uids, ["SPYKEE0001", "SPYKEE0002"]);
    let robot = found.iter().find(|robot| robot.addr == busy).unwrap();
    assert_eq!(robot.connected_user.as_deref(), Some("berta"));
}

#[tokio::test]
async fn a_lost_request_is_repeated() {
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let addr = socket.local_addr().unwrap();
    tokio::spawn(async move {
        let mut datagram = [0; 64];
        socket.recv_from(&mut datagram).await.unwrap();
        let (_, from) = socket.recv_from(&mut datagram).await.unwrap();
        socket
            .send_to(b"DSCV\x02\x0Euid=SPYKEE0001", from)
            .await
            .unwrap();
    });
    let found = discover::ask(&[addr], Duration::from_secs(4))
        .await
        .unwrap();
    assert_eq!(found.len(), 1);
}

#[tokio::test]
async fn without_a_robot_the_list_is_empty_after_the_timeout() {
    let found = discover::ask(&[], Duration::from_millis(50)).await.unwrap();
    assert_eq!(found, []);
}

#[tokio::test]
async fn robots_at_ipv6_addresses_receive_requests_too() {
    let Ok(socket) = UdpSocket::bind("[::1]:0").await else {
        return;
    };
    let addr = socket.local_addr().unwrap();
    tokio::spawn(async move {
        let mut datagram = [0; 64];
        let (_, from) = socket.recv_from(&mut datagram).await.unwrap();
        socket
            .send_to(b"DSCV\x02\x0Euid=SPYKEE0001", from)
            .await
            .unwrap();
    });
    let found = discover::ask(&[addr], Duration::from_secs(3))
        .await
        .unwrap();
    assert_eq!(found.len(), 1);
}

#[test]
fn the_robots_own_network_and_local_simulators_always_receive_requests() {
    let targets: Vec<String> = discover::broadcast_targets()
        .iter()
        .map(ToString::to_string)
        .collect();
    for target in [
        "172.17.6.255:9000",
        "255.255.255.255:9000",
        "127.0.0.1:9000",
    ] {
        assert!(targets.iter().any(|each| each == target), "{targets:?}");
    }
}
