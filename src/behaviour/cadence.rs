//! When the next frame is due: cameras send them at a pace.

use std::time::Duration;

use tokio::time::Instant;

/// How long before a frame is due its host prepares.
const LEAD: Duration = Duration::from_millis(4);

/// The pace at which frames come.
#[derive(Debug, Default)]
pub(super) struct Cadence {
    last: Option<Instant>,
    period: Option<Duration>,
    next: Option<Instant>,
}

impl Cadence {
    /// A frame has come.
    pub(super) fn came(&mut self, at: Instant) {
        let period = self.last.map(|last| at.saturating_duration_since(last));
        let before = std::mem::replace(&mut self.period, period);
        self.last = Some(at);
        self.next = match (before, period) {
            (Some(before), Some(period)) if before.abs_diff(period) * 4 < period => {
                Some(at + period.saturating_sub(LEAD))
            }
            _ => None,
        };
    }

    /// When to prepare for the next frame, if its time is known.
    pub(super) fn prepare_at(&self) -> Option<Instant> {
        self.next
    }

    /// It is prepared for, or on its way already.
    pub(super) fn prepared(&mut self) {
        self.next = None;
    }
}
