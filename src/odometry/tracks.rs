//! How fast the tracks run: they take time to reach the speed of a command.

use crate::vision::Drive;

/// Acceleration that is assumed of a track, in metres per second squared. That of a real robot was not
/// measured.
pub(crate) const ACCELERATION: f64 = 1.5;

/// The speeds of both tracks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tracks {
    /// Distance between the centre lines, metres.
    width: f64,
    /// Metres per second.
    left: f64,
    right: f64,
}

/// A part of a motion in which each track speeds up, slows down or keeps its speed.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Part {
    pub(super) seconds: f64,
    /// Metres forward.
    pub(super) way: f64,
    /// Radians to the left.
    pub(super) turn: f64,
}

impl Tracks {
    /// Tracks that stand, this many metres apart.
    pub(super) fn new(width: f64) -> Tracks {
        Tracks {
            width,
            left: 0.0,
            right: 0.0,
        }
    }

    /// Records that something has stopped them.
    pub(super) fn stop(&mut self) {
        *self = Tracks::new(self.width);
    }

    /// Runs for some seconds towards the speeds that `wanted` needs.
    pub(super) fn run(&mut self, wanted: Drive, seconds: f64) -> [Part; 3] {
        let swing = wanted.turn * self.width / 2.0;
        let left = wanted.forward - swing;
        let right = wanted.forward + swing;
        let reached = |from: f64, to: f64| ((to - from).abs() / ACCELERATION).min(seconds);
        let one = reached(self.left, left);
        let other = reached(self.right, right);
        let times = [
            one.min(other),
            (one - other).abs(),
            seconds - one.max(other),
        ];
        times.map(|seconds| self.run_evenly(left, right, seconds))
    }

    /// Runs for so many seconds that no track reaches its speed before their end.
    fn run_evenly(&mut self, left: f64, right: f64, seconds: f64) -> Part {
        let most = ACCELERATION * seconds;
        let before = *self;
        self.left += (left - self.left).clamp(-most, most);
        self.right += (right - self.right).clamp(-most, most);
        let left = (before.left + self.left) / 2.0;
        let right = (before.right + self.right) / 2.0;
        Part {
            seconds,
            way: (left + right) / 2.0 * seconds,
            turn: (right - left) / self.width * seconds,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn totals(tracks: &mut Tracks, wanted: Drive, seconds: f64) -> Part {
        let parts = tracks.run(wanted, seconds);
        let add = |sum: Part, part: &Part| Part {
            seconds: sum.seconds + part.seconds,
            way: sum.way + part.way,
            turn: sum.turn + part.turn,
        };
        parts.iter().fold(Part::default(), add)
    }

    #[test]
    fn what_they_lose_when_they_start_they_make_up_when_they_stop() {
        let mut tracks = Tracks::new(0.24);
        let wanted = Drive {
            forward: 0.3,
            turn: 0.5,
        };
        let started = totals(&mut tracks, wanted, 1.0);
        assert!(started.way < 0.29 && started.turn < 0.49, "{started:?}");
        let stopped = totals(&mut tracks, Drive::STILL, 1.0);
        assert!((started.way + stopped.way - 0.3).abs() < 1e-9);
        assert!((started.turn + stopped.turn - 0.5).abs() < 1e-9);
        assert_eq!(
            totals(&mut tracks, Drive::STILL, 1.0),
            Part {
                seconds: 1.0,
                ..Part::default()
            }
        );
    }

    #[test]
    fn a_turn_that_goes_over_into_a_line_turns_farther() {
        let mut tracks = Tracks::new(0.24);
        let turn = Drive {
            forward: 0.0,
            turn: 1.0,
        };
        let line = Drive {
            forward: 0.13,
            turn: 0.0,
        };
        let parts = [(turn, 1.0), (line, 1.0), (Drive::STILL, 1.0)];
        let turned = parts.map(|(wanted, seconds)| totals(&mut tracks, wanted, seconds).turn);
        // The inner track has to turn round: 0.25 m/s at 1.5 m/s2, the outer one only 0.01 m/s.
        assert!(
            (turned.iter().sum::<f64>() - 1.047).abs() < 1e-3,
            "{turned:?}"
        );
    }

    #[test]
    fn many_short_runs_come_to_the_same_as_a_long_one() {
        let wanted = Drive {
            forward: -0.2,
            turn: 1.2,
        };
        let mut tracks = Tracks::new(0.24);
        let long = totals(&mut tracks, wanted, 0.5);
        let mut tracks = Tracks::new(0.24);
        let short: Vec<Part> = (0..50).map(|_| totals(&mut tracks, wanted, 0.01)).collect();
        let sum = |value: fn(&Part) -> f64| short.iter().map(value).sum::<f64>();
        assert!((sum(|part| part.way) - long.way).abs() < 1e-9);
        assert!((sum(|part| part.turn) - long.turn).abs() < 1e-9);
    }
}
