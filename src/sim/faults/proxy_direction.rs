//! One direction of a connection through the proxy: applies the active faults to its bytes.

use std::time::Duration;

use bytes::BytesMut;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, ReadHalf, WriteHalf};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::Instant;

use super::corrupt::{self, Section, Splitter};
use super::fault::{Direction, Fault, FaultKind};
use super::scheduler::ActiveFaults;
use super::throttled_writer::{End, QueuedWrite, ThrottledWriter};
use crate::clock::until;

const READ_LEN: usize = 8 * 1024;
/// Capacity of the queue of reads, more than a delay of seconds needs; when full, the sender waits.
const MAX_WAITING: usize = 256;

/// One direction of a connection.
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
    pub(super) unacknowledged: Option<Duration>,
    /// When the sender gives up the connection.
    given_up: Option<Instant>,
    last_due: Instant,
}

impl ProxyDirection {
    /// Creates it; `seed` determines everything random.
    pub(super) fn new(
        towards: Direction,
        active_faults: watch::Receiver<ActiveFaults>,
        beginnings: broadcast::Receiver<Fault>,
        seed: u64,
    ) -> ProxyDirection {
        ProxyDirection {
            towards,
            active_faults,
            beginnings,
            rng: StdRng::seed_from_u64(seed),
            splitter: Splitter::default(),
            pending: Vec::new(),
            dropped: false,
            unacknowledged: None,
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
    async fn read_input(
        &mut self,
        from: &mut (impl AsyncRead + Unpin),
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

/// Queues the writes; returns false if the receiver has been dropped.
async fn send(queue: &mpsc::Sender<QueuedWrite>, writes: Vec<QueuedWrite>) -> bool {
    for queued in writes {
        if queue.send(queued).await.is_err() {
            return false;
        }
    }
    true
}
