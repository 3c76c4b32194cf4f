//! The way home of a robot with a low battery, from the first search until it is released. After a
//! failed search the robot goes elsewhere, because a search from the same place fails again and
//! again: driven by a behaviour that can see, to which the tracks are lent (see [`Loan`]), or
//! blindly, in one short [`Leg`]. Only where neither is allowed does it stand and wait.
//!
//! How the real robot handles a MOVE between two searches is not known (`PROTOCOL.md`, *Not
//! known*), so each loan and each leg ends with a stop and a new BASE_FIND.

use std::time::Duration;

use tokio::time::Instant;

use super::{Leg, Limits, Loan};
use crate::robot::{BehaviourId, DockEnd, Setpoint};

/// What [`Recovery::poll`] begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecoveryStep {
    /// A leg; the search follows when it has ended.
    Leg,
    /// A search.
    Search,
}

/// What follows a failed search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AfterFailure {
    /// The next search.
    Search,
    /// A loan of the tracks.
    Loan,
    /// A leg.
    Leg,
    /// The robot stands still for this long.
    Pause(Duration),
}

/// What may follow a failed search.
#[derive(Debug, Clone, Copy)]
pub struct RecoveryOptions {
    /// The behaviour that the tracks may be lent to.
    pub rescuer: Option<BehaviourId>,
    /// Whether the watchdog itself may drive a leg.
    pub leg: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RecoveryPhase {
    /// Standing still until the next search.
    Waiting { until: Instant },
    /// The tracks are lent.
    Lending(Loan),
    /// The watchdog drives.
    Driving(Leg),
    /// The robot searches on its own.
    Searching,
}

/// Lives from the moment the battery becomes low until the robot is released. See the module.
#[derive(Debug, Clone)]
pub struct Recovery {
    began: Instant,
    loan_time: Duration,
    pause: Duration,
    retries: u32,
    phase: RecoveryPhase,
    searched: Option<Instant>,
    /// The last search failed because it found no station from where the robot stands.
    blind: bool,
    failures: u32,
    legs: u32,
}

impl Recovery {
    /// The shortest time from one search to the next, unless something has happened to the robot;
    /// also the time without commands after an interruption, for a link that seems dead.
    pub const MOMENT: Duration = Duration::from_secs(1);

    /// The battery has become low; the first search is due.
    pub fn new(limits: &Limits, now: Instant) -> Recovery {
        Recovery {
            began: now,
            loan_time: limits.rescue_time.get(),
            pause: limits.dock_pause.get(),
            retries: limits.dock_retries,
            phase: RecoveryPhase::Waiting { until: now },
            searched: None,
            blind: false,
            failures: 0,
            legs: 0,
        }
    }

    /// Advances the recovery off the station while no docking is under way; `may_drive` tells
    /// whether a leg is allowed now: a leg that is no longer allowed ends.
    pub fn poll(&mut self, may_drive: bool, now: Instant) -> Option<RecoveryStep> {
        match self.phase {
            RecoveryPhase::Waiting { until } if until <= now => Some(self.search(now)),
            RecoveryPhase::Lending(loan) if loan.is_over(now) => {
                if !loan.used() && self.blind && may_drive {
                    self.drive(now);
                    return Some(RecoveryStep::Leg);
                }
                self.wait(Duration::ZERO, now);
                self.poll(may_drive, now)
            }
            RecoveryPhase::Driving(leg) if !may_drive || leg.setpoint(now).is_none() => {
                Some(self.search(now))
            }
            // The search has ended, but no report says that it failed.
            RecoveryPhase::Searching => {
                self.wait(Duration::ZERO, now);
                self.poll(may_drive, now)
            }
            _ => None,
        }
    }

    /// Handles a failed search and begins what follows.
    pub fn failed(&mut self, end: DockEnd, options: RecoveryOptions, now: Instant) -> AfterFailure {
        self.failures = self.failures.saturating_add(1);
        self.blind = end == DockEnd::BaseNotFound;
        if end == DockEnd::NotCharging {
            self.wait(Duration::ZERO, now);
            AfterFailure::Search
        } else if let Some(by) = options.rescuer {
            self.phase = RecoveryPhase::Lending(Loan::start(by, self.loan_time, now));
            AfterFailure::Loan
        } else if self.blind && options.leg {
            self.drive(now);
            AfterFailure::Leg
        } else {
            self.wait(self.pause, now);
            AfterFailure::Pause(self.pause)
        }
    }

    /// Ends a loan or a leg; the search from here comes next.
    pub fn end(&mut self, now: Instant) {
        if matches!(
            self.phase,
            RecoveryPhase::Lending(_) | RecoveryPhase::Driving(_)
        ) {
            self.wait(Duration::ZERO, now);
        }
    }

    /// The robot is out of reach, or on its station: ends a search, a loan or a leg, but not a
    /// pause. A search from wherever the robot is then follows, no sooner than [`Recovery::MOMENT`]
    /// after what was ended: nothing is sent over a dead link.
    pub fn interrupt(&mut self, now: Instant) {
        self.blind = false;
        if !matches!(self.phase, RecoveryPhase::Waiting { .. }) {
            let until = now + Recovery::MOMENT;
            self.phase = RecoveryPhase::Waiting { until };
        }
    }

    /// The robot was moved, or its activity is not known: a search comes next, at once.
    pub fn search_at_once(&mut self, now: Instant) {
        self.blind = false;
        self.phase = RecoveryPhase::Waiting { until: now };
    }

    /// Notes whether the borrower has a motion now.
    pub fn note_motion(&mut self, moves: bool, now: Instant) {
        if let RecoveryPhase::Lending(loan) = &mut self.phase {
            loan.note(moves, now);
        }
    }

    /// The behaviour that the tracks are lent to now.
    pub fn borrower(&self) -> Option<BehaviourId> {
        match &self.phase {
            RecoveryPhase::Lending(loan) => Some(loan.borrower()),
            _ => None,
        }
    }

    /// The setpoint of the tracks; `None` unless a leg is under way.
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

    /// The number of failed searches.
    pub fn failures(&self) -> u32 {
        self.failures
    }

    /// Whether the first search and all further ones that the limits allow have failed: a person
    /// must help.
    pub fn is_alarming(&self) -> bool {
        self.failures > self.retries
    }

    /// The number of legs begun.
    pub fn legs(&self) -> u32 {
        self.legs
    }

    /// When [`Recovery::poll`] has something to do or [`Recovery::setpoint`] changes, seen from
    /// `now`. A time in the past means at once.
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

    fn search(&mut self, now: Instant) -> RecoveryStep {
        (self.phase, self.searched) = (RecoveryPhase::Searching, Some(now));
        RecoveryStep::Search
    }
}

#[cfg(test)]
mod tests;
