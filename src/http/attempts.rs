//! Limits how often a visitor may try to log in: a few attempts at once, then slowly. Pure: the
//! time is an argument.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::Duration;

use tokio::time::Instant;

/// Attempts at once, from one address and from all together.
const MAX_PER_ADDRESS: u32 = 5;
const MAX_TOTAL: u32 = 50;
/// Time until one more attempt is allowed.
const REFILL_PER_ADDRESS: Duration = Duration::from_secs(20);
const REFILL_TOTAL: Duration = Duration::from_secs(2);
/// Maximum number of addresses that are remembered.
const MAX_ADDRESSES: usize = 1024;

/// A token bucket: the attempts used, and the time of its last refill.
#[derive(Debug, Clone, Copy)]
struct Bucket {
    used: u32,
    since: Instant,
}

impl Bucket {
    fn new(now: Instant) -> Bucket {
        Bucket {
            used: 0,
            since: now,
        }
    }

    /// Refills the bucket according to the elapsed time.
    fn refill(&mut self, every: Duration, now: Instant) {
        while self.used > 0 && now.saturating_duration_since(self.since) >= every {
            self.since += every;
            self.used -= 1;
        }
        if self.used == 0 {
            self.since = now;
        }
    }

    /// Returns how long to wait for the next attempt, if none is allowed now.
    fn wait(&self, most: u32, every: Duration, now: Instant) -> Option<Duration> {
        let waits = (self.since + every).saturating_duration_since(now);
        (self.used >= most).then_some(waits)
    }
}

/// See the module.
#[derive(Debug)]
pub(super) struct Attempts {
    all: Bucket,
    each: BTreeMap<IpAddr, Bucket>,
}

impl Attempts {
    pub(super) fn new(now: Instant) -> Attempts {
        Attempts {
            all: Bucket::new(now),
            each: BTreeMap::new(),
        }
    }

    /// Uses up one attempt.
    ///
    /// # Errors
    /// How long to wait before the next attempt.
    pub(super) fn take(&mut self, address: IpAddr, now: Instant) -> Result<(), Duration> {
        self.each.retain(|_, bucket| {
            bucket.refill(REFILL_PER_ADDRESS, now);
            bucket.used > 0
        });
        self.all.refill(REFILL_TOTAL, now);
        if self.each.len() >= MAX_ADDRESSES && !self.each.contains_key(&address) {
            return Err(REFILL_PER_ADDRESS);
        }
        let one = self.each.entry(address).or_insert_with(|| Bucket::new(now));
        let waits = one.wait(MAX_PER_ADDRESS, REFILL_PER_ADDRESS, now);
        if let Some(wait) = waits.or_else(|| self.all.wait(MAX_TOTAL, REFILL_TOTAL, now)) {
            return Err(wait);
        }
        (one.used, self.all.used) = (one.used + 1, self.all.used + 1);
        Ok(())
    }

    /// Returns the attempt of a successful login, which does not count.
    pub(super) fn give_back(&mut self, address: IpAddr) {
        if let Some(bucket) = self.each.get_mut(&address) {
            bucket.used = bucket.used.saturating_sub(1);
        }
        self.all.used = self.all.used.saturating_sub(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(last: u8) -> IpAddr {
        IpAddr::from([10, 0, 0, last])
    }

    #[test]
    fn the_sixth_failed_attempt_must_wait_and_other_addresses_need_not() {
        let now = Instant::now();
        let mut attempts = Attempts::new(now);
        (0..MAX_PER_ADDRESS).for_each(|_| attempts.take(address(1), now).unwrap());
        assert_eq!(attempts.take(address(1), now), Err(REFILL_PER_ADDRESS));
        attempts.take(address(2), now).unwrap();
        let later = now + REFILL_PER_ADDRESS;
        attempts.take(address(1), later).unwrap();
        assert!(attempts.take(address(1), later).is_err());
    }

    #[test]
    fn many_addresses_together_are_limited_too_and_memory_is_bounded() {
        let now = Instant::now();
        let mut attempts = Attempts::new(now);
        let tries = (0..200).filter(|last| attempts.take(address(*last), now).is_ok());
        assert_eq!(tries.count(), MAX_TOTAL as usize);
        assert!(attempts.each.len() <= MAX_ADDRESSES);
    }

    #[test]
    fn a_successful_attempt_does_not_count() {
        let now = Instant::now();
        let mut attempts = Attempts::new(now);
        for _ in 0..3 * MAX_PER_ADDRESS {
            attempts.take(address(1), now).unwrap();
            attempts.give_back(address(1));
        }
    }
}
