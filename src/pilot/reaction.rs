//! Measures the time from a frame to the track command that a behaviour derives from it. Counted in
//! the pilot, which handles both: a complete frame sets the start, and the first MOVE after it that
//! a behaviour asked for sets the end. The counters need no lock: reading them blocks neither the
//! reader nor the pilot.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use tokio::time::Instant;

use crate::wire::Command;

/// Upper bounds of the buckets, in milliseconds; one more bucket follows the last.
const BOUNDS: [u64; 12] = [1, 2, 4, 6, 10, 15, 25, 50, 100, 200, 500, 1000];

/// A histogram of reaction times. Cheap to clone; all clones share their counters.
#[derive(Debug, Clone, Default)]
pub struct Reactions(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    buckets: [AtomicU64; BOUNDS.len() + 1],
    micros: AtomicU64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Tally {
    /// The upper bound of each bucket in seconds, and the number of reactions in it but in no lower
    /// one; the last bucket is unbounded.
    pub buckets: Vec<(f64, u64)>,
    pub sum: f64,
    pub count: u64,
}

impl Reactions {
    fn record(&self, took: Duration) {
        let micros = u64::try_from(took.as_micros()).unwrap_or(u64::MAX);
        let bucket = BOUNDS.partition_point(|bound| bound * 1000 < micros);
        self.0.buckets[bucket].fetch_add(1, Ordering::Relaxed);
        self.0.micros.fetch_add(micros, Ordering::Relaxed);
    }

    /// A snapshot; a reaction that is counted meanwhile may be included in part.
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

#[derive(Debug, Default)]
pub(super) struct Stopwatch {
    pub(super) reactions: Reactions,
    /// When the newest frame came that no MOVE has followed yet.
    frame: Option<Instant>,
    asked: bool,
}

impl Stopwatch {
    pub(super) fn frame(&mut self, at: Instant) {
        self.frame = Some(at);
    }

    /// Notes that serving a behaviour's motion request begins or ends.
    pub(super) fn serving(&mut self, asked: bool) {
        self.asked = asked;
    }

    pub(super) fn wrote(&mut self, commands: &[Command], now: Instant) {
        let moves = |command: &Command| matches!(command, Command::Move { .. });
        if !self.asked || !commands.iter().any(moves) {
            return;
        }
        if let Some(frame) = self.frame.take() {
            self.reactions.record(now.saturating_duration_since(frame));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GO: Command = Command::Move { left: 9, right: 9 };

    #[test]
    fn the_first_move_that_a_behaviour_asked_for_after_a_frame_counts() {
        let mut watch = Stopwatch::default();
        let begin = Instant::now();
        let after = |millis| begin + Duration::from_millis(millis);
        watch.serving(true);
        watch.wrote(&[GO], after(0));
        watch.frame(after(1));
        watch.serving(false);
        watch.wrote(&[GO], after(2));
        assert_eq!(
            watch.reactions.tally().count,
            0,
            "a repeated setpoint is not a reaction"
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
    fn a_very_long_reaction_is_in_the_last_bucket() {
        let reactions = Reactions::default();
        reactions.record(Duration::from_secs(5));
        reactions.record(Duration::from_millis(1));
        let tally = reactions.tally();
        assert_eq!((tally.buckets[0].1, tally.buckets[BOUNDS.len()].1), (1, 1));
    }
}
