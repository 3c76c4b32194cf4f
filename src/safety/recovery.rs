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
enum RecoveryPhase {
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
    phase: RecoveryPhase,
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
            phase: RecoveryPhase::Waiting { until: now },
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
            RecoveryPhase::Waiting { until } if until <= now => Some(self.search(now)),
            RecoveryPhase::Lending(loan) if loan.is_over(now) => {
                if !loan.used() && self.blind && may_drive {
                    self.drive(now);
                    return Some(Try::Leg);
                }
                self.wait(Duration::ZERO, now);
                self.poll(may_drive, now)
            }
            RecoveryPhase::Driving(leg) if !may_drive || leg.setpoint(now).is_none() => {
                Some(self.search(now))
            }
            // Whatever has ended it: no report says that it failed.
            RecoveryPhase::Searching => {
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
            self.phase = RecoveryPhase::Lending(Loan::start(by, self.loan_time, now));
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
        if matches!(
            self.phase,
            RecoveryPhase::Lending(_) | RecoveryPhase::Driving(_)
        ) {
            self.wait(Duration::ZERO, now);
        }
    }

    /// The robot is out of reach, or on its station. Whatever was under way is over; what comes next is
    /// a search from wherever it is by then, after a moment at least: nothing is said to a dead link.
    pub fn interrupt(&mut self, now: Instant) {
        self.blind = false;
        if !matches!(self.phase, RecoveryPhase::Waiting { .. }) {
            let until = now + Recovery::MOMENT;
            self.phase = RecoveryPhase::Waiting { until };
        }
    }

    /// The robot is somewhere else, or it is not known what it does: a search comes next, at once.
    pub fn search_at_once(&mut self, now: Instant) {
        self.blind = false;
        self.phase = RecoveryPhase::Waiting { until: now };
    }

    /// Whether the borrower has a motion now.
    pub fn note_motion(&mut self, moves: bool, now: Instant) {
        if let RecoveryPhase::Lending(loan) = &mut self.phase {
            loan.note(moves, now);
        }
    }

    /// Whom the tracks are lent to just now.
    pub fn borrower(&self) -> Option<BehaviourId> {
        match &self.phase {
            RecoveryPhase::Lending(loan) => Some(loan.borrower()),
            _ => None,
        }
    }

    /// What the tracks are to do; `None` unless a leg is under way.
    pub fn setpoint(&self, now: Instant) -> Option<Setpoint> {
        match self.phase {
            RecoveryPhase::Driving(leg) => leg.setpoint(now),
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
            RecoveryPhase::Waiting { until } => Some(until),
            RecoveryPhase::Lending(loan) => Some(loan.next_deadline()),
            RecoveryPhase::Driving(leg) => leg.next_deadline(now).or(Some(now)),
            RecoveryPhase::Searching => None,
        }
    }

    fn wait(&mut self, pause: Duration, now: Instant) {
        let earliest = self.searched.map_or(now, |at| at + Recovery::MOMENT);
        let until = earliest.max(now + pause);
        self.phase = RecoveryPhase::Waiting { until };
    }

    fn drive(&mut self, now: Instant) {
        self.phase = RecoveryPhase::Driving(Leg::start(self.legs, now));
        self.legs = self.legs.saturating_add(1);
    }

    fn search(&mut self, now: Instant) -> Try {
        (self.phase, self.searched) = (RecoveryPhase::Searching, Some(now));
        Try::Search
    }
}

#[cfg(test)]
mod tests;
