//! One direction of a connection through the proxy: applies the active faults to its bytes, and
//! writes them when they are due, at the rate and in the pieces that the faults require.

use std::time::Duration;

use bytes::{Bytes, BytesMut};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::{Instant, sleep, sleep_until};

use super::corrupt::{Section, Splitter};
use super::scheduler::{ActiveFaults, FaultFeed};
use super::{Direction, Fault, FaultKind, corrupt};
use crate::clock::until;

const READ_LEN: usize = 8 * 1024;
/// Capacity of the queue of reads, more than a delay of seconds needs; when full, the sender waits.
const MAX_WAITING: usize = 256;

pub(super) struct ProxyDirection {
    towards: Direction,
    active_faults: watch::Receiver<ActiveFaults>,
    beginnings: broadcast::Receiver<Fault>,
    rng: StdRng,
    splitter: Splitter,
    /// Momentary faults to be applied to the next message.
    pending: Vec<FaultKind>,
    /// Bytes were dropped; nothing is delivered any more.
    dropped: bool,
    /// How long the sender waits for an acknowledgement of dropped bytes.
    unacknowledged: Option<Duration>,
    /// When the sender gives up the connection.
    given_up: Option<Instant>,
    last_due: Instant,
}

impl ProxyDirection {
    pub(super) fn new(towards: Direction, feed: FaultFeed) -> ProxyDirection {
        ProxyDirection {
            towards,
            active_faults: feed.active_faults,
            beginnings: feed.beginnings,
            rng: StdRng::seed_from_u64(feed.seed),
            splitter: Splitter::default(),
            pending: Vec::new(),
            dropped: false,
            unacknowledged: feed.unacknowledged,
            given_up: None,
            last_due: Instant::now(),
        }
    }

    /// Forwards bytes until one end closes, or until a fault ends the connection.
    pub(super) async fn run<R: AsyncRead, W: AsyncWrite>(
        mut self,
        mut from: ReadHalf<R>,
        to: WriteHalf<W>,
    ) -> End {
        let (queue, waiting) = mpsc::channel(MAX_WAITING);
        let writer = ThrottledWriter {
            towards: self.towards,
            active_faults: self.active_faults.clone(),
            rng: StdRng::seed_from_u64(self.rng.random()),
            next_write: Instant::now(),
        };
        let mut writer = Box::pin(writer.run(to, waiting));
        tokio::select! {
            biased;
            end = &mut writer => end,
            () = self.read_input(&mut from, queue) => writer.await,
        }
    }

    /// Reads from `from` and queues writes until the input ends. Queued writes are still
    /// delivered.
    async fn read_input<R: AsyncRead + Unpin>(
        &mut self,
        from: &mut R,
        queue: mpsc::Sender<QueuedWrite>,
    ) {
        let mut buffer = vec![0; READ_LEN];
        loop {
            let writes = tokio::select! {
                biased;
                received = self.beginnings.recv() => match received {
                    Ok(fault) => self.on_beginning(&fault),
                    Err(broadcast::error::RecvError::Lagged(_)) => vec![],
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                () = until(self.given_up) => {
                    send(&queue, vec![QueuedWrite::Reset]).await;
                    return;
                }
                read = from.read(&mut buffer) => match read {
                    Ok(length @ 1..) => self.on_bytes(&buffer[..length]),
                    Ok(0) | Err(_) => {
                        let rest = self.splitter.rest();
                        let writes = self.writes_of(rest);
                        send(&queue, writes).await;
                        return;
                    }
                },
            };
            if !send(&queue, writes).await {
                return;
            }
        }
    }

    /// Applies a fault that begins now, if it is momentary; lasting ones are in `active_faults`.
    fn on_beginning(&mut self, fault: &Fault) -> Vec<QueuedWrite> {
        if !fault.towards.covers(self.towards) {
            return vec![];
        }
        match fault.kind {
            FaultKind::Garbage { bytes } => {
                let bytes = corrupt::garbage(bytes, &mut self.rng);
                self.writes_of([Section::Raw(bytes)])
            }
            FaultKind::Reset if self.towards == Direction::Robot => vec![],
            FaultKind::Reset | FaultKind::LengthLie { .. } => {
                self.pending.push(fault.kind);
                vec![]
            }
            _ => vec![],
        }
    }

    fn on_bytes(&mut self, bytes: &[u8]) -> Vec<QueuedWrite> {
        let sections = self.splitter.feed(bytes);
        self.writes_of(sections)
    }

    /// Combines the data of one read into one write, unless a reset cuts it off.
    fn writes_of(&mut self, sections: impl IntoIterator<Item = Section>) -> Vec<QueuedWrite> {
        let active_faults = self.active_faults.borrow_and_update().clone();
        self.dropped |= active_faults.drops_bytes(self.towards);
        if self.dropped {
            let limit = self.unacknowledged.map(|limit| Instant::now() + limit);
            self.given_up = self.given_up.or(limit);
            return vec![];
        }
        let due = self.due(&active_faults);
        let mut bytes = BytesMut::new();
        for section in sections {
            let packet = match section {
                Section::Raw(raw) => {
                    bytes.extend_from_slice(&raw);
                    continue;
                }
                Section::Message(packet) => packet,
            };
            let faults = active_faults.towards(self.towards);
            let Some(packet) = corrupt::corrupt(packet, faults, &mut self.rng) else {
                continue;
            };
            let start = bytes.len();
            packet.emit(&mut bytes);
            if self.apply_pending(&mut bytes, start) {
                let bytes = bytes.freeze();
                return vec![QueuedWrite::Bytes { due, bytes }, QueuedWrite::Reset];
            }
        }
        let bytes = bytes.freeze();
        if bytes.is_empty() {
            vec![]
        } else {
            vec![QueuedWrite::Bytes { due, bytes }]
        }
    }

    /// Applies the pending momentary faults to the message that starts at `start`; returns true if
    /// one of them cuts the message off.
    fn apply_pending(&mut self, bytes: &mut BytesMut, start: usize) -> bool {
        for kind in std::mem::take(&mut self.pending) {
            match kind {
                FaultKind::LengthLie { claim } => {
                    corrupt::falsify_length(&mut bytes[start..], claim, &mut self.rng)
                }
                _ => {
                    bytes.truncate(start + (bytes.len() - start) / 2);
                    return true;
                }
            }
        }
        false
    }

    /// Returns when bytes read now are delivered: never before earlier ones.
    fn due(&mut self, active_faults: &ActiveFaults) -> Instant {
        let mut due = Instant::now();
        for fault in active_faults.towards(self.towards) {
            if let FaultKind::Delay { by, jitter } = fault.kind {
                due += by + jitter.mul_f64(self.rng.random_range(0.0..=1.0));
            }
        }
        self.last_due = self.last_due.max(due);
        self.last_due
    }
}

async fn send(queue: &mpsc::Sender<QueuedWrite>, writes: Vec<QueuedWrite>) -> bool {
    for queued in writes {
        if queue.send(queued).await.is_err() {
            return false;
        }
    }
    true
}

/// Pause between two pieces of a split message; without it the network would join them again.
const PIECE_PAUSE: Duration = Duration::from_millis(1);
/// Maximum length of a piece in bytes, unless `PIECE_SHARE` allows more.
const PIECE: usize = 12;
/// Maximum length of a piece as a fraction of the bytes left: one part in this many.
const PIECE_SHARE: usize = 16;
/// Number of pieces per second when the data rate is limited.
const PIECES_PER_SECOND: u32 = 50;

/// Maximum lateness of a timer. A limited stream catches up on it, to keep its average rate.
const LATE: Duration = Duration::from_millis(2);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// One end has closed or disappeared.
    Closed,
    /// A fault requires a reset of the whole connection.
    Reset,
}

pub(crate) enum QueuedWrite {
    /// Bytes to be written when they are due.
    Bytes { due: Instant, bytes: Bytes },
    /// The connection is reset; nothing follows.
    Reset,
}

pub(crate) struct ThrottledWriter {
    pub(crate) towards: Direction,
    pub(crate) active_faults: watch::Receiver<ActiveFaults>,
    pub(crate) rng: StdRng,
    /// When the next piece of a rate-limited stream may be written.
    pub(crate) next_write: Instant,
}

impl ThrottledWriter {
    /// Runs until the queue is closed, the receiver has disappeared, or a reset is queued.
    pub(crate) async fn run(
        mut self,
        mut to: impl AsyncWrite + Unpin,
        mut waiting: mpsc::Receiver<QueuedWrite>,
    ) -> End {
        while let Some(queued) = waiting.recv().await {
            let QueuedWrite::Bytes { due, bytes } = queued else {
                return End::Reset;
            };
            sleep_until(due).await;
            if self.write(&mut to, bytes).await.is_err() {
                return End::Closed;
            }
        }
        let dropped = self.active_faults.borrow().drops_bytes(self.towards);
        if !dropped {
            let _ = to.shutdown().await;
        }
        End::Closed
    }

    async fn write<W: AsyncWrite + Unpin>(
        &mut self,
        to: &mut W,
        mut bytes: Bytes,
    ) -> std::io::Result<()> {
        while !bytes.is_empty() {
            let (length, pause, drip) = self.piece(bytes.len());
            to.write_all(&bytes.split_to(length)).await?;
            to.flush().await?;
            if !pause.is_zero() {
                sleep(pause).await;
            }
            if !drip.is_zero() {
                let now = Instant::now();
                self.next_write = self.next_write.max(now.checked_sub(LATE).unwrap_or(now)) + drip;
                sleep_until(self.next_write).await;
            }
        }
        Ok(())
    }

    /// Returns how many of the `left` bytes to write now, the pause after them, and the time they
    /// take at the limited rate.
    fn piece(&mut self, left: usize) -> (usize, Duration, Duration) {
        let mut length = left;
        let mut pause = Duration::ZERO;
        let mut slowest = None::<u32>;
        let active_faults = self.active_faults.borrow_and_update().clone();
        for fault in active_faults.towards(self.towards) {
            match fault.kind {
                FaultKind::Split => {
                    let most = PIECE.max(left / PIECE_SHARE).min(length);
                    length = self.rng.random_range(1..=most);
                    pause = pause.max(PIECE_PAUSE);
                }
                FaultKind::Drip { rate } => {
                    length = length.min((rate / PIECES_PER_SECOND).max(1) as usize);
                    slowest = Some(slowest.map_or(rate, |slowest| slowest.min(rate)));
                }
                _ => {}
            }
        }
        let drip = slowest.map_or(Duration::ZERO, |rate| {
            Duration::from_secs_f64(length as f64 / f64::from(rate.max(1)))
        });
        (length, pause, drip)
    }
}
