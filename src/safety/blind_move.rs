//! One short and slow blind move that the watchdog itself drives, to search for the station from
//! another place: a turn on the spot, or none, then straight ahead or back.

use std::time::Duration;

use tokio::time::Instant;

use crate::robot::Setpoint;

/// A blind move, under way or finished.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BlindMove {
    turns_until: Instant,
    until: Instant,
    back: bool,
}

impl BlindMove {
    /// The power of the tracks in either direction, percent.
    pub const PERCENT: f64 = 30.0;
    /// Duration of a turn: with the usual calibration about 60 degrees, to the left.
    pub const TURN: Duration = Duration::from_millis(950);
    /// Duration of the straight part of the first ones: with the usual calibration about 0.27 m.
    pub const SHORTEST: Duration = Duration::from_secs(2);
    /// Duration of the straight part of the last ones: about 0.54 m.
    pub const LONGEST: Duration = Duration::from_secs(4);

    /// Begins blind move `number`, counted from 0.
    ///
    /// How far a failed search turns the robot is not known, so no pattern is certain to lead
    /// anywhere. Every second one begins with a turn, two moves ahead are followed by two back, and
    /// after every four the straight part is a second longer, up to [`BlindMove::LONGEST`]. Of the
    /// simple patterns compared, this is one of those that left a blind corner most often and that
    /// go farther only after the neighbourhood has been tried.
    pub fn start(number: u32, now: Instant) -> BlindMove {
        let turn = match number % 2 {
            0 => Duration::ZERO,
            _ => BlindMove::TURN,
        };
        let longer = Duration::from_secs((number / 4).into());
        let straight = BlindMove::LONGEST.min(BlindMove::SHORTEST + longer);
        BlindMove {
            turns_until: now + turn,
            until: now + turn + straight,
            back: number % 4 >= 2,
        }
    }

    /// The setpoint of the tracks; `None` once the blind move has ended.
    pub fn setpoint(&self, now: Instant) -> Option<Setpoint> {
        let (left, right) = if now >= self.until {
            return None;
        } else if now < self.turns_until {
            (-1.0, 1.0)
        } else if self.back {
            (-1.0, -1.0)
        } else {
            (1.0, 1.0)
        };
        Setpoint::from_percent(left * BlindMove::PERCENT, right * BlindMove::PERCENT)
    }

    /// The next change of [`BlindMove::setpoint`] after `now`; `None` once the blind move has
    /// ended.
    pub fn next_deadline(&self, now: Instant) -> Option<Instant> {
        let changes = [self.turns_until, self.until];
        changes.into_iter().find(|change| *change > now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);

    /// The setpoints of a blind move, and how long each lasts.
    fn parts(number: u32) -> Vec<((i8, i8), Duration)> {
        let mut now = Instant::now();
        let blind_move = BlindMove::start(number, now);
        let mut parts = Vec::new();
        while let Some(setpoint) = blind_move.setpoint(now) {
            let next = blind_move.next_deadline(now).unwrap();
            parts.push(((setpoint.left.get(), setpoint.right.get()), next - now));
            now = next;
        }
        assert_eq!(blind_move.next_deadline(now), None);
        parts
    }

    #[test]
    fn two_legs_ahead_are_followed_by_two_back_and_every_second_begins_with_a_turn() {
        let turn = (-27, 27);
        let ahead = (27, 27);
        let back = (-27, -27);
        assert_eq!(parts(0), [(ahead, 2000 * MS)]);
        assert_eq!(parts(1), [(turn, 950 * MS), (ahead, 2000 * MS)]);
        assert_eq!(parts(2), [(back, 2000 * MS)]);
        assert_eq!(parts(3), [(turn, 950 * MS), (back, 2000 * MS)]);
    }

    #[test]
    fn later_legs_are_longer_up_to_a_bound() {
        let straight = |number| parts(number).last().unwrap().1;
        let lengths = [0, 3, 4, 7, 8, 11, 12, u32::MAX].map(straight);
        let seconds = [2, 2, 3, 3, 4, 4, 4, 4];
        assert_eq!(lengths, seconds.map(Duration::from_secs));
    }

    proptest! {
        #[test]
        fn no_leg_is_long_or_fast(number in any::<u32>(), later in 0..10_000u32) {
            let now = Instant::now();
            let blind_move = BlindMove::start(number, now);
            let setpoint = blind_move.setpoint(now + later * MS);
            prop_assert_eq!(setpoint.is_none(), now + later * MS >= blind_move.until);
            prop_assert!(blind_move.until <= now + BlindMove::TURN + BlindMove::LONGEST);
            if let Some(Setpoint { left, right }) = setpoint {
                prop_assert!(left.get().abs() == 27 && right.get().abs() == 27);
            }
        }
    }
}
