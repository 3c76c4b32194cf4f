//! How often a visitor may try to log in: a few times at once, then slowly. Pure: the time is an
//! argument.

use std::collections::BTreeMap;
use std::net::IpAddr;
use std::time::Duration;

use tokio::time::Instant;

/// Tries at once, of one address and of all together.
const OF_ONE: u32 = 5;
const OF_ALL: u32 = 50;
/// How long it takes until one more is free.
const REFILL_OF_ONE: Duration = Duration::from_secs(20);
const REFILL_OF_ALL: Duration = Duration::from_secs(2);
/// Addresses that are remembered.
const MOST_ADDRESSES: usize = 1024;

/// Tries that are free, and since when that has been so.
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

    /// Gives back what time has freed.
    fn refill(&mut self, every: Duration, now: Instant) {
        while self.used > 0 && now.saturating_duration_since(self.since) >= every {
            self.since += every;
            self.used -= 1;
        }
        if self.used == 0 {
            self.since = now;
        }
    }

    /// How long to wait for the next, if none is free.
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

    /// Takes a try.
    ///
    /// # Errors
    /// How long to wait first.
    pub(super) fn take(&mut self, address: IpAddr, now: Instant) -> Result<(), Duration> {
        self.each.retain(|_, bucket| {
            bucket.refill(REFILL_OF_ONE, now);
            bucket.used > 0
        });
        self.all.refill(REFILL_OF_ALL, now);
        if self.each.len() >= MOST_ADDRESSES && !self.each.contains_key(&address) {
            return Err(REFILL_OF_ONE);
        }
        let one = self.each.entry(address).or_insert_with(|| Bucket::new(now));
        let waits = one.wait(OF_ONE, REFILL_OF_ONE, now);
        if let Some(wait) = waits.or_else(|| self.all.wait(OF_ALL, REFILL_OF_ALL, now)) {
            return Err(wait);
        }
        (one.used, self.all.used) = (one.used + 1, self.all.used + 1);
        Ok(())
    }

    /// A try that was right counts for nothing.
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
    fn the_sixth_wrong_try_waits_and_others_do_not() {
        let now = Instant::now();
        let mut attempts = Attempts::new(now);
        (0..OF_ONE).for_each(|_| attempts.take(address(1), now).unwrap());
        assert_eq!(attempts.take(address(1), now), Err(REFILL_OF_ONE));
        attempts.take(address(2), now).unwrap();
        let later = now + REFILL_OF_ONE;
        attempts.take(address(1), later).unwrap();
        assert!(attempts.take(address(1), later).is_err());
    }

    #[test]
    fn many_addresses_together_are_slow_too_and_memory_is_bounded() {
        let now = Instant::now();
        let mut attempts = Attempts::new(now);
        let tries = (0..200).filter(|last| attempts.take(address(*last), now).is_ok());
        assert_eq!(tries.count(), OF_ALL as usize);
        assert!(attempts.each.len() <= MOST_ADDRESSES);
    }

    #[test]
    fn a_try_that_was_right_counts_for_nothing() {
        let now = Instant::now();
        let mut attempts = Attempts::new(now);
        for _ in 0..3 * OF_ONE {
            attempts.take(address(1), now).unwrap();
            attempts.give_back(address(1));
        }
    }
}
