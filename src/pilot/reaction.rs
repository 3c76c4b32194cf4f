//! How long it takes from a frame to the track command that a behaviour makes of it. Counted in the
//! pilot, where both pass: a frame that has come notes the time, and the first MOVE after it that a
//! behaviour asked for takes that time off. Counters without a lock: reading them blocks neither
//! the reader nor the pilot.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::time::Instant;

use crate::wire::Command;

/// Upper ends of the buckets, in milliseconds; beyond the last there is one more.
const BOUNDS: [u64; 12] = [1, 2, 4, 6, 10, 15, 25, 50, 100, 200, 500, 1000];

/// How often it took how long. Cheap to clone; all clones are one.
#[derive(Debug, Clone, Default)]
pub struct Reactions(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    buckets: [AtomicU64; BOUNDS.len() + 1],
    micros: AtomicU64,
}

/// All that was counted so far.
#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    /// The upper end of each bucket in seconds, and how many fell into it and into none below; the last
    /// has no end.
    pub buckets: Vec<(f64, u64)>,
    /// Of all together, in seconds.
    pub sum: f64,
    /// Of all together.
    pub count: u64,
}

impl Reactions {
    fn note(&self, took: Duration) {
        let micros = u64::try_from(took.as_micros()).unwrap_or(u64::MAX);
        let bucket = BOUNDS.partition_point(|bound| bound * 1000 < micros);
        self.0.buckets[bucket].fetch_add(1, Ordering::Relaxed);
        self.0.micros.fetch_add(micros, Ordering::Relaxed);
    }

    /// As it is now; what is counted meanwhile may be in a part of it.
    pub fn tally(&self) -> Tally {
        let counts = self
            .0
            .buckets
            .iter()
            .map(|count| count.load(Ordering::Relaxed));
        let ends = BOUNDS.iter().map(|bound| *bound as f64 / 1000.0);
        let buckets: Vec<(f64, u64)> = ends.chain([f64::INFINITY]).zip(counts).collect();
        Tally {
            count: buckets.iter().map(|(_, count)| count).sum(),
            sum: self.0.micros.load(Ordering::Relaxed) as f64 / 1e6,
            buckets,
        }
    }
}

/// The pilot's side.
#[derive(Debug, Default)]
pub(super) struct Stopwatch {
    pub(super) reactions: Reactions,
    /// When the newest frame came that no MOVE has followed yet.
    frame: Option<Instant>,
    /// A behaviour's wish for motion is served just now.
    asked: bool,
}

impl Stopwatch {
    /// A frame is there, its last byte included.
    pub(super) fn frame(&mut self, at: Instant) {
        self.frame = Some(at);
    }

    /// A behaviour's wish for motion is served from now on, or is served.
    pub(super) fn serving(&mut self, asked: bool) {
        self.asked = asked;
    }

    /// These were given to the system.
    pub(super) fn wrote(&mut self, commands: &[Command], now: Instant) {
        let moves = |command: &Command| matches!(command, Command::Move { .. });
        if !self.asked || !commands.iter().any(moves) {
            return;
        }
        if let Some(frame) = self.frame.take() {
            self.reactions.note(now.saturating_duration_since(frame));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GO: Command = Command::Move { left: 9, right: 9 };

    #[test]
    fn the_first_move_that_a_behaviour_asked_for_after_a_frame_counts() {
        let (mut watch, begin) = (Stopwatch::default(), Instant::now());
        let after = |millis| begin + Duration::from_millis(millis);
        watch.serving(true);
        watch.wrote(&[GO], after(0));
        watch.frame(after(1));
        watch.serving(false);
        watch.wrote(&[GO], after(2));
        assert_eq!(
            watch.reactions.tally().count,
            0,
            "a repeated setpoint is no reaction"
        );
        watch.frame(after(10));
        watch.serving(true);
        watch.wrote(&[GO], after(15));
        watch.wrote(&[GO], after(16));
        let tally = watch.reactions.tally();
        assert_eq!(tally.count, 1);
        assert!((tally.sum - 0.005).abs() < 1e-9);
        let filled: Vec<f64> = tally
            .buckets
            .iter()
            .filter(|one| one.1 > 0)
            .map(|one| one.0)
            .collect();
        assert_eq!(filled, [0.006]);
    }

    #[test]
    fn what_takes_very_long_is_in_the_last_bucket() {
        let reactions = Reactions::default();
        reactions.note(Duration::from_secs(5));
        reactions.note(Duration::from_millis(1));
        let tally = reactions.tally();
        assert_eq!((tally.buckets[0].1, tally.buckets[BOUNDS.len()].1), (1, 1));
    }
}
