//! The way home of a low robot, from the first search until it is released. After a search that has
//! failed the robot goes elsewhere, because from one place a search fails again and again: driven by
//! a behaviour that sees, to which the tracks are lent (see [`Loan`]), or blindly, in one short
//! [`Leg`]. Only where neither is allowed does it stand and wait, and never for longer than a search is
//! worth: standing empties the battery too.
//!
//! It is not known how the real robot takes a MOVE between two searches (`PROTOCOL.md`, *Not known*), so
//! each loan and each leg ends with a stop and BASE_FIND anew.

use std::time::Duration;

use tokio::time::Instant;

use super::{Leg, Limits, Loan};
use crate::robot::{BehaviourId, DockEnd, Setpoint};

/// What begins when it is time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Try {
    /// A leg; the search follows when it is over.
    Leg,
    /// A search.
    Search,
}

/// What follows a search that has failed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next {
    /// The next search.
    Search,
    /// The tracks are lent.
    Loan,
    /// A leg.
    Leg,
    /// The robot stands still for so long.
    Pause(Duration),
}

/// What may be done about a search that has failed.
#[derive(Debug, Clone, Copy)]
pub struct Means {
    /// Whom the tracks may be lent to.
    pub rescuer: Option<BehaviourId>,
    /// The watchdog itself may drive.
    pub leg: bool,
    /// Standing for so long costs what the search has cost.
    pub worth: Duration,
    /// The battery is nearly empty: no time to stand.
    pub critical: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Standing still until the next search.
    Waiting { until: Instant },
    /// The tracks are lent.
    Lending(Loan),
    /// The watchdog drives.
    Driving(Leg),
    /// The robot searches by itself.
    Searching,
}

/// From the moment the battery is low until it is not. See the module.
#[derive(Debug, Clone)]
pub struct Recovery {
    began: Instant,
    loan_time: Duration,
    next_pause: Duration,
    alarm_pause: Duration,
    longest_pause: Duration,
    retries: u32,
    phase: Phase,
    searched: Option<Instant>,
    /// The last search found no station from where the robot stands.
    blind: bool,
    failures: u32,
    legs: u32,
}

impl Recovery {
    /// From one search to the next at least, unless something has happened to the robot; and how
    /// long nothing is said to a link that seems dead.
    pub const MOMENT: Duration = Duration::from_secs(1);

    /// The battery has become low; the first search is due.
    pub fn new(limits: &Limits, now: Instant) -> Recovery {
        Recovery {
            began: now,
            loan_time: limits.rescue_time.get(),
            next_pause: limits.dock_pause.get(),
            alarm_pause: limits.recovery_pause.get(),
            longest_pause: limits.recovery_longest_pause.get(),
            retries: limits.dock_retries,
            phase: Phase::Waiting { until: now },
            searched: None,
            blind: false,
            failures: 0,
            legs: 0,
        }
    }

    /// Time passes off the station and no search is under way; `may_drive` says whether a leg is
    /// allowed just now, and one that is not any more is over.
    pub fn poll(&mut self, may_drive: bool, now: Instant) -> Option<Try> {
        match self.phase {
            Phase::Waiting { until } if until <= now => Some(self.search(now)),
            Phase::Lending(loan) if loan.is_over(now) => {
                if !loan.used() && self.blind && may_drive {
                    self.drive(now);
                    return Some(Try::Leg);
                }
                self.wait(Duration::ZERO, now);
                self.poll(may_drive, now)
            }
            Phase::Driving(leg) if !may_drive || leg.setpoint(now).is_none() => {
                Some(self.search(now))
            }
            // Whatever has ended it: no report says that it failed.
            Phase::Searching => {
                self.wait(Duration::ZERO, now);
                self.poll(may_drive, now)
            }
            _ => None,
        }
    }

    /// The search has failed: what follows has begun.
    pub fn failed(&mut self, end: DockEnd, means: Means, now: Instant) -> Next {
        self.failures = self.failures.saturating_add(1);
        self.blind = end == DockEnd::BaseNotFound;
        if end == DockEnd::NotCharging {
            self.wait(Duration::ZERO, now);
            Next::Search
        } else if let Some(by) = means.rescuer {
            self.phase = Phase::Lending(Loan::start(by, self.loan_time, now));
            Next::Loan
        } else if self.blind && means.leg {
            self.drive(now);
            Next::Leg
        } else {
            let pause = self.pause(means);
            self.wait(pause, now);
            Next::Pause(pause)
        }
    }

    /// Twice as long each time, up to what a search is worth.
    fn pause(&mut self, means: Means) -> Duration {
        if self.failures == self.retries.saturating_add(1) {
            self.next_pause = self.alarm_pause;
        }
        let longest = self.longest_pause.min(means.worth).max(Recovery::MOMENT);
        let pause = self.next_pause.min(longest);
        self.next_pause = self.next_pause.saturating_mul(2).min(self.longest_pause);
        if means.critical {
            Duration::ZERO
        } else {
            pause
        }
    }

    /// A loan or a leg under way is over, and the search from here comes next.
    pub fn end(&mut self, now: Instant) {
        if matches!(self.phase, Phase::Lending(_) | Phase::Driving(_)) {
            self.wait(Duration::ZERO, now);
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

    /// The robot is somewhere else, or it is not known what it does: a search comes next, at once.
    pub fn search_at_once(&mut self, now: Instant) {
        self.blind = false;
        self.phase = Phase::Waiting { until: now };
    }

    /// Whether the borrower has a motion now.
    pub fn note_motion(&mut self, moves: bool, now: Instant) {
        if let Phase::Lending(loan) = &mut self.phase {
            loan.note(moves, now);
        }
    }

    /// Whom the tracks are lent to just now.
    pub fn borrower(&self) -> Option<BehaviourId> {
        match &self.phase {
            Phase::Lending(loan) => Some(loan.borrower()),
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

    /// When the battery became low.
    pub fn began(&self) -> Instant {
        self.began
    }

    /// Searches that have failed.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    /// More searches have failed than the robot may do without a person's help.
    pub fn is_alarming(&self) -> bool {
        self.failures > self.retries
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
            Phase::Lending(loan) => Some(loan.next_deadline()),
            Phase::Driving(leg) => leg.next_deadline(now).or(Some(now)),
            Phase::Searching => None,
        }
    }

    fn wait(&mut self, pause: Duration, now: Instant) {
        let earliest = self.searched.map_or(now, |at| at + Recovery::MOMENT);
        let until = earliest.max(now + pause);
        self.phase = Phase::Waiting { until };
    }

    fn drive(&mut self, now: Instant) {
        self.phase = Phase::Driving(Leg::start(self.legs, now));
        self.legs = self.legs.saturating_add(1);
    }

    fn search(&mut self, now: Instant) -> Try {
        (self.phase, self.searched) = (Phase::Searching, Some(now));
        Try::Search
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);
    const WHO: BehaviourId = BehaviourId(7);
    const STANDING: Means = Means {
        rescuer: None,
        leg: false,
        worth: Duration::from_secs(100),
        critical: false,
    };
    const BLIND: Means = Means {
        leg: true,
        ..STANDING
    };
    const SEEING: Means = Means {
        rescuer: Some(WHO),
        ..BLIND
    };

    /// After the first search has begun, a while ago.
    fn searching() -> (Recovery, Instant) {
        let now = Instant::now();
        let mut recovery = Recovery::new(&Limits::default(), now);
        assert_eq!(recovery.poll(true, now), Some(Try::Search));
        assert_eq!(recovery.next_deadline(now), None);
        (recovery, now + 60 * SECOND)
    }

    #[test]
    fn a_leg_comes_at_once_and_its_search_when_it_is_over() {
        let (mut recovery, now) = searching();
        let next = recovery.failed(DockEnd::BaseNotFound, BLIND, now);
        assert_eq!((next, recovery.legs()), (Next::Leg, 1));
        assert!(recovery.setpoint(now + SECOND).is_some());
        let due = recovery.next_deadline(now).unwrap();
        assert_eq!(due, now + 2 * SECOND);
        assert_eq!(recovery.next_deadline(due), Some(due), "at once");
        assert_eq!(recovery.poll(true, now + SECOND), None);
        assert_eq!(recovery.poll(true, due), Some(Try::Search));
        assert_eq!(recovery.setpoint(due), None);
        recovery.failed(DockEnd::BaseNotFound, BLIND, due);
        assert_eq!(recovery.legs(), 2);
        recovery.end(due);
        assert_eq!(recovery.poll(true, due + SECOND), Some(Try::Search));
        let due = due + SECOND;
        assert_eq!(recovery.poll(true, due), None, "not twice in a second");
    }

    #[test]
    fn a_search_that_ended_without_a_word_is_followed_by_another() {
        let (mut recovery, now) = searching();
        assert_eq!(recovery.poll(true, now), Some(Try::Search));
        assert_eq!(recovery.poll(true, now), None, "not twice in a second");
        assert_eq!(recovery.next_deadline(now), Some(now + SECOND));
    }

    #[test]
    fn who_sees_drives_before_who_does_not() {
        let (mut recovery, now) = searching();
        let next = recovery.failed(DockEnd::BaseNotFound, SEEING, now);
        assert_eq!((next, recovery.borrower()), (Next::Loan, Some(WHO)));
        recovery.note_motion(true, now + SECOND);
        let due = now + 8 * SECOND;
        assert_eq!(recovery.next_deadline(now), Some(due));
        assert_eq!(recovery.poll(true, due), Some(Try::Search));
        assert_eq!(recovery.borrower(), None);
    }

    #[test]
    fn a_loan_that_nobody_uses_gives_way_to_a_leg_where_one_is_allowed() {
        for (may_drive, next) in [(true, Try::Leg), (false, Try::Search)] {
            let (mut recovery, now) = searching();
            recovery.failed(DockEnd::BaseNotFound, SEEING, now);
            let due = now + Loan::FIRST;
            assert_eq!(recovery.poll(may_drive, due), Some(next));
        }
    }

    #[test]
    fn only_a_station_not_found_leads_to_a_leg() {
        let (mut recovery, now) = searching();
        let next = recovery.failed(DockEnd::Timeout, BLIND, now);
        assert_eq!(next, Next::Pause(5 * SECOND));
        let next = recovery.failed(DockEnd::NotCharging, SEEING, now);
        assert_eq!(next, Next::Search);
        assert_eq!(recovery.poll(true, now), Some(Try::Search));
    }

    #[test]
    fn pauses_grow_up_to_what_a_search_is_worth() {
        let (mut recovery, mut now) = searching();
        for pause in [5, 10, 20, 60, 100, 100] {
            let next = recovery.failed(DockEnd::BaseNotFound, STANDING, now);
            assert_eq!(next, Next::Pause(pause * SECOND));
            let due = recovery.next_deadline(now).unwrap();
            assert_eq!(due, now + pause * SECOND);
            assert_eq!(recovery.poll(true, due), Some(Try::Search));
            now = due + 60 * SECOND;
        }
        assert!(recovery.is_alarming());
    }

    #[test]
    fn a_search_that_fails_at_once_is_worth_a_moment_and_a_nearly_empty_battery_no_pause() {
        let means = Means {
            worth: Duration::ZERO,
            ..STANDING
        };
        let (mut recovery, now) = searching();
        let next = recovery.failed(DockEnd::BaseNotFound, means, now);
        assert_eq!(next, Next::Pause(SECOND));
        let critical = Means {
            critical: true,
            ..STANDING
        };
        let (mut recovery, now) = searching();
        let next = recovery.failed(DockEnd::BaseNotFound, critical, now);
        assert_eq!(next, Next::Pause(Duration::ZERO));
        assert_eq!(recovery.poll(true, now), Some(Try::Search));
        recovery.failed(DockEnd::BaseNotFound, critical, now);
        assert_eq!(recovery.poll(true, now), None, "not twice in a second");
        assert_eq!(recovery.poll(true, now + SECOND), Some(Try::Search));
    }

    #[test]
    fn a_leg_that_is_not_allowed_any_more_is_over() {
        let (mut recovery, now) = searching();
        recovery.failed(DockEnd::BaseNotFound, BLIND, now);
        assert_eq!(recovery.poll(false, now + SECOND), Some(Try::Search));
    }

    #[test]
    fn an_interruption_ends_what_is_under_way_and_no_pause() {
        let (mut recovery, now) = searching();
        recovery.failed(DockEnd::BaseNotFound, BLIND, now);
        recovery.interrupt(now);
        assert_eq!(recovery.next_deadline(now), Some(now + SECOND));
        assert_eq!(recovery.poll(true, now + SECOND), Some(Try::Search));
        recovery.failed(DockEnd::Timeout, STANDING, now + SECOND);
        let due = recovery.next_deadline(now);
        recovery.interrupt(now + 2 * SECOND);
        assert_eq!(recovery.next_deadline(now), due);
        recovery.search_at_once(now + 3 * SECOND);
        assert_eq!(recovery.poll(true, now + 3 * SECOND), Some(Try::Search));
    }

    #[test]
    fn an_end_in_a_pause_or_a_search_changes_nothing() {
        let (mut recovery, now) = searching();
        recovery.end(now);
        assert_eq!(recovery.next_deadline(now), None);
        recovery.failed(DockEnd::BaseNotFound, STANDING, now);
        recovery.end(now);
        assert_eq!(recovery.next_deadline(now), Some(now + 5 * SECOND));
        recovery.search_at_once(now);
        recovery.poll(true, now);
        recovery.failed(DockEnd::BaseNotFound, BLIND, now + SECOND);
        recovery.end(now + 2 * SECOND);
        assert_eq!(recovery.poll(true, now + 2 * SECOND), Some(Try::Search));
    }
}
