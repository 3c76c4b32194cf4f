//! One direction of a connection through the proxy: applies the active faults to its bytes.

use std::time::Duration;

use bytes::BytesMut;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, ReadHalf, WriteHalf};
use tokio::sync::{broadcast, mpsc, watch};
use tokio::time::Instant;

use super::fault::{Fault, Towards, Trouble};
use super::mangle::{self, Splitter, Stretch};
use super::outlet::{End, Outlet, Parcel};
use super::troubles::Conditions;
use crate::clock::until;

const READ_LEN: usize = 8 * 1024;
/// Capacity of the queue of reads, more than a delay of seconds needs; when full, the sender waits.
const MAX_WAITING: usize = 256;

/// One direction of a connection.
pub(super) struct Lane {
    towards: Towards,
    conditions: watch::Receiver<Conditions>,
    strikes: broadcast::Receiver<Fault>,
    rng: StdRng,
    splitter: Splitter,
    /// Momentary faults to be applied to the next message.
    aimed: Vec<Trouble>,
    /// Bytes were dropped; nothing is delivered any more.
    swallowed: bool,
    /// How long the sender waits for an acknowledgement of dropped bytes.
    pub(super) unacknowledged: Option<Duration>,
    /// When the sender gives up the connection.
    given_up: Option<Instant>,
    last_due: Instant,
}

impl Lane {
    /// Creates a lane; `seed` determines everything random.
    pub(super) fn new(
        towards: Towards,
        conditions: watch::Receiver<Conditions>,
        strikes: broadcast::Receiver<Fault>,
        seed: u64,
    ) -> Lane {
        Lane {
            towards,
            conditions,
            strikes,
            rng: StdRng::seed_from_u64(seed),
            splitter: Splitter::default(),
            aimed: Vec::new(),
            swallowed: false,
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
        let outlet = Outlet {
            towards: self.towards,
            conditions: self.conditions.clone(),
            rng: StdRng::seed_from_u64(self.rng.random()),
            free: Instant::now(),
        };
        let mut outlet = Box::pin(outlet.run(to, waiting));
        tokio::select! {
            biased;
            end = &mut outlet => end,
            () = self.take_in(&mut from, queue) => outlet.await,
        }
    }

    /// Reads from `from` and queues parcels until the input ends. Queued parcels are still
    /// delivered.
    async fn take_in(&mut self, from: &mut (impl AsyncRead + Unpin), queue: mpsc::Sender<Parcel>) {
        let mut buffer = vec![0; READ_LEN];
        loop {
            let parcels = tokio::select! {
                biased;
                strike = self.strikes.recv() => match strike {
                    Ok(fault) => self.struck(&fault),
                    Err(broadcast::error::RecvError::Lagged(_)) => vec![],
                    Err(broadcast::error::RecvError::Closed) => return,
                },
                () = until(self.given_up) => {
                    send(&queue, vec![Parcel::Reset]).await;
                    return;
                }
                read = from.read(&mut buffer) => match read {
                    Ok(length @ 1..) => self.passed(&buffer[..length]),
                    Ok(0) | Err(_) => {
                        let rest = self.splitter.rest();
                        let parcels = self.load(rest);
                        send(&queue, parcels).await;
                        return;
                    }
                },
            };
            if !send(&queue, parcels).await {
                return;
            }
        }
    }

    fn struck(&mut self, fault: &Fault) -> Vec<Parcel> {
        if !fault.towards.covers(self.towards) {
            return vec![];
        }
        match fault.trouble {
            Trouble::Garbage { bytes } => {
                let bytes = mangle::garbage(bytes, &mut self.rng);
                self.load([Stretch::Raw(bytes)])
            }
            Trouble::Reset if self.towards == Towards::Robot => vec![],
            Trouble::Reset | Trouble::LengthLie { .. } => {
                self.aimed.push(fault.trouble);
                vec![]
            }
            _ => vec![],
        }
    }

    fn passed(&mut self, bytes: &[u8]) -> Vec<Parcel> {
        let stretches = self.splitter.feed(bytes);
        self.load(stretches)
    }

    /// Combines the data of one read into one parcel, unless a reset cuts it off.
    fn load(&mut self, stretches: impl IntoIterator<Item = Stretch>) -> Vec<Parcel> {
        let conditions = self.conditions.borrow_and_update().clone();
        self.swallowed |= conditions.swallow(self.towards);
        if self.swallowed {
            let limit = self.unacknowledged.map(|limit| Instant::now() + limit);
            self.given_up = self.given_up.or(limit);
            return vec![];
        }
        let due = self.due(&conditions);
        let mut bytes = BytesMut::new();
        for stretch in stretches {
            let packet = match stretch {
                Stretch::Raw(raw) => {
                    bytes.extend_from_slice(&raw);
                    continue;
                }
                Stretch::Message(packet) => packet,
            };
            let faults = conditions.towards(self.towards);
            let Some(packet) = mangle::spoil(packet, faults, &mut self.rng) else {
                continue;
            };
            let start = bytes.len();
            packet.emit(&mut bytes);
            if self.strike(&mut bytes, start) {
                let bytes = bytes.freeze();
                return vec![Parcel::Bytes { due, bytes }, Parcel::Reset];
            }
        }
        let bytes = bytes.freeze();
        if bytes.is_empty() {
            vec![]
        } else {
            vec![Parcel::Bytes { due, bytes }]
        }
    }

    /// Applies the pending momentary faults to the message that starts at `start`; returns true if
    /// one of them cuts the message off.
    fn strike(&mut self, bytes: &mut BytesMut, start: usize) -> bool {
        for trouble in std::mem::take(&mut self.aimed) {
            match trouble {
                Trouble::LengthLie { claim } => {
                    mangle::lie(&mut bytes[start..], claim, &mut self.rng)
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
    fn due(&mut self, conditions: &Conditions) -> Instant {
        let mut due = Instant::now();
        for fault in conditions.towards(self.towards) {
            if let Trouble::Delay { by, jitter } = fault.trouble {
                due += by + jitter.mul_f64(self.rng.random_range(0.0..=1.0));
            }
        }
        self.last_due = self.last_due.max(due);
        self.last_due
    }
}

/// Queues the parcels; returns false if the receiver has been dropped.
async fn send(queue: &mpsc::Sender<Parcel>, parcels: Vec<Parcel>) -> bool {
    for parcel in parcels {
        if queue.send(parcel).await.is_err() {
            return false;
        }
    }
    true
}
