//! Which hosts are alive: a behaviour whose motion is on must show life again and again, or it
//! loses the tracks and its process.

use std::collections::BTreeMap;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::BehaviourId;

/// When each host was last heard.
#[derive(Debug)]
pub struct Leases {
    silence: Duration,
    heard: BTreeMap<BehaviourId, Instant>,
}

impl Leases {
    /// With the longest silence allowed.
    pub fn new(silence: Duration) -> Leases {
        Leases {
            silence,
            heard: BTreeMap::new(),
        }
    }

    /// A host has shown life.
    pub fn renew(&mut self, by: BehaviourId, now: Instant) {
        self.heard.insert(by, now);
    }

    /// A host is no more.
    pub fn forget(&mut self, by: BehaviourId) {
        self.heard.remove(&by);
    }

    /// Among `moving`, the hosts that have been silent for too long.
    pub fn overdue(
        &self,
        moving: impl Iterator<Item = BehaviourId>,
        now: Instant,
    ) -> Vec<BehaviourId> {
        moving
            .filter(|&by| self.due(by).is_none_or(|due| due <= now))
            .collect()
    }

    /// When the first of `moving` will have been silent for too long.
    pub fn next_deadline(&self, moving: impl Iterator<Item = BehaviourId>) -> Option<Instant> {
        moving.filter_map(|by| self.due(by)).min()
    }

    fn due(&self, by: BehaviourId) -> Option<Instant> {
        self.heard.get(&by).map(|&heard| heard + self.silence)
    }
}
