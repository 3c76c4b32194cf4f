//! Time limits of the link.

use std::time::Duration;

use rand::{Rng, RngExt};

/// Time limits of connecting, logging in and giving up.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The longest wait for a TCP connection, name lookup included.
    pub connect_timeout: Duration,
    /// The longest wait, from the login on, for AUTH_REPLY and the first POWER.
    pub login_timeout: Duration,
    /// The pause before the first reconnect after a lost link.
    pub first_pause: Duration,
    /// Pauses grow up to this.
    pub longest_pause: Duration,
    /// A write that the robot does not acknowledge within this time means a dead link.
    pub dead_after: Duration,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            connect_timeout: Duration::from_secs(5),
            login_timeout: Duration::from_secs(10),
            first_pause: Duration::from_millis(500),
            longest_pause: Duration::from_secs(30),
            dead_after: Duration::from_secs(3),
        }
    }
}

/// Growing pauses: each step doubles up to the longest, and the pause is drawn from the upper half
/// of the step, so that several agents do not reconnect in the same instant. Pure: reads no clock.
#[derive(Clone, Debug)]
pub struct Backoff {
    first: Duration,
    longest: Duration,
    step: Duration,
}

impl Backoff {
    /// Starts at `first_pause` and grows up to `longest_pause`; the longest wins if it is shorter.
    pub fn new(options: &Options) -> Backoff {
        let first = options.first_pause.min(options.longest_pause);
        Backoff {
            first,
            longest: options.longest_pause,
            step: first,
        }
    }

    /// The next pause, at most the longest.
    pub fn next(&mut self, rng: &mut impl Rng) -> Duration {
        let step = self.step;
        self.step = step.saturating_mul(2).min(self.longest);
        step.mul_f64(rng.random_range(0.5..=1.0))
    }

    /// Makes the next pause short again; to be called once a link is up.
    pub fn reset(&mut self) {
        self.step = self.first;
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand::rngs::StdRng;

    use super::*;

    fn pauses(seed: u64, count: usize) -> Vec<Duration> {
        let mut backoff = Backoff::new(&Options::default());
        let mut rng = StdRng::seed_from_u64(seed);
        (0..count).map(|_| backoff.next(&mut rng)).collect()
    }

    #[test]
    fn pauses_grow_and_stay_within_the_longest() {
        for seed in 0..100 {
            let pauses = pauses(seed, 20);
            assert!(pauses[0] >= Duration::from_millis(250), "{pauses:?}");
            assert!(pauses[..6].is_sorted(), "{pauses:?}");
            assert!(
                pauses[10..]
                    .iter()
                    .all(|&pause| pause >= Duration::from_secs(15))
            );
            assert!(pauses.iter().all(|&pause| pause <= Duration::from_secs(30)));
        }
    }

    #[test]
    fn pauses_differ_between_seeds_and_repeat_for_one_seed() {
        assert_ne!(pauses(1, 5), pauses(2, 5));
        assert_eq!(pauses(1, 5), pauses(1, 5));
    }

    #[test]
    fn after_a_good_link_pauses_are_short_again() {
        let mut backoff = Backoff::new(&Options::default());
        let mut rng = StdRng::seed_from_u64(7);
        for _ in 0..10 {
            let _ = backoff.next(&mut rng);
        }
        backoff.reset();
        assert!(backoff.next(&mut rng) <= Options::default().first_pause);
    }

    #[test]
    fn a_longest_pause_below_the_first_wins() {
        let longest_pause = Duration::from_millis(60);
        let options = Options {
            longest_pause,
            ..Options::default()
        };
        let mut backoff = Backoff::new(&options);
        assert!(backoff.next(&mut StdRng::seed_from_u64(7)) <= longest_pause);
    }
}
