//! Time limits of the link, as given in the config (plain seconds).

use std::time::Duration;

use rand::{Rng, RngExt};
use serde::{Deserialize, Serialize};

/// Time limits of connecting, logging in and giving up. In YAML each is a number of seconds; for a
/// value out of its range the error names its position.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "Link")]
pub struct Options {
    /// The longest wait for a TCP connection, name lookup included; 0.1 to 120 s, default 5 s.
    #[serde(with = "seconds::Between::<100, 120_000>")]
    #[schemars(with = "f64")]
    pub connect_timeout: Duration,
    /// The longest wait, from the login on, for AUTH_REPLY and the first POWER; 0.1 to 600 s,
    /// default 10 s.
    #[serde(with = "seconds::Between::<100, 600_000>")]
    #[schemars(with = "f64")]
    pub login_timeout: Duration,
    /// The pause before the first reconnect after a lost link; 0.05 to 60 s, default 0.5 s.
    #[serde(with = "seconds::Between::<50, 60_000>")]
    #[schemars(with = "f64")]
    pub first_pause: Duration,
    /// Pauses grow up to this; 0.05 to 3600 s, default 30 s.
    #[serde(with = "seconds::Between::<50, 3_600_000>")]
    #[schemars(with = "f64")]
    pub longest_pause: Duration,
    /// A write that the robot does not acknowledge within this time means a dead link; 0.5 to 60 s,
    /// default 3 s.
    #[serde(with = "seconds::Between::<500, 60_000>")]
    #[schemars(with = "f64")]
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

/// Durations as plain seconds within a range.
mod seconds {
    use std::time::Duration;

    use serde::de::{Deserializer, Error, Unexpected, Visitor};
    use serde::ser::Serializer;

    /// A range in milliseconds, both ends included.
    pub(super) struct Between<const MIN_MS: u64, const MAX_MS: u64>;

    impl<const MIN_MS: u64, const MAX_MS: u64> Between<MIN_MS, MAX_MS> {
        pub(super) fn serialize<S: Serializer>(
            duration: &Duration,
            serializer: S,
        ) -> Result<S::Ok, S::Error> {
            serializer.serialize_f64(duration.as_secs_f64())
        }

        pub(super) fn deserialize<'de, D: Deserializer<'de>>(
            deserializer: D,
        ) -> Result<Duration, D::Error> {
            deserializer.deserialize_f64(Self)
        }
    }

    /// The range is checked while the number is visited: only then do parsers know its position.
    impl<const MIN_MS: u64, const MAX_MS: u64> Visitor<'_> for Between<MIN_MS, MAX_MS> {
        type Value = Duration;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            let min = MIN_MS as f64 / 1000.0;
            let max = MAX_MS as f64 / 1000.0;
            write!(f, "a number of seconds from {min} to {max}")
        }

        fn visit_f64<E: Error>(self, seconds: f64) -> Result<Duration, E> {
            let inside = (MIN_MS as f64 / 1000.0..=MAX_MS as f64 / 1000.0).contains(&seconds);
            if inside {
                return Ok(Duration::from_secs_f64(seconds));
            }
            Err(E::invalid_value(Unexpected::Float(seconds), &self))
        }

        fn visit_u64<E: Error>(self, seconds: u64) -> Result<Duration, E> {
            self.visit_f64(seconds as f64)
        }

        fn visit_i64<E: Error>(self, seconds: i64) -> Result<Duration, E> {
            self.visit_f64(seconds as f64)
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

    fn refusal(yaml: &str) -> String {
        serde_yaml::from_str::<Options>(yaml)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn seconds_may_be_whole_or_not() {
        let options: Options = serde_yaml::from_str("dead_after: 2\nfirst_pause: 0.25").unwrap();
        assert_eq!(options.dead_after, Duration::from_secs(2));
        assert_eq!(options.first_pause, Duration::from_millis(250));
        assert_eq!(options.login_timeout, Options::default().login_timeout);
    }

    #[test]
    fn a_value_out_of_range_is_refused_with_its_position_and_the_range() {
        let text = refusal("first_pause: 1\ndead_after: 0");
        assert!(
            text.contains("dead_after") && text.contains("line 2 column 13"),
            "{text}"
        );
        assert!(text.contains("from 0.5 to 60"), "{text}");
        for bad in ["-1", ".nan", ".inf", "61", "soon", "[1]"] {
            assert!(
                refusal(&format!("dead_after: {bad}")).contains("line 1"),
                "{bad}"
            );
        }
    }

    #[test]
    fn an_unknown_key_is_refused_by_name() {
        assert!(refusal("dead_aftre: 2").contains("unknown field `dead_aftre`"));
    }

    #[test]
    fn written_options_read_back() {
        let text = serde_yaml::to_string(&Options::default()).unwrap();
        assert_eq!(
            serde_yaml::from_str::<Options>(&text).unwrap(),
            Options::default()
        );
    }

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
