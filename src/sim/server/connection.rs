//! One client's connection over any byte stream: decodes commands for the server and writes the
//! queued reports. A client that does not read uses little memory, and gets the newest frame when it
//! reads again.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bytes::Bytes;
use parking_lot::Mutex;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::sync::{Notify, OwnedSemaphorePermit, Semaphore, mpsc, watch};
use tokio::time::{Instant, sleep_until};
use tokio_util::sync::CancellationToken;
use wire::{Command, Decoder, FramingError, Report};

const READ_LEN: usize = 8 * 1024;
/// Minimum time between two messages.
const BETWEEN_WRITES: Duration = Duration::from_millis(3);
/// Time for a client to read a refusal before the connection is closed.
const CLOSE_TIMEOUT: Duration = Duration::from_millis(500);

/// A byte stream to a client: a socket or an in-memory pipe.
pub trait Transport: AsyncRead + AsyncWrite + Send + Unpin + 'static {}

impl<T: AsyncRead + AsyncWrite + Send + Unpin + 'static> Transport for T {}

#[derive(Debug)]
pub(crate) enum Event {
    Commands {
        client: u64,
        write: u64,
        /// AUTH_REPLY and the first POWER had been taken for sending when these bytes arrived.
        opened: bool,
        commands: Vec<Command>,
        /// The place of these commands in a slow robot's queue.
        place: Option<OwnedSemaphorePermit>,
    },
    Gone {
        client: u64,
    },
}

pub(crate) struct Channels {
    pub(crate) client: u64,
    pub(crate) reports: Arc<ReportQueue>,
    pub(crate) events: mpsc::Sender<Event>,
    pub(crate) muted: watch::Receiver<bool>,
    /// Counts the reads of all connections.
    pub(crate) writes: Arc<AtomicU64>,
    /// The free places in the queue of a robot while it executes commands slowly.
    pub(crate) places: watch::Receiver<Option<Arc<Semaphore>>>,
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
    let client = channels.client;
    let _ = channels.events.send(Event::Gone { client }).await;
}

async fn read<R: AsyncRead + Unpin>(
    reader: &mut R,
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
        if channels.pass_on(write, opened, commands).await.is_none() {
            return Ok(());
        }
        end?;
    }
}

/// Decodes the complete commands in `bytes`; also returns the error that ended decoding, if any.
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
async fn write<W: AsyncWrite + Unpin>(writer: &mut W, channels: &Channels) -> std::io::Result<()> {
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
async fn close_orderly<R, W>(reader: &mut R, writer: &mut W)
where
    R: AsyncRead + Unpin,
    W: AsyncWrite + Unpin,
{
    let _ = writer.shutdown().await;
    let mut rest = [0; 1024];
    while let Ok(1..) = reader.read(&mut rest).await {}
}

impl Channels {
    /// Passes the commands of one read to the server: all at once, or, to a robot that executes
    /// them slowly, each as soon as its queue has a place. A login does not wait for a place. Returns
    /// `None` if the server has ended.
    async fn pass_on(&self, write: u64, opened: bool, commands: Vec<Command>) -> Option<()> {
        let places = self.places.borrow().clone();
        let Some(places) = places else {
            return self.send(write, opened, commands, None).await;
        };
        for command in commands {
            let place = if matches!(command, Command::Login(_)) {
                None
            } else {
                Some(places.clone().acquire_owned().await.ok()?)
            };
            self.send(write, opened, vec![command], place).await?;
        }
        Some(())
    }

    async fn send(
        &self,
        write: u64,
        opened: bool,
        commands: Vec<Command>,
        place: Option<OwnedSemaphorePermit>,
    ) -> Option<()> {
        let event = Event::Commands {
            client: self.client,
            write,
            opened,
            commands,
            place,
        };
        self.events.send(event).await.ok()
    }

    async fn unmuted(&self) {
        let mut muted = self.muted.clone();
        // The sender lives as long as the server, whose end also ends this task.
        let _ = muted.wait_for(|muted| !*muted).await;
    }
}

/// Maximum number of queued bytes, frames and audio not counted. A client that requests more
/// without reading is disconnected.
const MAX_QUEUED_BYTES: usize = 256 * 1024;
/// Maximum number of queued audio chunks; older ones are dropped.
const MAX_AUDIO: usize = 8;

/// Progress of the messages that must be sent before a client may drive (`PROTOCOL.md`, *Order
/// after login*).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Handshake {
    #[default]
    Waiting,
    Accepted,
    Done,
}

#[derive(Debug, Default)]
struct Queue {
    messages: VecDeque<(Handshake, Bytes)>,
    length: usize,
    audio: VecDeque<Bytes>,
    frame: Option<Bytes>,
    dropped: u64,
    handshake: Handshake,
    closing: bool,
}

#[derive(Debug, Default)]
pub(crate) struct ReportQueue {
    queue: Mutex<Queue>,
    changed: Notify,
}

impl ReportQueue {
    /// Queues a report. A frame replaces a queued frame. Returns false if the client does not read
    /// the reports that it requested.
    pub(crate) fn push(&self, report: &Report) -> bool {
        let mut queue = self.queue.lock();
        match report {
            Report::Video(_) => queue.put_frame(report.to_bytes()),
            Report::Audio(_) => queue.put_audio(report.to_bytes()),
            Report::Accepted(_) => queue.put_message(Handshake::Accepted, report.to_bytes()),
            Report::Power(_) => queue.put_message(Handshake::Done, report.to_bytes()),
            _ => queue.put_message(Handshake::Waiting, report.to_bytes()),
        }
        self.changed.notify_one();
        queue.length <= MAX_QUEUED_BYTES
    }

    /// Closes the connection after everything has been written.
    pub(crate) fn close(&self) {
        self.queue.lock().closing = true;
        self.changed.notify_one();
    }

    /// Whether AUTH_REPLY and the first POWER after it have been taken from the queue.
    pub(crate) fn opened(&self) -> bool {
        self.queue.lock().handshake == Handshake::Done
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.queue.lock().dropped
    }

    /// Waits for the next message to write; `None` when the connection must be closed.
    pub(crate) async fn next(&self) -> Option<Bytes> {
        loop {
            let changed = self.changed.notified();
            match self.queue.lock().take() {
                (Some(message), _) => return Some(message),
                (None, true) => return None,
                (None, false) => {}
            }
            changed.await;
        }
    }
}

impl Queue {
    fn put_frame(&mut self, bytes: Bytes) {
        self.dropped += u64::from(self.frame.is_some());
        self.frame = Some(bytes);
    }

    fn put_audio(&mut self, bytes: Bytes) {
        if self.audio.len() == MAX_AUDIO {
            self.audio.pop_front();
            self.dropped += 1;
        }
        self.audio.push_back(bytes);
    }

    fn put_message(&mut self, handshake: Handshake, bytes: Bytes) {
        self.length += bytes.len();
        self.messages.push_back((handshake, bytes));
    }

    /// Takes the next message, audio and frames last; also returns whether the queue is closing.
    fn take(&mut self) -> (Option<Bytes>, bool) {
        let stream = |queue: &mut Queue| {
            let sound = queue.audio.pop_front();
            sound.or_else(|| queue.frame.take())
        };
        let Some((handshake, bytes)) = self.messages.pop_front() else {
            return (stream(self), self.closing);
        };
        self.length -= bytes.len();
        self.handshake = match (self.handshake, handshake) {
            (Handshake::Waiting, Handshake::Accepted) => Handshake::Accepted,
            (Handshake::Accepted, Handshake::Done) => Handshake::Done,
            (before, _) => before,
        };
        (Some(bytes), self.closing)
    }
}

#[cfg(test)]
mod tests {
    use wire::{Accepted, Power};

    use super::*;

    fn frame(byte: u8) -> Report {
        Report::Video(Bytes::from(vec![byte; 100]))
    }

    fn power() -> Report {
        Report::Power(Power {
            percent: 50,
            charging: false,
        })
    }

    #[tokio::test]
    async fn only_the_newest_frame_is_queued_and_messages_go_first() {
        let reports = ReportQueue::default();
        for report in [frame(1), frame(2), power(), frame(3)] {
            reports.push(&report);
        }
        assert_eq!(reports.next().await.unwrap(), power().to_bytes());
        assert_eq!(reports.next().await.unwrap(), frame(3).to_bytes());
        assert_eq!(reports.dropped(), 2);
    }

    #[tokio::test]
    async fn queued_reports_are_written_before_the_end() {
        let reports = ReportQueue::default();
        reports.push(&power());
        reports.close();
        assert_eq!(reports.next().await.unwrap(), power().to_bytes());
        assert_eq!(reports.next().await, None);
    }

    #[tokio::test]
    async fn driving_is_allowed_after_the_reply_and_then_a_power() {
        let accepted = Accepted {
            uid: "S".into(),
            name: String::new(),
            place: String::new(),
            firmware: String::new(),
            docked: false,
            tail: Bytes::new(),
        };
        let reports = ReportQueue::default();
        reports.push(&power());
        reports.push(&Report::Accepted(accepted));
        reports.next().await.unwrap();
        reports.next().await.unwrap();
        assert!(!reports.opened());
        reports.push(&power());
        assert!(!reports.opened());
        reports.next().await.unwrap();
        assert!(reports.opened());
    }

    #[test]
    fn only_messages_overflow_the_queue_of_a_client_that_never_reads() {
        let reports = ReportQueue::default();
        for _ in 0..10_000 {
            reports.push(&frame(0));
            assert!(reports.push(&Report::Audio(Bytes::from(vec![0; 1600]))));
        }
        let log = Report::Log(Bytes::from(vec![b'x'; 60_000]));
        assert!((0..10).any(|_| !reports.push(&log)));
    }
}
