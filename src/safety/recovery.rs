//! What follows when a robot with a low battery could not get home. If it did not find the station, it
//! searches from other places, to which the watchdog drives it in short [`Leg`]s, one before each
//! search: from one place a search fails again and again, and only down to the critical level is there
//! charge for legs, so they come without pauses. Without a leg it tries again for ever, after growing
//! pauses.
//!
//! Nobody knows how the real robot takes a MOVE between two searches (`PROTOCOL.md`, *Not known*), so
//! each leg ends with a stop and BASE_FIND anew, and all of them together are bounded by a number.

use std::time::Duration;

use tokio::time::Instant;

use super::{Leg, Limits};
use crate::robot::{DockEnd, Setpoint};

/// What begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Try {
    /// A leg; the search follows when it is over.
    Leg,
    /// A search.
    Search,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Standing still until the next try.
    Waiting { until: Instant },
    /// The watchdog drives.
    Driving(Leg),
    /// The robot searches by itself.
    Searching,
}

/// From the first failure until the robot is released.
#[derive(Debug)]
pub struct Recovery {
    next_pause: Duration,
    longest_pause: Duration,
    most_legs: u32,
    phase: Phase,
    /// The last search found no station from where the robot stands.
    blind: bool,
    legs: u32,
}

impl Recovery {
    /// See [`Recovery::interrupt`].
    const MOMENT: Duration = Duration::from_secs(1);

    /// After a docking that has failed; how is told with [`Recovery::failed`] next.
    pub fn new(limits: &Limits, now: Instant) -> Recovery {
        Recovery {
            next_pause: limits.recovery_pause.get(),
            longest_pause: limits.recovery_longest_pause.get(),
            most_legs: limits.recovery_legs,
            phase: Phase::Waiting { until: now },
            blind: false,
            legs: 0,
        }
    }

    /// Time passes off the station; `may_drive` says whether a leg is allowed just now, and one that
    /// is not any more is over.
    pub fn poll(&mut self, may_drive: bool, now: Instant) -> Option<Try> {
        match self.phase {
            Phase::Waiting { until } if until <= now => Some(self.attempt(may_drive, now)),
            Phase::Driving(leg) if !may_drive || leg.setpoint(now).is_none() => Some(self.search()),
            _ => None,
        }
    }

    /// What the tracks are to do; `None` unless a leg is under way.
    pub fn setpoint(&self, now: Instant) -> Option<Setpoint> {
        match self.phase {
            Phase::Driving(leg) => leg.setpoint(now),
            _ => None,
        }
    }

    /// The search has failed. Says how long the pause is that begins: none before a leg.
    pub fn failed(&mut self, end: DockEnd, may_drive: bool, now: Instant) -> Duration {
        self.blind = end == DockEnd::BaseNotFound;
        let pause = if self.has_leg(may_drive) || end == DockEnd::NotCharging {
            Duration::ZERO
        } else {
            self.longest_pause.min(self.next_pause)
        };
        if !pause.is_zero() {
            self.next_pause = pause * 2;
        }
        self.phase = Phase::Waiting { until: now + pause };
        pause
    }

    /// A stop: a leg that is under way or due now is over, and the search from here comes next.
    pub fn end_leg(&mut self, now: Instant) {
        let due = match self.phase {
            Phase::Waiting { until } => until <= now,
            Phase::Driving(_) => true,
            Phase::Searching => false,
        };
        if due {
            self.blind = false;
            self.phase = Phase::Waiting { until: now };
        }
    }

    /// The robot is out of reach, or on its station. Whatever was under way is over; what comes next is
    /// a search from wherever it is by then, after a moment at least: nothing is said to a dead link.
    pub fn interrupt(&mut self, now: Instant) {
        self.blind = false;
        if !matches!(self.phase, Phase::Waiting { .. }) {
            let until = now + Recovery::MOMENT;
            self.phase = Phase::Waiting { until };
        }
    }

    /// Whatever was waited for is over: a search comes next, at once.
    pub fn search_at_once(&mut self, now: Instant) {
        self.blind = false;
        self.phase = Phase::Waiting { until: now };
    }

    /// Legs begun so far.
    pub fn legs(&self) -> u32 {
        self.legs
    }

    /// When [`Recovery::poll`] has something to do or [`Recovery::setpoint`] changes, seen from `now`.
    /// In the past: at once.
    pub fn next_deadline(&self, now: Instant) -> Option<Instant> {
        match self.phase {
            Phase::Waiting { until } => Some(until),
            Phase::Driving(leg) => leg.next_deadline(now).or(Some(now)),
            Phase::Searching => None,
        }
    }

    fn has_leg(&self, may_drive: bool) -> bool {
        self.blind && may_drive && self.legs < self.most_legs
    }

    fn attempt(&mut self, may_drive: bool, now: Instant) -> Try {
        if !self.has_leg(may_drive) {
            return self.search();
        }
        self.phase = Phase::Driving(Leg::start(self.legs, now));
        self.legs += 1;
        Try::Leg
    }

    fn search(&mut self) -> Try {
        self.phase = Phase::Searching;
        Try::Search
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn recovery(legs: u32) -> (Recovery, Instant) {
        let (now, usual) = (Instant::now(), Limits::default());
        let limits = Limits {
            recovery_legs: legs,
            ..usual
        };
        (Recovery::new(&limits, now), now)
    }

    #[test]
    fn a_leg_comes_at_once_and_its_search_when_it_is_over() {
        let (mut recovery, now) = recovery(1);
        let pause = recovery.failed(DockEnd::BaseNotFound, true, now);
        assert_eq!(pause, Duration::ZERO);
        assert_eq!(recovery.poll(true, now), Some(Try::Leg));
        assert!(recovery.setpoint(now + SECOND).is_some());
        let due = recovery.next_deadline(now).unwrap();
        assert_eq!(due, now + 2 * SECOND);
        assert_eq!(recovery.next_deadline(due), Some(due), "at once");
        assert_eq!(recovery.poll(true, now + SECOND), None);
        assert_eq!(recovery.poll(true, due), Some(Try::Search));
        assert_eq!(recovery.setpoint(due), None);
        assert_eq!(recovery.next_deadline(due), None);
        assert_eq!(recovery.poll(true, due + 1000 * SECOND), None);
    }

    #[test]
    fn only_a_station_not_found_leads_to_a_leg() {
        for (end, pause) in [(DockEnd::Timeout, 60), (DockEnd::NotCharging, 0)] {
            let (mut recovery, now) = recovery(5);
            assert_eq!(recovery.failed(end, true, now), pause * SECOND, "{end}");
            let due = now + pause * SECOND;
            assert_eq!(recovery.next_deadline(now), Some(due));
            assert_eq!(recovery.poll(true, due), Some(Try::Search));
        }
    }

    #[test]
    fn a_leg_that_is_not_allowed_any_more_is_over() {
        let (mut recovery, now) = recovery(5);
        recovery.failed(DockEnd::BaseNotFound, true, now);
        recovery.poll(true, now);
        assert_eq!(recovery.poll(false, now + SECOND), Some(Try::Search));
    }

    #[test]
    fn an_interruption_ends_what_is_under_way_and_no_pause() {
        let (mut recovery, now) = recovery(5);
        recovery.failed(DockEnd::BaseNotFound, true, now);
        recovery.poll(true, now);
        recovery.interrupt(now);
        assert_eq!(recovery.next_deadline(now), Some(now + SECOND));
        assert_eq!(recovery.poll(true, now + SECOND), Some(Try::Search));
        recovery.failed(DockEnd::Timeout, true, now);
        recovery.interrupt(now + SECOND);
        assert_eq!(recovery.next_deadline(now), Some(now + 60 * SECOND));
    }

    #[test]
    fn a_stop_in_a_pause_changes_nothing() {
        let (mut recovery, now) = recovery(5);
        recovery.failed(DockEnd::BaseNotFound, false, now);
        recovery.end_leg(now + SECOND);
        let due = now + 60 * SECOND;
        assert_eq!(recovery.next_deadline(now), Some(due));
        assert_eq!(recovery.poll(true, due), Some(Try::Leg));
        assert_eq!(recovery.legs(), 1);
    }
}
