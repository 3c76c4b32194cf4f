//! How far the tracks can be trusted in turns. On an unknown floor they turn the robot less or more than they are
//! told, always so much or now so and now so. A full turn on the spot, after which the camera sees the same again,
//! tells the first; how far camera and tracks differ from picture to picture tells the second.

/// Of an unknown floor, as standard deviations: radians for each radian that was told.
pub(super) const UNKNOWN: f64 = 0.11;
/// How unsure a full turn leaves it.
const KNOWN: f64 = 0.01;
/// If camera and tracks differ by more than this for long, another floor has come.
const OTHERWISE: f64 = 0.08;
/// More than this is no slip.
const MOST: f64 = 0.4;
/// The spread is never less, nor more; and what is expected of an unknown floor.
const SPREAD: (f64, f64) = (0.03, 0.12);
const EXPECTED: f64 = 0.05;
/// What the camera sees more or less from picture to picture is no slip: a share of the turn.
const SEEN: f64 = 0.05;
/// What earlier pictures told counts so much less with each.
const FADING: f64 = 0.05;
/// The floor may be another one: after so many radians it is as unknown as at first.
const DOUBT: f64 = 60.0;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grip {
    /// Radians of turn for each radian that was told.
    share: f64,
    /// The standard deviation of that.
    unsure: f64,
    /// The mean of what camera and tracks differ by, as a share of the turn, and of its square.
    mean: f64,
    square: f64,
}

impl Default for Grip {
    fn default() -> Grip {
        Grip {
            share: 1.0,
            unsure: UNKNOWN,
            mean: 0.0,
            square: EXPECTED * EXPECTED + SEEN * SEEN,
        }
    }
}

impl Grip {
    /// Radians that the robot turns for each that it is told.
    pub(super) fn share(&self) -> f64 {
        self.share
    }

    /// The standard deviation of a turn, as a share of it.
    pub(super) fn deviation(&self) -> f64 {
        let otherwise = (self.mean.abs() - OTHERWISE).max(0.0);
        self.unsure.hypot(self.spread()) + otherwise
    }

    /// The part of it that is another from one moment to the next.
    fn spread(&self) -> f64 {
        let variance = (self.square - self.mean * self.mean - SEEN * SEEN).max(0.0);
        variance.sqrt().clamp(SPREAD.0, SPREAD.1)
    }

    /// So many radians were turned, either way.
    pub(super) fn fade(&mut self, turned: f64) {
        let variance = self.unsure * self.unsure + UNKNOWN * UNKNOWN * turned / DOUBT;
        self.unsure = variance.sqrt().min(UNKNOWN);
    }

    /// Between two pictures the camera saw this part of the turn more than the tracks made.
    pub(super) fn differ(&mut self, part: f64) {
        let part = part.clamp(-MOST, MOST);
        self.mean += FADING * (part - self.mean);
        self.square += FADING * (part * part - self.square);
    }

    /// A turn that is known, since the camera sees the same again, and what was told; radians.
    pub(super) fn learn(&mut self, told: f64, turned: f64) {
        let share = turned / told;
        if !(1.0 - MOST..=1.0 + MOST).contains(&share) {
            return;
        }
        let gain = self.unsure.powi(2) / (self.unsure.powi(2) + KNOWN * KNOWN);
        self.share += gain * (share - self.share);
        self.unsure *= (1.0 - gain).sqrt();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_full_turn_tells_how_much_turns_come_out_smaller_until_the_floor_may_be_another() {
        let mut grip = Grip::default();
        let unknown = grip.deviation();
        grip.learn(-TAU / 0.9, -TAU);
        assert!((grip.share() - 0.9).abs() < 0.003, "{grip:?}");
        for _ in 0..100 {
            grip.differ(0.05);
        }
        assert!(grip.deviation() < unknown / 3.0, "{grip:?}");
        grip.fade(100.0 * TAU);
        assert!(grip.deviation() > unknown / 2.0, "{grip:?}");
        assert!((grip.share() - 0.9).abs() < 0.003, "{grip:?}");
    }

    #[test]
    fn a_floor_that_is_another_is_noticed() {
        let mut grip = Grip::default();
        grip.learn(TAU, TAU);
        for _ in 0..200 {
            grip.differ(0.02);
        }
        let known = grip.deviation();
        for _ in 0..40 {
            grip.differ(-0.25);
        }
        assert!(grip.deviation() > 3.0 * known, "{grip:?} {known}");
    }

    #[test]
    fn what_is_no_turn_of_the_tracks_teaches_nothing() {
        let mut grip = Grip::default();
        for (told, turned) in [(TAU, 0.1), (0.0, TAU), (TAU, -TAU), (TAU, f64::NAN)] {
            grip.learn(told, turned);
            assert_eq!(grip.share(), 1.0, "{told} {turned}");
        }
    }
}
