//! A minimal browser: requests and a WebSocket, byte by byte, without the server's own library.

use std::collections::HashMap;

use serde_json::Value;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpSocket, TcpStream};
use tokio::time::timeout;

use crate::rig::{Run, WAIT_LIMIT};

/// The address of a run's page.
pub async fn address(run: &Run) -> String {
    const SAID: &str = "the page is at http://";
    run.says(SAID).await;
    let text = run.text();
    let rest = text.split_once(SAID).unwrap().1;
    rest.split('/').next().unwrap().to_owned()
}

/// Status and body of a request; adds `Host` unless `headers` contains one.
pub async fn ask(address: &str, line: &str, headers: &str, body: &str) -> (u16, String) {
    ask_from("127.0.0.1", address, line, headers, body).await
}

/// The same for a request of another computer, whose address is in 127.0.0.0/8.
pub async fn ask_from(
    source: &str,
    address: &str,
    line: &str,
    headers: &str,
    body: &str,
) -> (u16, String) {
    let host = match headers.to_ascii_lowercase().contains("host:") {
        true => String::new(),
        false => format!("Host: {address}\r\n"),
    };
    let request = format!(
        "{line} HTTP/1.1\r\n{host}{headers}Content-Type: application/json\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    let socket = TcpSocket::new_v4().unwrap();
    socket.bind(format!("{source}:0").parse().unwrap()).unwrap();
    let stream = socket.connect(address.parse().unwrap()).await.unwrap();
    let answer = send_on(stream, request.as_bytes()).await;
    let text = String::from_utf8_lossy(&answer).into_owned();
    let status = text
        .split(' ')
        .nth(1)
        .and_then(|code| code.parse().ok())
        .unwrap_or(0);
    let body = text.split_once("\r\n\r\n").map_or("", |(_, body)| body);
    (status, body.to_owned())
}

/// Sends some bytes and returns the complete answer.
pub async fn send(address: &str, bytes: &[u8]) -> Vec<u8> {
    send_on(TcpStream::connect(address).await.unwrap(), bytes).await
}

async fn send_on(mut stream: TcpStream, bytes: &[u8]) -> Vec<u8> {
    let _ = stream.write_all(bytes).await;
    let mut answer = Vec::new();
    let _ = timeout(WAIT_LIMIT, stream.read_to_end(&mut answer))
        .await
        .expect("no answer");
    answer
}

pub async fn get(address: &str, path: &str) -> (u16, String) {
    ask(address, &format!("GET {path}"), "", "").await
}

/// An open page.
pub struct Page {
    stream: TcpStream,
    buffer: Vec<u8>,
    /// The newest message of each kind that arrived while the test waited for another kind.
    aside: HashMap<String, Value>,
}

/// A received message, or the end of the connection.
#[derive(Debug)]
pub enum Received {
    Text(Value),
    /// A frame of the camera.
    Frame(Vec<u8>),
    Closed,
}

impl Page {
    /// Opens a page; returns the status if it is refused.
    pub async fn open(address: &str, headers: &str) -> Result<Page, u16> {
        Page::open_at(address, "/live", headers).await
    }

    /// The same for another path.
    pub async fn open_at(address: &str, path: &str, headers: &str) -> Result<Page, u16> {
        let mut stream = TcpStream::connect(address).await.unwrap();
        let request = format!(
            "GET {path} HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n{headers}\r\n"
        );
        stream.write_all(request.as_bytes()).await.unwrap();
        let mut page = Page {
            stream,
            buffer: Vec::new(),
            aside: HashMap::new(),
        };
        loop {
            if let Some(end) = page.buffer.windows(4).position(|four| four == b"\r\n\r\n") {
                let head = String::from_utf8_lossy(&page.buffer[..end]).into_owned();
                page.buffer.drain(..end + 4);
                let status: u16 = head.split(' ').nth(1).unwrap().parse().unwrap();
                return if status == 101 { Ok(page) } else { Err(status) };
            }
            assert!(page.read().await, "no answer: {:?}", page.buffer);
        }
    }

    async fn read(&mut self) -> bool {
        let mut bytes = [0; 64 * 1024];
        let read = timeout(WAIT_LIMIT, self.stream.read(&mut bytes))
            .await
            .expect("no message");
        let read = read.unwrap_or(0);
        self.buffer.extend_from_slice(&bytes[..read]);
        read > 0
    }

    /// Sends a message; the mask is zero, which is allowed.
    pub async fn send_text(&mut self, message: &str) {
        self.frame(0x81, message.as_bytes()).await;
    }

    pub async fn frame(&mut self, head: u8, payload: &[u8]) {
        let mut frame = vec![head];
        match u16::try_from(payload.len()) {
            Ok(length) if length < 126 => frame.push(0x80 | length as u8),
            Ok(length) => {
                frame.push(0x80 | 126);
                frame.extend(length.to_be_bytes());
            }
            Err(_) => {
                frame.push(0x80 | 127);
                frame.extend((payload.len() as u64).to_be_bytes());
            }
        }
        frame.extend([0; 4]);
        frame.extend(payload);
        self.raw(&frame).await;
    }

    /// Sends bytes unchanged.
    pub async fn raw(&mut self, bytes: &[u8]) {
        let _ = self.stream.write_all(bytes).await;
    }

    /// Waits for the next message; answers pings meanwhile.
    pub async fn receive(&mut self) -> Received {
        loop {
            if let Some((kind, payload)) = self.take() {
                match kind {
                    1 => return Received::Text(serde_json::from_slice(&payload).unwrap()),
                    2 => return Received::Frame(payload),
                    8 => return Received::Closed,
                    9 => self.frame(0x8a, &payload).await,
                    _ => {}
                }
                continue;
            }
            if !self.read().await {
                return Received::Closed;
            }
        }
    }

    /// Takes one WebSocket frame from the buffer, if it is complete.
    fn take(&mut self) -> Option<(u8, Vec<u8>)> {
        let (head, rest) = self.buffer.split_at_checked(2)?;
        let (length, skip) = match head[1] {
            126 => (
                usize::from(u16::from_be_bytes(rest.get(..2)?.try_into().ok()?)),
                4,
            ),
            127 => (
                u64::from_be_bytes(rest.get(..8)?.try_into().ok()?) as usize,
                10,
            ),
            length => (usize::from(length), 2),
        };
        let payload = self.buffer.get(skip..skip + length)?.to_vec();
        let kind = head[0] & 0x0f;
        self.buffer.drain(..skip + length);
        Some((kind, payload))
    }

    /// Waits for a message of this kind that matches. A message that arrived during a wait for
    /// another kind counts if it is the newest of its kind, because the server sends only changes.
    pub async fn until(&mut self, kind: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        if let Some(value) = self.aside.remove(kind)
            && wanted(&value)
        {
            return value;
        }
        let found = async {
            loop {
                match self.receive().await {
                    Received::Text(value) if value["type"] != kind => {
                        let other = value["type"].as_str().unwrap().to_owned();
                        self.aside.insert(other, value);
                    }
                    Received::Text(value) if wanted(&value) => return value,
                    Received::Closed => panic!("closed while waiting for {kind}"),
                    _ => {}
                }
            }
        };
        timeout(WAIT_LIMIT, found)
            .await
            .unwrap_or_else(|_| panic!("no matching {kind}"))
    }

    /// Waits until the server closes the connection.
    pub async fn closed(&mut self) {
        let closed = async { while !matches!(self.receive().await, Received::Closed) {} };
        timeout(WAIT_LIMIT, closed)
            .await
            .expect("the connection is not closed");
    }
}
