//! Limits what behaviours may send besides motion, each and all together. The robot's link is slow,
//! and data in its queue delays the next stop: lights, sounds and speech beyond the limits are
//! dropped.

use tokio::time::Instant;

use crate::rate_limit::{TokenBucket, is_round};
use crate::wire::{Command, Engage};

/// Lights, sounds, volumes, streams and dockings: the most at once, and per second.
const COMMANDS: f64 = 100.0;
/// The same limit for all behaviours together.
const SHARED_COMMANDS: f64 = 200.0;
/// The most bytes of speech at once: four seconds.
const SPEECH: f64 = 128_000.0;
/// Bytes of speech per second: twice the speed of speech.
const SPEECH_PER_SECOND: f64 = 64_000.0;

#[derive(Debug)]
pub(super) struct Throttle {
    commands: TokenBucket,
    speech: TokenBucket,
    refused: u64,
}

impl Throttle {
    pub(super) fn new() -> Throttle {
        Throttle {
            commands: TokenBucket::new(COMMANDS, COMMANDS),
            speech: TokenBucket::new(SPEECH, SPEECH_PER_SECOND),
            refused: 0,
        }
    }

    /// The limit for all behaviours together, with nothing for speech.
    pub(super) fn shared() -> Throttle {
        Throttle {
            commands: TokenBucket::new(SHARED_COMMANDS, SHARED_COMMANDS),
            speech: TokenBucket::new(f64::MAX, 0.0),
            refused: 0,
        }
    }

    pub(super) fn admits(&mut self, command: &Command, now: Instant) -> bool {
        let admitted = match command {
            Command::Audio(samples) => self.speech.take(samples.len() as f64, now),
            _ => self.commands.take(cost(command), now),
        };
        if !admitted {
            self.refuse();
        }
        admitted
    }

    /// Counts a command that was admitted but could not be sent.
    pub(super) fn refuse(&mut self) {
        self.refused += 1;
    }

    /// The number of refusals, when it should be logged: at the first one, and then ever more
    /// rarely.
    pub(super) fn refusals_to_log(&self) -> Option<u64> {
        is_round(self.refused).then_some(self.refused)
    }
}

/// The number of robot commands that a command leads to, its end included: a docking is a stop, a
/// search, the end of the search and a stop.
fn cost(command: &Command) -> f64 {
    match command {
        Command::Engine(Engage::Dock) => 4.0,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::time::Duration;

    #[tokio::test(start_paused = true)]
    async fn speech_at_its_own_pace_is_never_dropped() {
        let mut throttle = Throttle::new();
        for _ in 0..100 {
            let second = Command::Audio(vec![0; 32_000].into());
            assert!(throttle.admits(&second, Instant::now()));
            tokio::time::advance(Duration::from_secs(1)).await;
        }
        assert_eq!(throttle.refusals_to_log(), None);
    }

    #[test]
    fn speech_beyond_its_own_pace_is_refused_and_takes_nothing_from_commands() {
        let now = Instant::now();
        let mut throttle = Throttle::new();
        let all = Command::Audio(vec![0; SPEECH as usize].into());
        assert!(throttle.admits(&all, now));
        assert!(!throttle.admits(&Command::Audio(vec![0; 1].into()), now));
        assert!((0..COMMANDS as usize).all(|_| throttle.admits(&Command::StopSound, now)));
        assert!(!throttle.admits(&Command::StopSound, now));
    }

    #[test]
    fn docking_costs_as_much_as_the_commands_that_it_becomes() {
        let now = Instant::now();
        let mut throttle = Throttle::new();
        let dock = Command::Engine(Engage::Dock);
        let admitted = std::iter::repeat_with(|| throttle.admits(&dock, now))
            .take(COMMANDS as usize)
            .filter(|admitted| *admitted);
        assert_eq!(admitted.count(), COMMANDS as usize / 4);
    }

    #[test]
    fn refusals_are_logged_at_powers_of_ten() {
        let mut throttle = Throttle::new();
        assert_eq!(throttle.refusals_to_log(), None);
        let logged = (0..250).filter_map(|_| {
            throttle.refuse();
            throttle.refusals_to_log()
        });
        assert_eq!(logged.collect::<Vec<_>>(), [1, 10, 100]);
    }

    #[test]
    fn behaviours_together_share_a_limit_that_excludes_speech() {
        let start = Instant::now();
        let mut shared = Throttle::shared();
        assert!((0..SHARED_COMMANDS as usize).all(|_| shared.admits(&Command::StopSound, start)));
        assert!(!shared.admits(&Command::StopSound, start));
        assert!(shared.admits(&Command::Audio(vec![0; 9].into()), start));
        assert!(shared.admits(&Command::StopSound, start + Duration::from_secs(1)));
    }

    proptest! {
            #[test]
            fn no_pattern_of_commands_exceeds_the_limit(
                longest in 1u64..40,
                pauses in prop::collection::vec(0u64..40, 0..2000),
            ) {
                let start = Instant::now();
                let mut throttle = Throttle::new();
    let mut now = start;
    let mut admitted = 0.0;
                for pause in pauses {
                    now += Duration::from_millis(pause.min(longest));
                    if throttle.admits(&Command::StopSound, now) {
                        admitted += 1.0;
                    }
                    let most = COMMANDS * (1.0 + now.saturating_duration_since(start).as_secs_f64());
                    prop_assert!(admitted <= most + 1e-6, "{admitted} of {most}");
                }
            }
        }
}
