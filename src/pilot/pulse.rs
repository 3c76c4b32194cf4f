//! The heartbeat of the driving core. The guardian hears it; and a beat that comes far too late tells
//! that this program was stopped or the whole machine was asleep, so that nothing old may be repeated.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use tokio::time::Instant;

use crate::guardian::{BEAT, Guardian};

/// A gap that no busy machine makes: the program slept.
const SLEPT: Duration = Duration::from_secs(1);

/// See the module.
#[derive(Debug)]
pub struct Pulse {
    guardian: Option<Guardian>,
    due: Instant,
    /// When the pilot was last seen awake, by a clock that goes on while the machine sleeps.
    awake: Duration,
}

impl Pulse {
    /// Of a pilot in real time; `None`: this run has no guardian.
    pub fn new(guardian: Option<Guardian>) -> Pulse {
        Pulse {
            guardian,
            due: Instant::now(),
            awake: boot_time(),
        }
    }

    /// The process that stops the robot when this one cannot.
    pub(super) fn guardian(&mut self) -> Option<&mut Guardian> {
        self.guardian.as_mut()
    }

    /// When the next beat is due.
    pub(super) fn due(&self) -> Instant {
        self.due
    }

    /// Beats if it is time, and says how long the program slept, if it did.
    pub(super) fn beat(&mut self, now: Instant) -> Option<Duration> {
        if self.due <= now {
            self.due = now + BEAT;
            if let Some(guardian) = &mut self.guardian {
                guardian.beat();
            }
        }
        let awake = boot_time();
        let gap = awake.saturating_sub(std::mem::replace(&mut self.awake, awake));
        Some(gap).filter(|gap| *gap > SLEPT)
    }
}

/// Since the machine was started, its sleep included.
fn boot_time() -> Duration {
    let time = clock_gettime(ClockId::Boottime);
    Duration::try_from(time).unwrap_or_default()
}
