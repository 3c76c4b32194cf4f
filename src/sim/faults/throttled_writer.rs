//! The output side of one direction of a connection: writes the bytes that are due, at the rate and
//! in the pieces that the active faults require.

use std::time::Duration;

use bytes::Bytes;
use rand::RngExt;
use rand::rngs::StdRng;
use tokio::io::{AsyncWrite, AsyncWriteExt};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep, sleep_until};

use super::fault::{Direction, FaultKind};
use super::scheduler::ActiveFaults;

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

/// How one direction ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// One end has closed or disappeared.
    Closed,
    /// A fault requires a reset of the whole connection.
    Reset,
}

/// Queued output.
pub(crate) enum QueuedWrite {
    /// Bytes to be written when they are due.
    Bytes { due: Instant, bytes: Bytes },
    /// The connection is reset; nothing follows.
    Reset,
}

/// The output side of a direction.
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

    async fn write(
        &mut self,
        to: &mut (impl AsyncWrite + Unpin),
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
