//! Open pages beside a run: their effect on the reaction time, and the age of the frames that they
//! receive.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bytes::Bytes;

use super::{Delivery, measure, measure_beside};

/// The times at which frames were sent; a frame's number is its position, from 1.
type Sent = Arc<Mutex<Vec<Instant>>>;
type Ages = Arc<Mutex<Vec<Duration>>>;

/// Prints one row for each number of viewers, each after a row of a new measurement without
/// viewers.
pub(crate) fn compare(frames: &[Bytes], numbers: &[usize], spykee: impl Fn() -> Command) {
    println!(
        "{:12} {:>9} {:>9} {:>12} {:>12} {:>12}",
        "viewers", "p50 ms", "p99 ms", "p50 to none", "age p50 ms", "age p95 ms"
    );
    for &number in numbers {
        let alone = measure(frames, Delivery::AtOnce, with_page(spykee(), free()));
        println!(
            "{:12} {:9.2} {:9.2}",
            "none",
            quantile(&alone, 0.5),
            quantile(&alone, 0.99)
        );
        let address = free();
        let sent = Sent::default();
        let ages = Ages::default();
        let look = ages.clone();
        let seen = sent.clone();
        let begin = move || {
            for _ in 0..number {
                let seen = seen.clone();
                let look = look.clone();
                std::thread::spawn(move || view(address, &seen, &look));
            }
            // Gives all viewers time to connect.
            std::thread::sleep(Duration::from_secs(1));
        };
        let command = with_page(spykee(), address);
        let note = |at| sent.lock().unwrap().push(at);
        let beside = measure_beside(frames, Delivery::AtOnce, command, begin, note);
        let ages = ages.lock().unwrap();
        assert!(ages.len() > number * 100, "{} frames have come", ages.len());
        println!(
            "{number:12} {:9.2} {:9.2} {:12.2} {:12.1} {:12.1}",
            quantile(&beside, 0.5),
            quantile(&beside, 0.99),
            quantile(&beside, 0.5) / quantile(&alone, 0.5),
            quantile(&ages, 0.5),
            quantile(&ages, 0.95),
        );
    }
}

fn with_page(mut command: Command, address: SocketAddr) -> Command {
    command.arg(format!("--live={address}"));
    command
}

fn free() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap()
}

fn quantile(times: &[Duration], part: f64) -> f64 {
    let mut sorted = times.to_vec();
    sorted.sort();
    sorted[((sorted.len() - 1) as f64 * part) as usize].as_secs_f64() * 1e3
}

/// Simulates a page that watches the camera until the connection is closed.
fn view(address: SocketAddr, sent: &Sent, ages: &Ages) {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_nodelay(true).unwrap();
    let hello = format!(
        "GET /live HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
         Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    );
    stream.write_all(hello.as_bytes()).unwrap();
    let mut byte = [0];
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).unwrap();
        head.push(byte[0]);
    }
    send(
        &mut stream,
        0x81,
        b"{\"type\":\"watch\",\"camera\":true,\"map\":true,\"log\":true}",
    );
    while let Some((kind, payload)) = receive(&mut stream) {
        match kind {
            2 => {
                let number = u32::from_be_bytes(payload[..4].try_into().unwrap()) as usize;
                let at = number
                    .checked_sub(1)
                    .and_then(|index| sent.lock().unwrap().get(index).copied());
                if let Some(at) = at {
                    ages.lock().unwrap().push(at.elapsed());
                }
                send(&mut stream, 0x81, b"{\"type\":\"frame_shown\"}");
            }
            9 => send(&mut stream, 0x8a, &payload),
            _ => {}
        }
    }
}

/// Sends a short WebSocket message with a zero mask.
fn send(stream: &mut TcpStream, head: u8, payload: &[u8]) {
    let mut frame = vec![head, 0x80 | payload.len() as u8, 0, 0, 0, 0];
    frame.extend(payload);
    let _ = stream.write_all(&frame);
}

/// Receives a WebSocket message: the type and the payload; `None` at the end.
fn receive(stream: &mut TcpStream) -> Option<(u8, Vec<u8>)> {
    let mut head = [0; 2];
    stream.read_exact(&mut head).ok()?;
    let length = match head[1] {
        126 => {
            let mut length = [0; 2];
            stream.read_exact(&mut length).ok()?;
            usize::from(u16::from_be_bytes(length))
        }
        127 => {
            let mut length = [0; 8];
            stream.read_exact(&mut length).ok()?;
            u64::from_be_bytes(length) as usize
        }
        length => usize::from(length),
    };
    let mut payload = vec![0; length];
    stream.read_exact(&mut payload).ok()?;
    Some((head[0] & 0x0f, payload))
}
