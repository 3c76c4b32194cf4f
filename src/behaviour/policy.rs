//! Decides whether and when a failed behaviour is restarted. Pure: the time is an argument.

use std::collections::VecDeque;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use rand::SeedableRng;
use rand::rngs::StdRng;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use tokio::time::Instant;

use crate::rate_limit::Backoff;
use crate::robot::{EndReason, Seconds};
use crate::yaml::whole_within;

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub enum RestartPolicy {
    #[default]
    Never,
    /// Restart it, unless it fails too often.
    OnFailure(Restarts),
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Restarts {
    /// Upper limit of the pause before the first restart; it doubles with each further restart
    /// within the window.
    pub first_pause: Duration,
    /// Upper limit of every pause.
    pub max_pause: Duration,
    /// Maximum number of restarts within the window; after that, the next failure is final.
    pub max_restarts: u32,
    /// The length of the window. After a run of this length all earlier failures are forgotten.
    pub within: Duration,
}

impl Default for Restarts {
    fn default() -> Restarts {
        Restarts {
            first_pause: Duration::from_secs(1),
            max_pause: Duration::from_secs(60),
            max_restarts: 5,
            within: Duration::from_secs(600),
        }
    }
}

impl RestartPolicy {
    /// The values that a command line and a config accept.
    pub const WORDS: [&str; 2] = ["never", "on-failure"];
}

impl FromStr for RestartPolicy {
    type Err = String;

    fn from_str(word: &str) -> Result<RestartPolicy, String> {
        match word {
            "never" => Ok(RestartPolicy::Never),
            "on-failure" => Ok(RestartPolicy::OnFailure(Restarts::default())),
            other => Err(format!("`{other}` is neither `never` nor `on-failure`")),
        }
    }
}

/// A word, or a table such as `{ policy: on-failure, max_restarts: 3 }`.
impl<'de> Deserialize<'de> for RestartPolicy {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<RestartPolicy, D::Error> {
        from.deserialize_any(PolicyVisitor)
    }
}

struct PolicyVisitor;

impl<'de> Visitor<'de> for PolicyVisitor {
    type Value = RestartPolicy;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(
            "`never`, `on-failure` or a table such as { policy: on-failure, max_restarts: 5 }",
        )
    }

    fn visit_str<E: Error>(self, word: &str) -> Result<RestartPolicy, E> {
        word.parse().map_err(E::custom)
    }

    fn visit_map<M: MapAccess<'de>>(self, map: M) -> Result<RestartPolicy, M::Error> {
        let table = Table::deserialize(MapAccessDeserializer::new(map))?;
        let usual = Restarts::default();
        let time = |seconds: Option<Seconds>, usual| seconds.map_or(usual, Seconds::get);
        let restarts = Restarts {
            first_pause: time(table.first_pause, usual.first_pause),
            max_pause: time(table.max_pause, usual.max_pause),
            max_restarts: table.max_restarts.unwrap_or(usual.max_restarts),
            within: time(table.within, usual.within),
        };
        Ok(match table.policy {
            RestartPolicy::Never => RestartPolicy::Never,
            RestartPolicy::OnFailure(_) => RestartPolicy::OnFailure(restarts),
        })
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    policy: RestartPolicy,
    first_pause: Option<Seconds>,
    max_pause: Option<Seconds>,
    #[serde(default, deserialize_with = "restarts")]
    max_restarts: Option<u32>,
    within: Option<Seconds>,
}

fn restarts<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u32>, D::Error> {
    whole_within(from, "a whole number from 0 to 1000", 0..=1000).map(Some)
}

/// What to do with a behaviour that has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RestartDecision {
    /// Nothing: it has not failed, or the policy is not to restart it.
    Over,
    /// Start it again after a pause.
    Again {
        pause: Duration,
        /// Which restart within the window this is, from 1.
        number: u32,
    },
    /// It has failed too often.
    GivenUp,
}

#[derive(Debug)]
pub struct RestartTracker {
    policy: RestartPolicy,
    /// Times of the restarts within the window, oldest first; at most `max_restarts`.
    restarts: VecDeque<Instant>,
    rng: StdRng,
}

impl RestartTracker {
    /// `seed` determines the jitter of the pauses.
    pub fn new(policy: RestartPolicy, seed: u64) -> RestartTracker {
        RestartTracker {
            policy,
            restarts: VecDeque::new(),
            rng: StdRng::seed_from_u64(seed),
        }
    }

    /// Decides what to do with a behaviour that has ended. A restart counts from the time it is
    /// due.
    pub fn ended(&mut self, reason: EndReason, now: Instant) -> RestartDecision {
        let restarts = match self.policy {
            RestartPolicy::OnFailure(restarts) if is_failure(reason) => restarts,
            _ => return RestartDecision::Over,
        };
        let forgotten = |at: &Instant| *at + restarts.within <= now;
        let over = self.restarts.iter().take_while(|at| forgotten(at)).count();
        self.restarts.drain(..over);
        let count = u32::try_from(self.restarts.len()).unwrap_or(u32::MAX);
        if count >= restarts.max_restarts {
            return RestartDecision::GivenUp;
        }
        let mut backoff = Backoff::new(restarts.first_pause, restarts.max_pause);
        for _ in 0..count {
            backoff.step();
        }
        let pause = backoff.next(&mut self.rng);
        self.restarts.push_back(now + pause);
        let number = count + 1;
        RestartDecision::Again { pause, number }
    }

    /// Forgets all restarts, because the script has changed.
    pub fn forget(&mut self) {
        self.restarts.clear();
    }
}

/// Whether this end reason is a failure. An end caused by the watchdog, by a person or by the
/// script itself is not one.
pub fn is_failure(reason: EndReason) -> bool {
    matches!(
        reason,
        EndReason::Error | EndReason::Cpu | EndReason::Memory
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn restarts(seed: u64) -> RestartTracker {
        RestartTracker::new(RestartPolicy::OnFailure(Restarts::default()), seed)
    }

    /// Fails repeatedly after runs of this length; returns the pauses until the tracker gives up.
    fn pauses(restarts: &mut RestartTracker, run: Duration, most: usize) -> Vec<Duration> {
        let mut now = Instant::now();
        let mut pauses = Vec::new();
        while pauses.len() < most {
            now += run;
            match restarts.ended(EndReason::Error, now) {
                RestartDecision::Again { pause, number } => {
                    assert!((1..=5).contains(&number), "{number}");
                    now += pause;
                    pauses.push(pause);
                }
                RestartDecision::GivenUp => break,
                RestartDecision::Over => panic!("a failure is not over"),
            }
        }
        pauses
    }

    #[test]
    fn pauses_double_until_the_tracker_gives_up() {
        for seed in 0..50 {
            let pauses = pauses(&mut restarts(seed), SECOND, 100);
            assert_eq!(pauses.len(), 5);
            for (pause, step) in pauses.iter().zip([1, 2, 4, 8, 16]) {
                let step = step * SECOND;
                assert!(*pause >= step / 2 && *pause <= step, "{pauses:?}");
            }
        }
    }

    fn read(text: &str) -> Result<RestartPolicy, String> {
        serde_yaml::from_str(text).map_err(|error| error.to_string())
    }

    #[test]
    fn a_config_accepts_a_word_or_a_table() {
        assert_eq!(read("never"), Ok(RestartPolicy::Never));
        let usual = Restarts::default();
        assert_eq!(read("on-failure"), Ok(RestartPolicy::OnFailure(usual)));
        let table = "{ policy: on-failure, first_pause: 0.5, max_restarts: 2, within: 60 }";
        let own = Restarts {
            first_pause: SECOND / 2,
            max_restarts: 2,
            within: 60 * SECOND,
            ..usual
        };
        assert_eq!(read(table), Ok(RestartPolicy::OnFailure(own)));
        for (wrong, words) in [
            ("always", "neither `never` nor `on-failure`"),
            ("7", "expected `never`, `on-failure` or a table"),
            ("{ policy: always }", "neither `never` nor `on-failure`"),
            ("{ policy: on-failure, pause: 3 }", "unknown field `pause`"),
            ("{ policy: on-failure, max_restarts: -1 }", "from 0 to 1000"),
            ("{ policy: on-failure, within: 0 }", "seconds"),
        ] {
            let error = read(wrong).unwrap_err();
            assert!(error.contains(words), "{wrong}: {error}");
        }
    }

    #[test]
    fn equal_seeds_give_equal_pauses_and_different_seeds_do_not() {
        let of = |seed| pauses(&mut restarts(seed), SECOND, 5);
        assert_eq!(of(3), of(3));
        assert_ne!(of(3), of(4));
    }

    #[test]
    fn a_run_as_long_as_the_window_resets_the_count() {
        let pauses = pauses(&mut restarts(1), Restarts::default().within, 100);
        assert_eq!(pauses.len(), 100, "never given up");
        assert!(pauses.iter().all(|&pause| pause <= SECOND), "{pauses:?}");
    }

    #[test]
    fn a_changed_script_resets_the_count() {
        let mut restarts = restarts(1);
        pauses(&mut restarts, SECOND, 100);
        restarts.forget();
        assert!(pauses(&mut restarts, SECOND, 1)[0] <= SECOND);
    }

    #[test]
    fn only_failures_are_restarted_and_only_if_the_policy_says_so() {
        let now = Instant::now();
        for &reason in EndReason::ALL {
            let wanted = restarts(1).ended(reason, now);
            let failed = matches!(wanted, RestartDecision::Again { .. });
            assert_eq!(failed, is_failure(reason), "{reason}: {wanted:?}");
            let mut never = RestartTracker::new(RestartPolicy::Never, 1);
            assert_eq!(never.ended(reason, now), RestartDecision::Over);
        }
    }

    #[test]
    fn with_no_restarts_allowed_the_first_failure_is_final() {
        let restarts = Restarts {
            max_restarts: 0,
            ..Restarts::default()
        };
        let mut restarts = RestartTracker::new(RestartPolicy::OnFailure(restarts), 1);
        let verdict = restarts.ended(EndReason::Cpu, Instant::now());
        assert_eq!(verdict, RestartDecision::GivenUp);
    }

    proptest! {
            #[test]
            fn restarts_per_window_and_pauses_stay_within_their_limits(
                seed: u64,
                (first, longest) in (1u64..5_000, 1u64..20_000),
                max_restarts in 0u32..8,
                within in 1u64..100_000,
                runs in prop::collection::vec(0u64..60_000, 1..200),
            ) {
                let ms = Duration::from_millis;
                let restarts = Restarts {
                    first_pause: ms(first),
                    max_pause: ms(longest),
                    max_restarts,
                    within: ms(within),
                };
                let mut tracker = RestartTracker::new(RestartPolicy::OnFailure(restarts), seed);
                let mut now = Instant::now();
    let mut started = Vec::new();
                for run in runs {
                    now += ms(run);
                    let RestartDecision::Again { pause, number } = tracker.ended(EndReason::Memory, now) else {
                        continue;
                    };
                    prop_assert!(pause <= restarts.max_pause);
                    prop_assert!((1..=max_restarts).contains(&number));
                    now += pause;
                    started.push(now);
                }
                for window in started.windows(max_restarts as usize + 1) {
                    let span = window[max_restarts as usize] - window[0];
                    prop_assert!(span >= restarts.within, "{span:?}");
                }
            }
        }
}
