//! The far end of one direction of a connection: writes what is due, as slowly and in as many
//! pieces as the faults of the moment say.

use std::time::Duration;

use bytes::Bytes;
use rand::RngExt;
use rand::rngs::StdRng;
use tokio::io::{AsyncWrite, AsyncWriteExt};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep, sleep_until};

use super::fault::{Towards, Trouble};
use super::troubles::Conditions;

/// Between two pieces of a message that is cut: else the network puts them together again.
const PIECE_PAUSE: Duration = Duration::from_millis(1);
/// A message is cut into pieces of up to so many bytes, or of up to this part of it.
const PIECE: usize = 12;
const PIECE_SHARE: usize = 16;
/// A trickle is written in so many pieces a second.
const SIPS: u32 = 50;

/// A timer comes so late at most: a trickle makes up for it, or it would be slower than its rate.
const LATE: Duration = Duration::from_millis(2);

/// How one direction has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum End {
    /// One end has closed, or has gone.
    Closed,
    /// A fault wants the whole connection reset.
    Reset,
}

/// What is on its way.
pub(crate) enum Parcel {
    /// To be written when it is due.
    Bytes { due: Instant, bytes: Bytes },
    /// Nothing more: the connection is reset.
    Reset,
}

/// The far end of a direction: writes what is due, as fast as the faults let it.
pub(crate) struct Outlet {
    pub(crate) towards: Towards,
    pub(crate) conditions: watch::Receiver<Conditions>,
    pub(crate) rng: StdRng,
    /// A trickle goes on then.
    pub(crate) free: Instant,
}

impl Outlet {
    /// Runs until the queue is closed, the receiver has gone, or a reset comes.
    pub(crate) async fn run(
        mut self,
        mut to: impl AsyncWrite + Unpin,
        mut waiting: mpsc::Receiver<Parcel>,
    ) -> End {
        while let Some(parcel) = waiting.recv().await {
            let Parcel::Bytes { due, bytes } = parcel else {
                return End::Reset;
            };
            sleep_until(due).await;
            if self.write(&mut to, bytes).await.is_err() {
                return End::Closed;
            }
        }
        let swallowed = self.conditions.borrow().swallow(self.towards);
        if !swallowed {
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
                self.free = self.free.max(now.checked_sub(LATE).unwrap_or(now)) + drip;
                sleep_until(self.free).await;
            }
        }
        Ok(())
    }

    /// How much of what is left goes out now, the pause after it, and how long that takes in a
    /// trickle.
    fn piece(&mut self, left: usize) -> (usize, Duration, Duration) {
        let (mut length, mut pause, mut slowest) = (left, Duration::ZERO, None::<u32>);
        let conditions = self.conditions.borrow_and_update().clone();
        for fault in conditions.towards(self.towards) {
            match fault.trouble {
                Trouble::Split => {
                    let most = PIECE.max(left / PIECE_SHARE).min(length);
                    length = self.rng.random_range(1..=most);
                    pause = pause.max(PIECE_PAUSE);
                }
                Trouble::Drip { rate } => {
                    length = length.min((rate / SIPS).max(1) as usize);
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
