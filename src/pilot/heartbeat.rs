//! The heartbeat of the driving core, which the guardian monitors. A beat that comes far too late
//! shows that this program was stopped or the whole machine was suspended, so that nothing old may
//! be repeated. The same holds after a shorter gap in which the guardian has written to the robot.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};
use tokio::sync::Notify;
use tokio::time::Instant;

use crate::guardian::{Guardian, HEARTBEAT_INTERVAL};

/// A gap that a busy machine does not cause: the program was suspended.
const SLEPT: Duration = Duration::from_secs(1);

/// Why nothing old may be repeated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Interruption {
    /// The program was suspended for this long.
    Suspended(Duration),
    /// The guardian has written its last words: the robot does not do what it was told before.
    GuardianWrote,
}

impl fmt::Display for Interruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Interruption::Suspended(slept) => {
                write!(f, "suspended for {:.1} s", slept.as_secs_f64())
            }
            Interruption::GuardianWrote => {
                f.write_str("this program hung, and the guardian took its place")
            }
        }
    }
}

/// The heartbeat; see the module.
#[derive(Debug)]
pub struct Heartbeat {
    guardian: Option<Guardian>,
    /// Notified of each beat.
    beats: Option<Arc<Notify>>,
    due: Instant,
    /// When the pilot was last seen awake, by a clock that also runs while the machine is
    /// suspended; `None` before the first beat, since a run may take a while to begin.
    awake: Option<Duration>,
}

impl Heartbeat {
    /// The heartbeat of a pilot in real time; `None`: this run has no guardian.
    pub fn new(guardian: Option<Guardian>) -> Heartbeat {
        Heartbeat {
            guardian,
            beats: None,
            due: Instant::now(),
            awake: None,
        }
    }

    /// Also notifies `beats` of each beat, for supervisors of the driving core.
    #[must_use]
    pub fn notify_beats(mut self, beats: Arc<Notify>) -> Heartbeat {
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

    /// Beats if it is time, and returns whether the core was interrupted.
    pub(super) fn beat(&mut self, now: Instant) -> Option<Interruption> {
        let mut wrote = false;
        if self.due <= now {
            self.due = now + HEARTBEAT_INTERVAL;
            wrote = self.guardian.as_mut().is_some_and(Guardian::heartbeat);
            if let Some(beats) = &self.beats {
                beats.notify_one();
            }
        }
        let slept = self.see_awake(boot_time()).map(Interruption::Suspended);
        slept.or(wrote.then_some(Interruption::GuardianWrote))
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
        let mut heartbeat = Heartbeat::new(None);
        let loaded = boot_time() + Duration::from_secs(5);
        assert_eq!(heartbeat.see_awake(loaded), None);
    }

    #[test]
    fn a_gap_of_more_than_a_second_between_two_beats_is_a_sleep() {
        let mut heartbeat = Heartbeat::new(None);
        let at = |ms: u64| Duration::from_millis(10_000 + ms);
        assert_eq!(heartbeat.see_awake(at(0)), None);
        assert_eq!(heartbeat.see_awake(at(1000)), None);
        assert_eq!(
            heartbeat.see_awake(at(2001)),
            Some(Duration::from_millis(1001))
        );
        assert_eq!(
            heartbeat.see_awake(at(2000)),
            None,
            "a clock that goes back"
        );
    }
}
