//! Limits on what is sent, tried and logged: token buckets, growing pauses, and messages that are
//! logged once and then counted. Pure: the time is an argument.

use std::time::Duration;

use rand::{Rng, RngExt};
use tokio::time::Instant;

const DAY: Duration = Duration::from_secs(86_400);
/// This part of the daily budget may be spent at once; the rest accrues evenly. So a flood in one
/// minute does not use up the rest of the day, and no period of 24 hours exceeds the daily budget.
const AT_ONCE: f64 = 1.0 / 24.0;

/// A token bucket: starts full, fills up steadily and is emptied by taking.
#[derive(Debug, Clone)]
pub struct TokenBucket {
    level: f64,
    most: f64,
    per_second: f64,
    at: Option<Instant>,
    /// How often too little was left since the last success.
    refused: u64,
}

impl TokenBucket {
    /// Creates a bucket that holds at most `most` tokens and gains `per_second`.
    pub fn new(most: f64, per_second: f64) -> TokenBucket {
        TokenBucket {
            level: most,
            most,
            per_second,
            at: None,
            refused: 0,
        }
    }

    /// Creates a daily budget, of bytes or something else: so much in any 24 hours.
    pub fn a_day(amount: u64) -> TokenBucket {
        let most = amount as f64 * AT_ONCE;
        TokenBucket::new(most, (amount as f64 - most) / DAY.as_secs_f64())
    }

    /// The amount of [`TokenBucket::a_day`].
    pub fn per_day(&self) -> u64 {
        (self.most / AT_ONCE).round() as u64
    }

    /// The same budget of which at most this much may be spent at once now.
    pub fn with_left(mut self, left: Option<u64>) -> TokenBucket {
        if let Some(left) = left {
            self.level = self.level.min(left as f64);
        }
        self
    }

    /// Takes tokens. Returns false, and takes nothing, if not enough are left.
    pub fn take(&mut self, amount: f64, now: Instant) -> bool {
        let passed = self
            .at
            .map_or(Duration::ZERO, |at| now.saturating_duration_since(at));
        self.at = Some(now);
        self.level = (self.level + self.per_second * passed.as_secs_f64()).min(self.most);
        let enough = self.level >= amount;
        if enough {
            self.level -= amount;
        }
        enough
    }

    /// Takes tokens that are spent already, also if not enough are left; returns how many are left then,
    /// below zero if too many were.
    pub fn spend(&mut self, amount: f64, now: Instant) -> f64 {
        self.take(0.0, now);
        self.level -= amount;
        self.level
    }

    /// Same as [`TokenBucket::take`]; returns how often it was refused since the last success.
    pub fn take_counted(&mut self, amount: f64, now: Instant) -> Option<u64> {
        if !self.take(amount, now) {
            self.refused += 1;
            return None;
        }
        Some(std::mem::take(&mut self.refused))
    }
}

/// Growing pauses: each step is twice as long as the one before, up to the longest.
#[derive(Debug, Clone)]
pub struct Backoff {
    first: Duration,
    longest: Duration,
    step: Duration,
}

impl Backoff {
    /// Starts at `first` and grows up to `longest`, which wins if it is shorter.
    pub fn new(first: Duration, longest: Duration) -> Backoff {
        let first = first.min(longest);
        Backoff {
            first,
            longest,
            step: first,
        }
    }

    pub fn step(&mut self) -> Duration {
        let step = self.step;
        self.step = step.saturating_mul(2).min(self.longest);
        step
    }

    /// The next pause, drawn from the upper half of its step, so that several agents do not
    /// reconnect in the same instant.
    pub fn next(&mut self, rng: &mut impl Rng) -> Duration {
        self.step().mul_f64(rng.random_range(0.5..=1.0))
    }

    /// Makes the next pause short again.
    pub fn reset(&mut self) {
        self.step = self.first;
    }
}

/// Limits repeated messages: one of each kind per interval is reported, the others are counted. The
/// number of kinds must be small.
#[derive(Debug, Clone)]
pub struct Repeats<K> {
    every: Duration,
    reported: Vec<(K, Instant, u64)>,
}

impl<K: PartialEq> Repeats<K> {
    /// Allows one message of each kind per interval.
    pub fn new(every: Duration) -> Repeats<K> {
        Repeats {
            every,
            reported: Vec::new(),
        }
    }

    /// Returns `Some` if this message should be reported, with the number of suppressed messages of
    /// its kind since the last report.
    pub fn record(&mut self, kind: K, now: Instant) -> Option<u64> {
        let Some((_, at, suppressed)) = self.reported.iter_mut().find(|(known, ..)| *known == kind)
        else {
            self.reported.push((kind, now, 0));
            return Some(0);
        };
        if now.saturating_duration_since(*at) < self.every {
            *suppressed += 1;
            return None;
        }
        *at = now;
        Some(std::mem::take(suppressed))
    }
}

/// Whether a repeated failure is logged at this count: 1, 10, 100, ...
pub fn is_round(count: u64) -> bool {
    count > 0 && 10_u64.pow(count.ilog10()) == count
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand::rngs::StdRng;

    const FIRST: Duration = Duration::from_millis(500);
    const LONGEST: Duration = Duration::from_secs(30);

    fn pauses(seed: u64, count: usize) -> Vec<Duration> {
        let mut backoff = Backoff::new(FIRST, LONGEST);
        let mut rng = StdRng::seed_from_u64(seed);
        (0..count).map(|_| backoff.next(&mut rng)).collect()
    }

    #[test]
    fn pauses_grow_and_stay_within_the_longest() {
        for seed in 0..100 {
            let pauses = pauses(seed, 20);
            assert!(pauses[0] >= FIRST / 2, "{pauses:?}");
            assert!(pauses[..6].is_sorted(), "{pauses:?}");
            assert!(pauses[10..].iter().all(|&pause| pause >= LONGEST / 2));
            assert!(pauses.iter().all(|&pause| pause <= LONGEST));
        }
    }

    #[test]
    fn pauses_differ_between_seeds_and_repeat_for_one_seed() {
        assert_ne!(pauses(1, 5), pauses(2, 5));
        assert_eq!(pauses(1, 5), pauses(1, 5));
    }

    #[test]
    fn after_a_reset_pauses_are_short_again_and_a_shorter_longest_wins() {
        let mut backoff = Backoff::new(FIRST, LONGEST);
        for _ in 0..10 {
            let _ = backoff.step();
        }
        assert_eq!(backoff.step(), LONGEST);
        backoff.reset();
        assert_eq!(backoff.step(), FIRST);
        assert_eq!(Backoff::new(LONGEST, FIRST).step(), FIRST);
    }

    #[test]
    fn an_hours_share_may_be_spent_at_once_and_the_rest_accrues_evenly() {
        let mut now = Instant::now();
        let mut budget = TokenBucket::a_day(2400);
        assert!(budget.take(100.0, now));
        assert!(!budget.take(1.0, now));
        now += Duration::from_secs(3600);
        assert!(budget.take(95.0, now) && !budget.take(10.0, now));
        assert_eq!(budget.per_day(), 2400);
        assert!(!TokenBucket::a_day(0).take(1.0, now));
    }

    #[test]
    fn repeated_failures_are_logged_at_powers_of_ten() {
        let logged: Vec<u64> = (0..=1000).filter(|&count| is_round(count)).collect();
        assert_eq!(logged, [1, 10, 100, 1000]);
    }

    #[test]
    fn one_of_a_kind_is_reported_per_minute_and_the_others_are_counted() {
        let minute = Duration::from_secs(60);
        let mut repeats = Repeats::new(minute);
        let mut now = Instant::now();
        assert_eq!(repeats.record(7, now), Some(0));
        for _ in 0..100_000 {
            assert_eq!(repeats.record(7, now), None);
        }
        assert_eq!(repeats.record(8, now), Some(0));
        now += minute;
        assert_eq!(repeats.record(7, now), Some(100_000));
        assert_eq!(repeats.record(7, now), None);
    }

    proptest! {
            #[test]
            fn no_day_exceeds_its_budget(asks in proptest::collection::vec((0u64..90_000, 0u64..400), 1..300)) {
                let start = Instant::now();
                let mut now = start;
    let mut spent = Vec::new();
                let mut budget = TokenBucket::a_day(10_000);
                for (pause, bytes) in asks {
                    now += Duration::from_secs(pause % 4000);
                    if budget.take(bytes as f64, now) {
                        spent.push((now, bytes));
                    }
                }
                for (from, _) in &spent {
                    let within = spent.iter().filter(|(at, _)| at >= from && *at < *from + DAY);
                    let sum: u64 = within.map(|(_, bytes)| bytes).sum();
                    prop_assert!(sum <= 10_000, "{sum}");
                }
            }
        }
}
