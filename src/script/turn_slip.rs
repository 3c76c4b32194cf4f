//! How far the tracks can be trusted in turns. On an unknown floor they turn the robot less or more
//! than commanded, by a constant share and by a share that varies from moment to moment. A full
//! turn on the spot, after which the camera sees the same view again, measures the constant share;
//! the differences between camera and tracks from picture to picture measure the varying one.

/// Uncertainty on an unknown floor, as a standard deviation in radians per commanded radian.
pub(super) const UNKNOWN_FLOOR: f64 = 0.11;
/// Uncertainty that remains after a full turn.
const KNOWN_FLOOR: f64 = 0.01;
/// If camera and tracks differ by more than this for long, the floor has changed.
const CHANGED_FLOOR: f64 = 0.08;
/// A larger difference is not slip.
const MAX_SLIP: f64 = 0.4;
/// The least and the largest spread; and the spread expected on an unknown floor.
const SPREAD: (f64, f64) = (0.03, 0.12);
const EXPECTED: f64 = 0.05;
/// Error of the camera from picture to picture, which is not slip, as a share of the turn.
const SEEN: f64 = 0.05;
/// With each picture the weight of the earlier ones decreases by this share.
const FADING: f64 = 0.05;
/// The floor may change: after this many radians it is as unknown as at first.
const FORGET_AFTER: f64 = 60.0;

/// See the module documentation.
#[derive(Debug, Clone, Copy)]
pub(super) struct TurnSlip {
    /// Radians of real turn per commanded radian.
    share: f64,
    /// The standard deviation of `share`.
    share_deviation: f64,
    /// The mean of the difference between camera and tracks, as a share of the turn, and the mean
    /// of its square.
    mean: f64,
    square: f64,
}

impl Default for TurnSlip {
    fn default() -> TurnSlip {
        TurnSlip {
            share: 1.0,
            share_deviation: UNKNOWN_FLOOR,
            mean: 0.0,
            square: EXPECTED * EXPECTED + SEEN * SEEN,
        }
    }
}

impl TurnSlip {
    /// Radians that the robot turns per commanded radian.
    pub(super) fn share(&self) -> f64 {
        self.share
    }

    /// The standard deviation of a turn, as a share of it.
    pub(super) fn deviation(&self) -> f64 {
        let excess = (self.mean.abs() - CHANGED_FLOOR).max(0.0);
        self.share_deviation.hypot(self.spread()) + excess
    }

    /// The part of the deviation that varies from moment to moment.
    fn spread(&self) -> f64 {
        let variance = (self.square - self.mean * self.mean - SEEN * SEEN).max(0.0);
        variance.sqrt().clamp(SPREAD.0, SPREAD.1)
    }

    /// Increases the uncertainty after a turn of this many radians, to either side.
    pub(super) fn increase_uncertainty(&mut self, turned: f64) {
        let variance = self.share_deviation * self.share_deviation
            + UNKNOWN_FLOOR * UNKNOWN_FLOOR * turned / FORGET_AFTER;
        self.share_deviation = variance.sqrt().min(UNKNOWN_FLOOR);
    }

    /// Records by what share of the turn the camera saw more than the tracks made, between two
    /// pictures.
    pub(super) fn record_difference(&mut self, part: f64) {
        let part = part.clamp(-MAX_SLIP, MAX_SLIP);
        self.mean += FADING * (part - self.mean);
        self.square += FADING * (part * part - self.square);
    }

    /// Learns from a full turn: the commanded turn and the real one, in radians.
    pub(super) fn learn(&mut self, commanded: f64, turned: f64) {
        let share = turned / commanded;
        if !(1.0 - MAX_SLIP..=1.0 + MAX_SLIP).contains(&share) {
            return;
        }
        let gain = self.share_deviation.powi(2)
            / (self.share_deviation.powi(2) + KNOWN_FLOOR * KNOWN_FLOOR);
        self.share += gain * (share - self.share);
        self.share_deviation *= (1.0 - gain).sqrt();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_full_turn_measures_the_share_until_the_floor_may_have_changed() {
        let mut slip = TurnSlip::default();
        let unknown = slip.deviation();
        slip.learn(-TAU / 0.9, -TAU);
        assert!((slip.share() - 0.9).abs() < 0.003, "{slip:?}");
        for _ in 0..100 {
            slip.record_difference(0.05);
        }
        assert!(slip.deviation() < unknown / 3.0, "{slip:?}");
        slip.increase_uncertainty(100.0 * TAU);
        assert!(slip.deviation() > unknown / 2.0, "{slip:?}");
        assert!((slip.share() - 0.9).abs() < 0.003, "{slip:?}");
    }

    #[test]
    fn a_changed_floor_is_noticed() {
        let mut slip = TurnSlip::default();
        slip.learn(TAU, TAU);
        for _ in 0..200 {
            slip.record_difference(0.02);
        }
        let known = slip.deviation();
        for _ in 0..40 {
            slip.record_difference(-0.25);
        }
        assert!(slip.deviation() > 3.0 * known, "{slip:?} {known}");
    }

    #[test]
    fn impossible_shares_are_ignored() {
        let mut slip = TurnSlip::default();
        for (commanded, turned) in [(TAU, 0.1), (0.0, TAU), (TAU, -TAU), (TAU, f64::NAN)] {
            slip.learn(commanded, turned);
            assert_eq!(slip.share(), 1.0, "{commanded} {turned}");
        }
    }
}
