//! Detects hosts that no longer show signs of life.

use std::time::Duration;

use tokio::time::Instant;

/// Extra time, granted once, to a host that was silent for too long: a stall of the whole machine
/// must not end its scripts.
const SILENCE_GRACE: Duration = Duration::from_millis(500);

/// When a running host last sent a message, and how long it may be silent.
#[derive(Debug)]
pub(super) struct Liveness {
    pub(super) limit: Duration,
    /// Time of the last message; `None` until the host runs.
    last_message: Option<Instant>,
    /// End of the extra time, if it was granted.
    grace: Option<Instant>,
}

impl Liveness {
    /// Starts to count at the first call of [`Liveness::reset`].
    pub(super) fn new(limit: Duration) -> Liveness {
        Liveness {
            limit,
            last_message: None,
            grace: None,
        }
    }

    pub(super) fn reset(&mut self) {
        (self.last_message, self.grace) = (Some(Instant::now()), None);
    }

    /// When the silence will have lasted too long.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.grace
            .or(self.last_message.map(|last| last + self.limit))
    }

    /// To be called when the deadline has passed. Returns whether the host must be ended; grants
    /// the extra time the first time.
    pub(super) fn is_over(&mut self) -> bool {
        self.grace.replace(Instant::now() + SILENCE_GRACE).is_some()
    }
}
