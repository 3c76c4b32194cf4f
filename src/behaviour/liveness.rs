//! Whether a host still shows signs of life.

use std::time::Duration;

use tokio::time::Instant;

/// A host that has been silent for too long is waited for once more for so long: a machine that stalls
/// as a whole must not end its scripts.
const SILENCE_GRACE: Duration = Duration::from_millis(500);

/// When a running host was last heard, and for how long it may be silent.
#[derive(Debug)]
pub(super) struct Liveness {
    pub(super) limit: Duration,
    /// Once it runs.
    heard: Option<Instant>,
    /// It is waited for once more.
    grace: Option<Instant>,
}

impl Liveness {
    /// Counts from when it is first heard.
    pub(super) fn new(limit: Duration) -> Liveness {
        Liveness {
            limit,
            heard: None,
            grace: None,
        }
    }

    pub(super) fn heard(&mut self) {
        (self.heard, self.grace) = (Some(Instant::now()), None);
    }

    /// When it has been too long.
    pub(super) fn deadline(&self) -> Option<Instant> {
        self.grace.or(self.heard.map(|heard| heard + self.limit))
    }

    /// The deadline has passed: whether that is the end of the host.
    pub(super) fn is_over(&mut self) -> bool {
        self.grace.replace(Instant::now() + SILENCE_GRACE).is_some()
    }
}
