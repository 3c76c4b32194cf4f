//! One client's connection over any byte stream: decodes commands for the server and writes the
//! queued reports.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;

use crate::wire::{Command, Decoder, FramingError};

use super::report_queue::ReportQueue;

const READ_LEN: usize = 8 * 1024;
/// Minimum time between two messages.
const BETWEEN_WRITES: Duration = Duration::from_millis(3);
/// Time for a client to read a refusal before the connection is closed.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(500);

/// A byte stream to a client: a socket or an in-memory pipe.
pub trait Transport: AsyncRead + AsyncWrite + Send + Unpin + 'static {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin + 'static> Transport for T {}

/// An event that a connection sends to the server.
#[derive(Debug)]
pub(crate) enum Event {
    /// The commands of one read.
    Commands {
        client: u64,
        write: u64,
        /// AUTH_REPLY and the first POWER had been taken for sending when these bytes arrived.
        opened: bool,
        commands: Vec<Command>,
    },
    /// The connection has ended.
    Gone { client: u64 },
}

/// A connection's channels to the server.
pub(crate) struct Channels {
    pub(crate) client: u64,
    pub(crate) reports: Arc<ReportQueue>,
    pub(crate) events: mpsc::Sender<Event>,
    pub(crate) muted: watch::Receiver<bool>,
    /// Counts the reads of all connections.
    pub(crate) writes: Arc<AtomicU64>,
    pub(crate) cut: CancellationToken,
}

/// Serves a client until one side ends the connection.
pub(crate) async fn serve(transport: impl Transport, channels: Channels) {
    let (mut reader, mut writer) = tokio::io::split(transport);
    let refused = tokio::select! {
        biased;
        () = channels.cut.cancelled() => false,
        end = read(&mut reader, &channels) => {
            if let Err(error) = end {
                tracing::debug!(target: "spykee::sim", client = channels.client, %error, "garbage");
            }
            false
        }
        end = write(&mut writer, &channels) => end.is_ok(),
    };
    if refused {
        let _ = tokio::time::timeout(CLOSE_TIMEOUT, close_orderly(&mut reader, &mut writer)).await;
    }
    let _ = channels
        .events
        .send(Event::Gone {
            client: channels.client,
        })
        .await;
}

async fn read(
    reader: &mut (impl AsyncRead + Unpin),
    channels: &Channels,
) -> Result<(), FramingError> {
    let mut decoder = Decoder::new();
    let mut buffer = vec![0; READ_LEN];
    loop {
        channels.unmuted().await;
        let Ok(length @ 1..) = reader.read(&mut buffer).await else {
            return Ok(());
        };
        let opened = channels.reports.opened();
        channels.unmuted().await;
        let write = channels.writes.fetch_add(1, Ordering::Relaxed);
        let (commands, end) = decode_all(&mut decoder, &buffer[..length]);
        let event = Event::Commands {
            client: channels.client,
            write,
            opened,
            commands,
        };
        if channels.events.send(event).await.is_err() {
            return Ok(());
        }
        end?;
    }
}

/// Decodes the complete commands in `bytes`; returns them with the error that ended decoding, if
/// any.
fn decode_all(decoder: &mut Decoder, mut bytes: &[u8]) -> (Vec<Command>, Result<(), FramingError>) {
    let mut commands = Vec::new();
    loop {
        match decoder.decode(&mut bytes) {
            Ok(Some(packet)) => commands.push(Command::parse(packet)),
            Ok(None) => return (commands, Ok(())),
            Err(error) => return (commands, Err(error)),
        }
    }
}

/// Writes one message at a time with a pause in between, so that a client with one read per message
/// can keep up. Returns `Ok` when the report queue is closed.
async fn write(writer: &mut (impl AsyncWrite + Unpin), channels: &Channels) -> std::io::Result<()> {
    let mut rested = Instant::now();
    loop {
        channels.unmuted().await;
        sleep_until(rested).await;
        let Some(bytes) = channels.reports.next().await else {
            return Ok(());
        };
        channels.unmuted().await;
        writer.write_all(&bytes).await?;
        writer.flush().await?;
        rested = Instant::now() + BETWEEN_WRITES;
    }
}

/// Shuts down writing, then reads until the client closes: closing a socket with unread bytes would
/// send RST, which discards the last message.
async fn close_orderly(
    reader: &mut (impl AsyncRead + Unpin),
    writer: &mut (impl AsyncWrite + Unpin),
) {
    let _ = writer.shutdown().await;
    let mut rest = [0; 1024];
    while let Ok(1..) = reader.read(&mut rest).await {}
}

impl Channels {
    /// Waits while the robot is muted.
    async fn unmuted(&self) {
        let mut muted = self.muted.clone();
        // The sender lives as long as the server, whose end also ends this task.
        let _ = muted.wait_for(|muted| !*muted).await;
    }
}
