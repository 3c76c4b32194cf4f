//! The heartbeat of the driving core, which the guardian monitors. A beat that comes far too late
//! shows that this program was stopped or the whole machine was suspended, so that nothing old may
//! be repeated.

use std::sync::Arc;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use tokio::sync::Notify;
use tokio::time::Instant;

use crate::guardian::{BEAT, Guardian};

/// A gap that a busy machine does not cause: the program was suspended.
const SLEPT: Duration = Duration::from_secs(1);

/// The heartbeat; see the module.
#[derive(Debug)]
pub struct Pulse {
    guardian: Option<Guardian>,
    /// Notified of each beat.
    beats: Option<Arc<Notify>>,
    due: Instant,
    /// When the pilot was last seen awake, by a clock that also runs while the machine is
    /// suspended; `None` before the first beat, since a run may take a while to begin.
    awake: Option<Duration>,
}

impl Pulse {
    /// The heartbeat of a pilot in real time; `None`: this run has no guardian.
    pub fn new(guardian: Option<Guardian>) -> Pulse {
        Pulse {
            guardian,
            beats: None,
            due: Instant::now(),
            awake: None,
        }
    }

    /// Also notifies `beats` of each beat, for supervisors of the driving core.
    #[must_use]
    pub fn notify_beats(mut self, beats: Arc<Notify>) -> Pulse {
        self.beats = Some(beats);
        self
    }

    /// The guardian: the process that stops the robot when this one cannot.
    pub(super) fn guardian(&mut self) -> Option<&mut Guardian> {
        self.guardian.as_mut()
    }

    /// When the next beat is due.
    pub(super) fn due(&self) -> Instant {
        self.due
    }

    /// Beats if it is time, and returns how long the program was suspended, if it was.
    pub(super) fn beat(&mut self, now: Instant) -> Option<Duration> {
        if self.due <= now {
            self.due = now + BEAT;
            if let Some(guardian) = &mut self.guardian {
                guardian.beat();
            }
            if let Some(beats) = &self.beats {
                beats.notify_one();
            }
        }
        self.see_awake(boot_time())
    }

    fn see_awake(&mut self, now: Duration) -> Option<Duration> {
        let before = self.awake.replace(now)?;
        Some(now.saturating_sub(before)).filter(|gap| *gap > SLEPT)
    }
}

/// The time since the machine was started, including suspension.
fn boot_time() -> Duration {
    let time = clock_gettime(ClockId::Boottime);
    Duration::try_from(time).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_start_is_not_a_sleep() {
        let mut pulse = Pulse::new(None);
        let loaded = boot_time() + Duration::from_secs(5);
        assert_eq!(pulse.see_awake(loaded), None);
    }

    #[test]
    fn a_gap_of_more_than_a_second_between_two_beats_is_a_sleep() {
        let mut pulse = Pulse::new(None);
        let at = |ms: u64| Duration::from_millis(10_000 + ms);
        assert_eq!(pulse.see_awake(at(0)), None);
        assert_eq!(pulse.see_awake(at(1000)), None);
        assert_eq!(pulse.see_awake(at(2001)), Some(Duration::from_millis(1001)));
        assert_eq!(pulse.see_awake(at(2000)), None, "a clock that goes back");
    }
}
