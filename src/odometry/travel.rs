//! The history of the tracks' motion: needed because a picture shows what the tracks did when it
//! was taken.

use std::collections::VecDeque;
use std::ops::Sub;
use std::time::Duration;

use tokio::time::Instant;

/// How far back the history goes.
const KEPT: Duration = Duration::from_secs(3);
/// Least time between an entry and the next but one, which bounds the number of entries.
const APART: Duration = Duration::from_millis(10);

/// Sums of the tracks' motion.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Totals {
    /// Radians to the left; turns to the right count as negative.
    pub(super) turn: f64,
    /// Radians to either side.
    pub(super) turned: f64,
    /// Metres, forwards or backwards.
    pub(super) way: f64,
}

/// The sums over time.
#[derive(Debug)]
pub(super) struct Travel {
    /// The oldest first; never empty.
    totals: VecDeque<(Instant, Totals)>,
}

impl Travel {
    /// Creates a history that begins now.
    pub(super) fn new(now: Instant) -> Travel {
        Travel {
            totals: VecDeque::from([(now, Totals::default())]),
        }
    }

    /// Adds the motion since the last entry, at a constant rate until `now`: the turn in radians and
    /// the distance in metres.
    pub(super) fn add(&mut self, now: Instant, turn: f64, way: f64) {
        let last = self.totals.back().map(|(_, totals)| *totals);
        let last = last.unwrap_or_default();
        let sum = Totals {
            turn: last.turn + turn,
            turned: last.turned + turn.abs(),
            way: last.way + way.abs(),
        };
        let count = self.totals.len();
        let close = |(at, _): &(Instant, Totals)| *at + APART > now;
        if count >= 2 && self.totals.get(count - 2).is_some_and(close) {
            self.totals.pop_back();
        }
        self.totals.push_back((now, sum));
        while self.totals.get(1).is_some_and(|(at, _)| *at + KEPT < now) {
            self.totals.pop_front();
        }
    }

    /// The motion between two times; `None` if the first is too long ago.
    pub(super) fn between(&self, from: Instant, to: Instant) -> Option<Totals> {
        Some(self.until(to)? - self.until(from)?)
    }

    fn until(&self, time: Instant) -> Option<Totals> {
        let later = self.totals.partition_point(|(at, _)| *at < time);
        let Some((end, after)) = self.totals.get(later) else {
            return self.totals.back().map(|(_, totals)| *totals);
        };
        if *end == time {
            return Some(*after);
        }
        let (begin, before) = self.totals.get(later.checked_sub(1)?)?;
        let part = (time - *begin).as_secs_f64() / (*end - *begin).as_secs_f64();
        let between = |before: f64, after: f64| before + (after - before) * part;
        Some(Totals {
            turn: between(before.turn, after.turn),
            turned: between(before.turned, after.turned),
            way: between(before.way, after.way),
        })
    }
}

impl Sub for Totals {
    type Output = Totals;

    fn sub(self, before: Totals) -> Totals {
        Totals {
            turn: self.turn - before.turn,
            turned: self.turned - before.turned,
            way: self.way - before.way,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_motion_between_two_times_is_known_for_a_while_in_little_memory() {
        let start = Instant::now();
        let mut travel = Travel::new(start);
        for millis in 1..=10_000 {
            travel.add(start + Duration::from_millis(millis), 0.001, -0.002);
        }
        let at = |millis| start + Duration::from_millis(millis);
        let Some(done) = travel.between(at(9_205), at(9_709)) else {
            panic!("too long ago");
        };
        assert!((done.turn - 0.504).abs() < 1e-6 && (done.way - 1.008).abs() < 1e-6);
        assert_eq!(travel.between(at(5_000), at(9_000)), None);
        assert!(travel.totals.len() < 700, "{}", travel.totals.len());
    }
}
