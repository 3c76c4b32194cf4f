//! Which hosts are alive: a host whose motion is on must show life repeatedly, or it loses the
//! tracks and its process is ended.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::BehaviourId;

/// When each host last showed life.
#[derive(Debug, Clone)]
pub struct Leases {
    silence: Duration,
    grace: Duration,
    last_seen: BTreeMap<BehaviourId, Instant>,
}

impl Leases {
    /// `silence`: the longest time without a sign of life before a host's motion is held; `grace`:
    /// the time after that before the host is ended.
    pub fn new(silence: Duration, grace: Duration) -> Leases {
        Leases {
            silence,
            grace,
            last_seen: BTreeMap::new(),
        }
    }

    /// A host has shown life.
    pub fn renew(&mut self, by: BehaviourId, now: Instant) {
        self.last_seen.insert(by, now);
    }

    /// Removes a host that has ended.
    pub fn forget(&mut self, by: BehaviourId) {
        self.last_seen.remove(&by);
    }

    /// The time of a stall counts for no host: all are silent from now on, and have the whole grace
    /// to show life again.
    pub fn excuse_stall(&mut self, now: Instant) {
        let Some(silent) = now.checked_sub(self.silence) else {
            return;
        };
        for last_seen in self.last_seen.values_mut() {
            *last_seen = silent;
        }
    }

    /// The state of a host that moves the robot.
    pub fn host_life(&self, by: BehaviourId, now: Instant) -> HostLife {
        match self.last_seen.get(&by) {
            Some(&seen) if now < seen + self.silence => HostLife::Alive,
            Some(&seen) if now < seen + self.silence + self.grace => HostLife::Silent,
            _ => HostLife::Dead,
        }
    }

    /// When the state of one of `moving` will next get worse.
    pub fn next_deadline(
        &self,
        moving: impl Iterator<Item = BehaviourId>,
        now: Instant,
    ) -> Option<Instant> {
        let due = |by| {
            let silent = *self.last_seen.get(&by)? + self.silence;
            Some(if now < silent {
                silent
            } else {
                silent + self.grace
            })
        };
        moving.filter_map(due).min()
    }
}

/// Whether a host is alive, by the time since its last sign of life.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HostLife {
    /// It has shown life in time.
    Alive,
    /// Its motion must be held.
    Silent,
    /// It must be ended.
    Dead,
}

#[cfg(test)]
mod tests {
    use super::*;

    const WHO: BehaviourId = BehaviourId(0);
    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_silent_host_is_held_then_dead_until_it_shows_life() {
        let mut leases = Leases::new(250 * MS, 100 * MS);
        let now = Instant::now();
        assert_eq!(leases.host_life(WHO, now), HostLife::Dead, "not seen yet");
        leases.renew(WHO, now);
        let deadline = |leases: &Leases, at| leases.next_deadline([WHO].into_iter(), at);
        assert_eq!(leases.host_life(WHO, now + 249 * MS), HostLife::Alive);
        assert_eq!(deadline(&leases, now), Some(now + 250 * MS));
        assert_eq!(leases.host_life(WHO, now + 250 * MS), HostLife::Silent);
        assert_eq!(deadline(&leases, now + 250 * MS), Some(now + 350 * MS));
        assert_eq!(leases.host_life(WHO, now + 350 * MS), HostLife::Dead);
        leases.renew(WHO, now + 300 * MS);
        assert_eq!(leases.host_life(WHO, now + 350 * MS), HostLife::Alive);
    }

    #[test]
    fn a_stall_ends_no_host_but_each_must_show_life_again() {
        let mut leases = Leases::new(250 * MS, 100 * MS);
        let begin = Instant::now();
        let mut now = begin + 1000 * MS;
        leases.renew(WHO, begin);
        leases.excuse_stall(now);
        assert_eq!(leases.host_life(WHO, now), HostLife::Silent);
        assert_eq!(leases.host_life(WHO, now + 100 * MS), HostLife::Dead);
        now += 50 * MS;
        leases.renew(WHO, now);
        leases.excuse_stall(now);
        assert_eq!(leases.host_life(WHO, now), HostLife::Silent);
        leases.renew(WHO, now);
        assert_eq!(leases.host_life(WHO, now), HostLife::Alive);
    }

    #[test]
    fn a_forgotten_host_counts_as_dead() {
        let mut leases = Leases::new(250 * MS, 100 * MS);
        let now = Instant::now();
        leases.renew(WHO, now);
        leases.forget(WHO);
        assert_eq!(leases.host_life(WHO, now), HostLife::Dead);
        assert_eq!(leases.next_deadline([WHO].into_iter(), now), None);
    }
}
