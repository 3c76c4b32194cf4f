//! The simulated robot answers, times and cuts its messages as genuine ones do: facts that clients which
//! speak to real robots rely on.

use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex};
use std::task::{Context, Poll};
use std::time::Duration;

use spykee::sim::{Options, Server};
use tokio::io::{AsyncRead, AsyncWrite, DuplexStream, ReadBuf};
use tokio::net::UdpSocket;
use tokio::time::timeout;

use super::sim::*;

/// A pipe that keeps the robot's writes apart.
struct Noted {
    pipe: DuplexStream,
    writes: Arc<Mutex<Vec<Vec<u8>>>>,
}

impl AsyncRead for Noted {
    fn poll_read(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_read(context, buffer)
    }
}

impl AsyncWrite for Noted {
    fn poll_write(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.pipe).poll_write(context, bytes);
        if let Poll::Ready(Ok(length)) = written {
            self.writes.lock().unwrap().push(bytes[..length].to_vec());
        }
        written
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_flush(context)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.pipe).poll_shutdown(context)
    }
}

#[tokio::test(start_paused = true)]
async fn each_message_is_a_write_of_its_own() {
    let handle = detached(playpen(), spykee::sim::Firmware::default());
    let (stream, pipe) = tokio::io::duplex(64 * 1024);
    let writes = Arc::<Mutex<Vec<Vec<u8>>>>::default();
    handle.connect(Noted {
        pipe,
        writes: writes.clone(),
    });
    let mut client = Client { stream }.log_in().await;
    client.send(&[VIDEO_ON, AUDIO_ON].concat()).await;
    client.send(b"PK\x0D\x00\x00PK\x11\x00\x00").await;
    for _ in 0..200 {
        client.next().await.unwrap();
    }
    let writes = writes.lock().unwrap();
    for bytes in writes.iter() {
        let length = usize::from(bytes[3]) << 8 | usize::from(bytes[4]);
        assert_eq!((&bytes[..2], bytes.len()), (&b"PK"[..], 5 + length));
    }
    assert!(writes.len() >= 200, "{}", writes.len());
}

#[tokio::test(start_paused = true)]
async fn the_microphone_sends_an_eighth_of_a_second_at_uneven_times() {
    let (handle, mut client) = robot(playpen()).await;
    client.send(AUDIO_ON).await;
    let (mut usual, mut gaps, mut last) = (0, Vec::new(), handle.state().time);
    for _ in 0..100 {
        let message = client.next_of_kind(1).await;
        usual += usize::from(message.len() == 5 + 4000);
        let now = handle.state().time;
        gaps.push(now - last);
        last = now;
    }
    assert!(
        (70..100).contains(&usual),
        "{usual} of 100 have 2,000 samples"
    );
    gaps.sort_unstable();
    gaps.dedup();
    assert!(gaps.len() > 4, "{gaps:?}");
}

#[tokio::test]
async fn one_address_answers_broadcasts_to_its_network_too() {
    let server = Server::bind(playpen(), Options::default()).await.unwrap();
    let address = server.local_addr();
    tokio::spawn(server.run());
    let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    socket.set_broadcast(true).unwrap();
    let mut reply = [0; 64];
    for _ in 0..50 {
        let target = ("127.255.255.255", address.port());
        socket.send_to(b"DSCV\x01", target).await.unwrap();
        let answer = timeout(Duration::from_millis(200), socket.recv_from(&mut reply)).await;
        if let Ok(Ok((length, from))) = answer {
            assert_eq!(from, address, "answered from where clients connect");
            assert_eq!(&reply[..length], b"DSCV\x02\x0Euid=SPYKEE0001");
            return;
        }
    }
    panic!("not answered");
}
