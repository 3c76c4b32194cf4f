//! Limits on what is sent and logged: token buckets, bytes per day, and messages that are logged
//! once and then counted. Pure: the time is an argument.

use std::time::Duration;

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
}

impl TokenBucket {
    /// Creates a bucket that holds at most `most` tokens and gains `per_second`.
    pub fn new(most: f64, per_second: f64) -> TokenBucket {
        TokenBucket {
            level: most,
            most,
            per_second,
            at: None,
        }
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
}

/// A daily budget, in bytes or other units.
#[derive(Debug, Clone)]
pub struct Budget {
    per_day: u64,
    bucket: TokenBucket,
}

impl Budget {
    /// Creates a budget of this many bytes in any 24 hours.
    pub fn new(per_day: u64) -> Budget {
        let most = per_day as f64 * AT_ONCE;
        let per_second = (per_day as f64 - most) / DAY.as_secs_f64();
        Budget {
            per_day,
            bucket: TokenBucket::new(most, per_second),
        }
    }

    /// Spends bytes. Returns false, and spends nothing, if not enough are left.
    pub fn take(&mut self, bytes: u64, now: Instant) -> bool {
        self.bucket.take(bytes as f64, now)
    }

    pub fn per_day(&self) -> u64 {
        self.per_day
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn an_hours_share_may_be_spent_at_once_and_the_rest_accrues_evenly() {
        let mut now = Instant::now();
        let mut budget = Budget::new(2400);
        assert!(budget.take(100, now));
        assert!(!budget.take(1, now));
        now += Duration::from_secs(3600);
        assert!(budget.take(95, now) && !budget.take(10, now));
        assert_eq!(budget.per_day(), 2400);
        assert!(!Budget::new(0).take(1, now));
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
                let mut budget = Budget::new(10_000);
                for (pause, bytes) in asks {
                    now += Duration::from_secs(pause % 4000);
                    if budget.take(bytes, now) {
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
