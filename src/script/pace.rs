//! How often tasks may be resumed without time passing.

use std::time::Duration;

use tokio::time::Instant;

/// The shortest wait: shorter ones would let a script spin without time passing.
pub(super) const SHORTEST_WAIT: Duration = Duration::from_millis(1);

/// How often one task may be resumed within [`SHORTEST_WAIT`] before it must wait.
const MAX_RESUMPTIONS: u32 = 64;

/// How often a task was resumed within the current [`SHORTEST_WAIT`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    since: Instant,
    count: u32,
}

impl Pace {
    pub(super) fn new(now: Instant) -> Pace {
        Pace {
            since: now,
            count: 0,
        }
    }

    /// Counts a resumption; `true` if there were too many.
    pub(super) fn is_too_fast(&mut self, now: Instant) -> bool {
        if now.saturating_duration_since(self.since) >= SHORTEST_WAIT {
            *self = Pace::new(now);
        }
        self.count += 1;
        self.count > MAX_RESUMPTIONS
    }
}
