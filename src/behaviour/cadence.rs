//! Predicts when the next frame is due: cameras send frames at a steady rate.
//!
//! Shortly before that time, a host whose script examines frames processes the last one once more
//! ([`Script::warm_up`]) and sends a sign of life, which wakes the driving core: code and buffers
//! that have not been used since the last frame have left the processor's caches, which would delay
//! the reaction to the next one. `scripts/bench-reaction` measures this.
//!
//! [`Script::warm_up`]: crate::script::Script::warm_up

use std::time::Duration;

use tokio::time::Instant;

/// How long before a frame is due its host prepares, at least: not so long that the processor sleeps
/// deeply again before the frame arrives. On a slow computer it is twice as long as the last
/// preparation took: a frame must not wait for it.
const LEAD: Duration = Duration::from_millis(3);
/// At this period and below, the caches stay warm and no preparation is needed.
const SHORTEST: Duration = Duration::from_millis(16);

/// The frame rate, measured from the arrival times.
#[derive(Debug, Default)]
pub(super) struct Cadence {
    last: Option<Instant>,
    period: Option<Duration>,
    prepare_at: Option<Instant>,
    /// How long the last preparation took.
    took: Duration,
}

impl Cadence {
    /// Records the arrival of a frame.
    pub(super) fn record_arrival(&mut self, at: Instant) {
        let period = self.last.map(|last| at.saturating_duration_since(last));
        let before = std::mem::replace(&mut self.period, period);
        self.last = Some(at);
        self.prepare_at = match (before, period) {
            (Some(before), Some(period))
                if period > SHORTEST && before.abs_diff(period) * 4 < period =>
            {
                self.lead(period).map(|lead| at + period - lead)
            }
            _ => None,
        };
    }

    /// How long before a frame to prepare for it; `None` if that takes too much of the period.
    fn lead(&mut self, period: Duration) -> Option<Duration> {
        let lead = LEAD.max(self.took.saturating_mul(2));
        let is_short = lead < period / 2;
        if !is_short {
            // Tried again after some frames: the computer may have been busy.
            self.took /= 2;
        }
        is_short.then_some(lead)
    }

    /// When to prepare for the next frame; `None` if its time is unknown.
    pub(super) fn prepare_at(&self) -> Option<Instant> {
        self.prepare_at
    }

    /// Cancels the preparation: the frame is already arriving.
    pub(super) fn cancel_preparation(&mut self) {
        self.prepare_at = None;
    }

    /// The preparation is done and took this long.
    pub(super) fn record_preparation(&mut self, took: Duration) {
        self.prepare_at = None;
        self.took = took;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Duration = Duration::from_millis(66);

    #[tokio::test(start_paused = true)]
    async fn with_a_steady_rate_each_frame_is_prepared_for_once_before_it_is_due() {
        let (mut cadence, begin) = (Cadence::default(), Instant::now());
        cadence.record_arrival(begin);
        cadence.record_arrival(begin + PERIOD);
        assert_eq!(cadence.prepare_at(), None);
        cadence.record_arrival(begin + 2 * PERIOD);
        assert_eq!(cadence.prepare_at(), Some(begin + 3 * PERIOD - LEAD));
        cadence.cancel_preparation();
        assert_eq!(cadence.prepare_at(), None);
    }

    #[tokio::test(start_paused = true)]
    async fn a_slow_preparation_begins_earlier_and_a_very_slow_one_is_left_out_for_some_frames() {
        let (mut cadence, begin) = (Cadence::default(), Instant::now());
        cadence.record_arrival(begin);
        cadence.record_arrival(begin + PERIOD);
        for (count, took, lead) in [
            (2_u32, Some(1), Some(3)),
            (3, Some(10), Some(20)),
            (4, Some(40), None),
            (5, None, None),
            (6, None, Some(20)),
        ] {
            if let Some(took) = took {
                cadence.record_preparation(Duration::from_millis(took));
            }
            cadence.record_arrival(begin + count * PERIOD);
            let due = begin + (count + 1) * PERIOD;
            let lead = lead.map(Duration::from_millis);
            assert_eq!(cadence.prepare_at(), lead.map(|lead| due - lead), "{count}");
        }
    }

    #[tokio::test(start_paused = true)]
    async fn no_preparation_for_an_unsteady_rate_or_closely_spaced_frames() {
        let (mut cadence, begin) = (Cadence::default(), Instant::now());
        for at in [0, 66, 132] {
            cadence.record_arrival(begin + Duration::from_millis(at));
        }
        cadence.record_arrival(begin + Duration::from_millis(300));
        assert_eq!(cadence.prepare_at(), None);
        for at in [300, 302, 304] {
            cadence.record_arrival(begin + Duration::from_millis(at));
        }
        assert_eq!(cadence.prepare_at(), None);
    }
}
