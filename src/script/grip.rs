//! How far the tracks can be trusted in turns. On an unknown floor they turn the robot less or more
//! than commanded, by a constant share and by a share that varies from moment to moment. A full
//! turn on the spot, after which the camera sees the same view again, measures the constant share;
//! the differences between camera and tracks from picture to picture measure the varying one.

/// Uncertainty on an unknown floor, as a standard deviation in radians per commanded radian.
pub(super) const UNKNOWN: f64 = 0.11;
/// Uncertainty that remains after a full turn.
const KNOWN: f64 = 0.01;
/// If camera and tracks differ by more than this for long, the floor has changed.
const OTHERWISE: f64 = 0.08;
/// A larger difference is not slip.
const MOST: f64 = 0.4;
/// The least and the largest spread; and the spread expected on an unknown floor.
const SPREAD: (f64, f64) = (0.03, 0.12);
const EXPECTED: f64 = 0.05;
/// Error of the camera from picture to picture, which is not slip, as a share of the turn.
const SEEN: f64 = 0.05;
/// With each picture the weight of the earlier ones decreases by this share.
const FADING: f64 = 0.05;
/// The floor may change: after this many radians it is as unknown as at first.
const DOUBT: f64 = 60.0;

/// See the module documentation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grip {
    /// Radians of real turn per commanded radian.
    share: f64,
    /// The standard deviation of `share`.
    unsure: f64,
    /// The mean of the difference between camera and tracks, as a share of the turn, and the mean
    /// of its square.
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
    /// Radians that the robot turns per commanded radian.
    pub(super) fn share(&self) -> f64 {
        self.share
    }

    /// The standard deviation of a turn, as a share of it.
    pub(super) fn deviation(&self) -> f64 {
        let otherwise = (self.mean.abs() - OTHERWISE).max(0.0);
        self.unsure.hypot(self.spread()) + otherwise
    }

    /// The part of the deviation that varies from moment to moment.
    fn spread(&self) -> f64 {
        let variance = (self.square - self.mean * self.mean - SEEN * SEEN).max(0.0);
        variance.sqrt().clamp(SPREAD.0, SPREAD.1)
    }

    /// Increases the uncertainty after a turn of this many radians, to either side.
    pub(super) fn fade(&mut self, turned: f64) {
        let variance = self.unsure * self.unsure + UNKNOWN * UNKNOWN * turned / DOUBT;
        self.unsure = variance.sqrt().min(UNKNOWN);
    }

    /// Records by what share of the turn the camera saw more than the tracks made, between two
    /// pictures.
    pub(super) fn differ(&mut self, part: f64) {
        let part = part.clamp(-MOST, MOST);
        self.mean += FADING * (part - self.mean);
        self.square += FADING * (part * part - self.square);
    }

    /// Learns from a full turn: the commanded turn and the real one, in radians.
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
    fn a_full_turn_measures_the_share_until_the_floor_may_have_changed() {
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
    fn a_changed_floor_is_noticed() {
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
    fn impossible_shares_are_ignored() {
        let mut grip = Grip::default();
        for (told, turned) in [(TAU, 0.1), (0.0, TAU), (TAU, -TAU), (TAU, f64::NAN)] {
            grip.learn(told, turned);
            assert_eq!(grip.share(), 1.0, "{told} {turned}");
        }
    }
}
