//! Deviations from driving straight: motors of unequal speed, and slipping tracks.

use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use super::chassis::Tracks;
use crate::sim::world::settings::TrackSettings;

/// How long a slip value applies until the next one is drawn.
const SLIP_PERIOD: Duration = Duration::from_millis(400);

/// How one robot's tracks slip.
#[derive(Debug)]
pub(crate) struct TrackSlip {
    settings: TrackSettings,
    random: StdRng,
    motors: Tracks<f64>,
    slip: Tracks<f64>,
    left: Duration,
}

impl TrackSlip {
    /// The seed determines by how much each track is slower, and how it slips.
    pub(crate) fn new(settings: TrackSettings, seed: u64) -> TrackSlip {
        // A separate random sequence, independent of the noise of the frames.
        let mut random = StdRng::seed_from_u64(seed ^ 0x7472_6163_6b73);
        let mut motor = || 1.0 - settings.unequal * random.random_range(0.0..=1.0);
        let motors = Tracks::new(motor(), motor());
        TrackSlip {
            settings,
            random,
            motors,
            slip: Tracks::new(1.0, 1.0),
            left: Duration::ZERO,
        }
    }

    /// Returns the actual speeds for the wanted ones.
    pub(crate) fn step(&mut self, wanted: Tracks<f64>, dt: Duration) -> Tracks<f64> {
        if self.settings == TrackSettings::default() {
            return wanted;
        }
        self.left = self.left.saturating_sub(dt);
        if self.left.is_zero() {
            self.left = SLIP_PERIOD;
            let most = self.settings.slip;
            let mut slip = || 1.0 + most * self.random.random_range(-1.0..=1.0);
            self.slip = Tracks::new(slip(), slip());
        }
        Tracks::new(
            wanted.left * self.motors.left * self.slip.left,
            wanted.right * self.motors.right * self.slip.right,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speeds(settings: TrackSettings, seed: u64) -> Vec<Tracks<f64>> {
        let mut track_slip = TrackSlip::new(settings, seed);
        let wanted = Tracks::new(1.0, 1.0);
        (0..100)
            .map(|_| track_slip.step(wanted, Duration::from_millis(20)))
            .collect()
    }

    #[test]
    fn tracks_differ_by_seed_and_within_their_limits() {
        let settings = TrackSettings {
            unequal: 0.1,
            slip: 0.05,
        };
        assert_eq!(speeds(settings, 1), speeds(settings, 1));
        assert_ne!(speeds(settings, 1), speeds(settings, 2));
        let seen = speeds(settings, 3);
        assert!(
            seen.iter()
                .all(|s| (0.85..=1.05).contains(&s.left) && (0.85..=1.05).contains(&s.right))
        );
        assert!(seen.iter().any(|s| s.left != seen[0].left), "no slip");
        assert!(seen.iter().all(|s| s.left != s.right));
    }

    #[test]
    fn perfect_tracks_reach_the_wanted_speeds() {
        let perfect = speeds(TrackSettings::default(), 1);
        assert!(perfect.iter().all(|s| *s == Tracks::new(1.0, 1.0)));
    }
}
