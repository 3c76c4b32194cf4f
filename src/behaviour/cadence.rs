//! When the next frame is due: cameras send them at a pace.
//!
//! Shortly before it is due, a host looks at the last frame once more ([`Script::rehearse`]): code and
//! buffers that have not been used since then have left the processor's caches, and a frame would be
//! answered later. `scripts/bench-reaction` measures it.
//!
//! [`Script::rehearse`]: crate::script::Script::rehearse

use std::time::Duration;

use tokio::time::Instant;

/// How long before a frame is due its host prepares: longer than looking takes and than a camera strays.
const LEAD: Duration = Duration::from_millis(4);
/// Frames that come faster follow each other closely enough.
const SHORTEST: Duration = Duration::from_millis(16);

/// The pace at which frames come.
#[derive(Debug, Default)]
pub(super) struct Cadence {
    last: Option<Instant>,
    period: Option<Duration>,
    prepare_at: Option<Instant>,
}

impl Cadence {
    /// A frame has come.
    pub(super) fn came(&mut self, at: Instant) {
        let period = self.last.map(|last| at.saturating_duration_since(last));
        let before = std::mem::replace(&mut self.period, period);
        self.last = Some(at);
        self.prepare_at = match (before, period) {
            (Some(before), Some(period))
                if period > SHORTEST && before.abs_diff(period) * 4 < period =>
            {
                Some(at + period - LEAD)
            }
            _ => None,
        };
    }

    /// When to prepare for the next frame, if its time is known.
    pub(super) fn prepare_at(&self) -> Option<Instant> {
        self.prepare_at
    }

    /// It is prepared for, or on its way already.
    pub(super) fn prepared(&mut self) {
        self.prepare_at = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(66);

    #[tokio::test(start_paused = true)]
    async fn the_next_frame_of_a_steady_pace_is_prepared_for_once_and_before_it_is_due() {
        let (mut cadence, begin) = (Cadence::default(), Instant::now());
        cadence.came(begin);
        cadence.came(begin + PERIOD);
        assert_eq!(cadence.prepare_at(), None);
        cadence.came(begin + 2 * PERIOD);
        assert_eq!(cadence.prepare_at(), Some(begin + 3 * PERIOD - LEAD));
        cadence.prepared();
        assert_eq!(cadence.prepare_at(), None);
    }

    #[tokio::test(start_paused = true)]
    async fn a_pace_that_changes_and_frames_that_come_at_once_are_not_prepared_for() {
        let (mut cadence, begin) = (Cadence::default(), Instant::now());
        for at in [0, 66, 132] {
            cadence.came(begin + Duration::from_millis(at));
        }
        cadence.came(begin + Duration::from_millis(300));
        assert_eq!(cadence.prepare_at(), None);
        for at in [300, 302, 304] {
            cadence.came(begin + Duration::from_millis(at));
        }
        assert_eq!(cadence.prepare_at(), None);
    }
}
