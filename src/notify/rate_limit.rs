//! Limits the number of messages to a target: an hourly rate, with a burst of a third of it. Pure:
//! the time is an argument.

use std::time::Duration;

use tokio::time::Instant;

const HOUR: Duration = Duration::from_secs(3600);

/// See the module.
#[derive(Debug)]
pub(super) struct RateLimit {
    per_hour: f64,
    left: f64,
    at: Instant,
    /// Messages dropped since the last one that was allowed.
    dropped: u64,
}

impl RateLimit {
    pub(super) fn new(per_hour: u64, now: Instant) -> RateLimit {
        let per_hour = per_hour as f64;
        RateLimit {
            per_hour,
            left: RateLimit::at_once(per_hour),
            at: now,
            dropped: 0,
        }
    }

    fn at_once(per_hour: f64) -> f64 {
        (per_hour / 3.0).max(1.0)
    }

    /// Allows one message, and returns the number of messages dropped before it; `None` if this one
    /// must be dropped.
    pub(super) fn take(&mut self, now: Instant) -> Option<u64> {
        let passed = now.saturating_duration_since(self.at).as_secs_f64();
        self.at = now;
        let grown = self.left + self.per_hour * passed / HOUR.as_secs_f64();
        self.left = grown.min(RateLimit::at_once(self.per_hour));
        if self.left < 1.0 {
            self.dropped += 1;
            return None;
        }
        self.left -= 1.0;
        Some(std::mem::take(&mut self.dropped))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_third_is_allowed_at_once_the_rest_evenly_and_drops_are_counted() {
        let mut now = Instant::now();
        let mut rate_limit = RateLimit::new(30, now);
        let burst = std::iter::repeat_with(|| rate_limit.take(now)).take(50);
        assert_eq!(burst.flatten().count(), 10);
        now += HOUR / 30;
        assert_eq!(rate_limit.take(now), Some(40));
        assert_eq!(rate_limit.take(now), None);
        now += HOUR;
        let burst = std::iter::repeat_with(|| rate_limit.take(now)).take(50);
        assert_eq!(burst.flatten().count(), 10);
    }
}
