//! One docking: search, wait for charging, back off, try again. The same state machine serves a
//! behaviour's `robot.dock` and the watchdog's own docking; they differ in their [`DockPlan`].

use std::time::Duration;

use tokio::time::Instant;

use super::{Contradiction, DriveGrant};
use crate::robot::{BehaviourId, CallId, DockEnd, DockOutcome, DockPlan, Priority};
use crate::wire::EngineReport;

/// What the state machine wants done.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DockAction {
    /// Stop the tracks and send BASE_FIND.
    Find,
    /// Send BASE_FIND_CANCEL and stop the tracks.
    Cancel,
    Reverse,
    Stop,
    Undock,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Caller {
    pub(super) by: BehaviourId,
    pub(super) priority: Priority,
    pub(super) call: CallId,
}

/// A docking under way and the calls that wait for it.
#[derive(Debug, Clone)]
pub(super) struct ActiveDocking {
    pub(super) docking: Docking,
    /// Begun by the watchdog: no behaviour can end it, and no call waits for it.
    pub(super) forced: bool,
    pub(super) callers: Vec<Caller>,
}

impl ActiveDocking {
    pub(super) fn priority(&self) -> Option<Priority> {
        self.callers.iter().map(|caller| caller.priority).max()
    }

    /// Whether somebody waits for it, other than the watchdog.
    pub(super) fn is_asked(&self) -> bool {
        !self.forced && !self.callers.is_empty()
    }

    /// Whether the rescue behaviour should drive it between its attempts: somebody has asked for it,
    /// one has failed, and it has more retries than usual. With the usual ones it gives its result soon.
    pub(super) fn wants_rescue(&self) -> bool {
        let patient = self.docking.plan.retries > DockPlan::DEFAULT.retries;
        self.is_asked() && patient && self.docking.has_failed()
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum DockingPhase {
    /// The robot searches on its own.
    Searching {
        until: Instant,
    },
    /// On the station; charging has not begun.
    AwaitingCharge {
        until: Instant,
    },
    /// Undocking before another attempt.
    Leaving {
        until: Instant,
    },
    /// Driving backwards before another attempt.
    BackingOff {
        until: Instant,
    },
    /// A behaviour that can see drives it elsewhere before another attempt.
    Granted(DriveGrant),
    Over(DockOutcome),
}

/// One docking, from the first attempt to its outcome.
#[derive(Debug, Clone)]
pub struct Docking {
    plan: DockPlan,
    /// The watchdog's own with a low battery: it has one attempt, and
    /// [`Homing`](super::Homing) decides what follows.
    goes_home: bool,
    started: Instant,
    searched_at: Instant,
    attempts: u32,
    phase: DockingPhase,
}

impl Docking {
    /// How long leaving the station may take before another attempt.
    pub const LEAVE_TIMEOUT: Duration = Duration::from_secs(20);
    /// How long it drives backwards between two attempts, to approach from another place.
    const BACK_OFF_TIME: Duration = Duration::from_millis(1500);

    /// Begins with the robot off its station, or on it without charging yet.
    pub fn start(
        plan: DockPlan,
        goes_home: bool,
        docked: bool,
        now: Instant,
    ) -> (Docking, Vec<DockAction>) {
        let phase = DockingPhase::AwaitingCharge {
            until: now + plan.charge_timeout,
        };
        let mut docking = Docking::new(plan, phase, now);
        docking.goes_home = goes_home;
        let actions = if docked { vec![] } else { docking.search(now) };
        (docking, actions)
    }

    /// Begins on the station, by leaving it.
    pub fn leave(plan: DockPlan, now: Instant) -> (Docking, Vec<DockAction>) {
        let phase = DockingPhase::Leaving {
            until: now + Docking::LEAVE_TIMEOUT,
        };
        let docking = Docking::new(plan, phase, now);
        (docking, vec![DockAction::Undock])
    }

    fn new(plan: DockPlan, phase: DockingPhase, now: Instant) -> Docking {
        Docking {
            plan,
            goes_home: false,
            started: now,
            searched_at: now,
            attempts: 0,
            phase,
        }
    }

    pub fn engine(&mut self, news: EngineReport, now: Instant) -> Vec<DockAction> {
        match (self.phase, news) {
            (
                DockingPhase::Searching { .. }
                | DockingPhase::BackingOff { .. }
                | DockingPhase::Granted(_),
                EngineReport::Docked,
            ) => {
                let until = now + self.plan.charge_timeout;
                let actions = self.stop_between_attempts();
                self.phase = DockingPhase::AwaitingCharge { until };
                actions
            }
            (DockingPhase::Searching { .. }, EngineReport::BaseNotFound) => {
                self.failed(DockEnd::BaseNotFound, now)
            }
            (DockingPhase::AwaitingCharge { .. }, EngineReport::Undocked) => {
                self.failed(DockEnd::NotCharging, now)
            }
            (DockingPhase::Leaving { .. }, EngineReport::Undocked) => self.search(now),
            _ => vec![],
        }
    }

    /// The robot is believed to charge: only this counts as docked.
    pub fn charging(&mut self, now: Instant) -> Vec<DockAction> {
        let actions = self.stop_between_attempts();
        self.finish(DockEnd::Done, now);
        actions
    }

    /// The robot may be charging: stands still until that is known. The attempt's timeout keeps
    /// running.
    pub fn wait(&self) -> Vec<DockAction> {
        self.stop_between_attempts()
    }

    pub fn is_searching(&self) -> bool {
        matches!(self.phase, DockingPhase::Searching { .. })
    }

    pub fn poll(&mut self, now: Instant) -> Vec<DockAction> {
        if self.next_deadline().is_none_or(|due| due > now) {
            return vec![];
        }
        match self.phase {
            // The robot still searches: it must be told of the end before anything else.
            DockingPhase::Searching { .. } => {
                [vec![DockAction::Cancel], self.failed(DockEnd::Timeout, now)].concat()
            }
            DockingPhase::AwaitingCharge { .. } => self.not_charging(now),
            DockingPhase::Leaving { .. } => {
                self.finish(DockEnd::NotCharging, now);
                vec![]
            }
            DockingPhase::BackingOff { .. } | DockingPhase::Granted(_) => self.search(now),
            DockingPhase::Over(_) => vec![],
        }
    }

    // Between two attempts.

    /// Whether an attempt has failed, and another follows or is under way.
    fn has_failed(&self) -> bool {
        let waits = matches!(
            self.phase,
            DockingPhase::BackingOff { .. } | DockingPhase::Granted(_)
        );
        waits || self.attempts > 1
    }

    /// Grants the tracks until the next attempt, instead of backing off; returns for how long.
    /// `least` is the shortest grant.
    pub fn grant(&mut self, by: BehaviourId, least: Duration, now: Instant) -> Duration {
        let time = DriveGrant::time_after(self.time_since_search(now), least);
        self.phase = DockingPhase::Granted(DriveGrant::start(by, time, now));
        time
    }

    pub fn grantee(&self) -> Option<BehaviourId> {
        match &self.phase {
            DockingPhase::Granted(grant) => Some(grant.grantee()),
            _ => None,
        }
    }

    pub fn note_motion(&mut self, moves: bool, now: Instant) {
        if let DockingPhase::Granted(grant) = &mut self.phase {
            grant.record(moves, now);
        }
    }

    /// Ends a grant; the next attempt begins.
    pub fn end_grant(&mut self, now: Instant) -> Vec<DockAction> {
        match self.phase {
            DockingPhase::Granted(_) => self.search(now),
            _ => vec![],
        }
    }

    /// The time since the last search began.
    pub fn time_since_search(&self, now: Instant) -> Duration {
        now.saturating_duration_since(self.searched_at)
    }

    /// The attempts that have ended.
    pub fn earlier_attempts(&self) -> u32 {
        self.attempts.saturating_sub(1)
    }

    /// Ends a search as one that has found nothing.
    pub fn give_up(&mut self, now: Instant) -> Vec<DockAction> {
        match self.phase {
            DockingPhase::Searching { .. } => [
                vec![DockAction::Cancel],
                self.failed(DockEnd::BaseNotFound, now),
            ]
            .concat(),
            _ => vec![],
        }
    }

    pub fn cancel(&mut self, end: DockEnd, now: Instant) -> Vec<DockAction> {
        let actions = match self.phase {
            DockingPhase::Searching { .. } => vec![DockAction::Cancel],
            _ => self.stop_between_attempts(),
        };
        self.finish(end, now);
        actions
    }

    /// Contact is no longer believed while the docking waits for charging.
    pub fn lost_contact(&mut self, contradiction: Contradiction, now: Instant) -> Vec<DockAction> {
        match (self.phase, contradiction) {
            (DockingPhase::AwaitingCharge { .. }, Contradiction::Leaving) => self.search(now),
            (DockingPhase::AwaitingCharge { .. }, Contradiction::Contact) => {
                self.finish(DockEnd::NotCharging, now);
                vec![]
            }
            _ => vec![],
        }
    }

    pub fn outcome(&self) -> Option<DockOutcome> {
        match self.phase {
            DockingPhase::Over(outcome) => Some(outcome),
            _ => None,
        }
    }

    /// When [`Docking::poll`] has something to do.
    pub fn next_deadline(&self) -> Option<Instant> {
        match self.phase {
            DockingPhase::Searching { until }
            | DockingPhase::AwaitingCharge { until }
            | DockingPhase::Leaving { until }
            | DockingPhase::BackingOff { until } => Some(until),
            DockingPhase::Granted(grant) => Some(grant.next_deadline()),
            DockingPhase::Over(_) => None,
        }
    }

    fn stop_between_attempts(&self) -> Vec<DockAction> {
        match self.phase {
            DockingPhase::BackingOff { .. } | DockingPhase::Granted(_) => vec![DockAction::Stop],
            _ => vec![],
        }
    }

    fn search(&mut self, now: Instant) -> Vec<DockAction> {
        self.attempts += 1;
        self.searched_at = now;
        self.phase = DockingPhase::Searching {
            until: now + self.plan.timeout,
        };
        vec![DockAction::Find]
    }

    /// An attempt has failed off the station.
    fn failed(&mut self, end: DockEnd, now: Instant) -> Vec<DockAction> {
        if self.goes_home || self.attempts > self.plan.retries {
            self.finish(end, now);
            return vec![DockAction::Stop];
        }
        self.phase = DockingPhase::BackingOff {
            until: now + Docking::BACK_OFF_TIME,
        };
        vec![DockAction::Reverse]
    }

    /// Charging has not begun on the station. A robot with a low battery stays there: no place is
    /// nearer to a charge.
    fn not_charging(&mut self, now: Instant) -> Vec<DockAction> {
        if self.goes_home || self.attempts == 0 || self.attempts > self.plan.retries {
            self.finish(DockEnd::NotCharging, now);
            return vec![];
        }
        self.phase = DockingPhase::Leaving {
            until: now + Docking::LEAVE_TIMEOUT,
        };
        vec![DockAction::Undock]
    }

    fn finish(&mut self, end: DockEnd, now: Instant) {
        if self.outcome().is_none() {
            let took = now.saturating_duration_since(self.started);
            self.phase = DockingPhase::Over(DockOutcome {
                end,
                attempts: self.attempts,
                took,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn plan(retries: u32) -> DockPlan {
        DockPlan {
            timeout: 10 * SECOND,
            retries,
            charge_timeout: 5 * SECOND,
        }
    }

    fn started(retries: u32) -> (Docking, Instant) {
        let now = Instant::now();
        let (docking, actions) = Docking::start(plan(retries), false, false, now);
        assert_eq!(actions, [DockAction::Find]);
        (docking, now)
    }

    fn going_home() -> (Docking, Instant) {
        let now = Instant::now();
        let (docking, actions) = Docking::start(plan(0), true, false, now);
        assert_eq!(actions, [DockAction::Find]);
        (docking, now)
    }

    #[test]
    fn docked_means_charging() {
        let (mut docking, now) = started(0);
        assert_eq!(docking.engine(EngineReport::Docked, now + SECOND), []);
        assert_eq!(docking.outcome(), None);
        assert_eq!(docking.charging(now + 2 * SECOND), []);
        let outcome = DockOutcome {
            end: DockEnd::Done,
            attempts: 1,
            took: 2 * SECOND,
        };
        assert_eq!(docking.outcome(), Some(outcome));
    }

    #[test]
    fn a_search_that_takes_too_long_is_cancelled_first() {
        let (mut docking, now) = going_home();
        let actions = docking.poll(now + 10 * SECOND);
        assert_eq!(actions, [DockAction::Cancel, DockAction::Stop]);
        assert_eq!(docking.outcome().unwrap().end, DockEnd::Timeout);
        let (mut docking, now) = started(1);
        let actions = docking.poll(now + 10 * SECOND);
        assert_eq!(actions, [DockAction::Cancel, DockAction::Reverse]);
        assert_eq!(docking.poll(now + 12 * SECOND), [DockAction::Find]);
    }

    #[test]
    fn without_charging_a_behaviour_tries_again_and_a_low_robot_stays() {
        let (mut docking, now) = started(1);
        docking.engine(EngineReport::Docked, now);
        assert_eq!(docking.poll(now + 5 * SECOND), [DockAction::Undock]);
        assert_eq!(
            docking.engine(EngineReport::Undocked, now + 6 * SECOND),
            [DockAction::Find]
        );

        let (mut docking, now) = going_home();
        docking.engine(EngineReport::Docked, now);
        assert_eq!(docking.poll(now + 5 * SECOND), []);
        assert_eq!(docking.outcome().unwrap().end, DockEnd::NotCharging);
    }

    #[test]
    fn a_docking_without_charging_in_any_attempt_ends_as_not_charging() {
        let (mut docking, now) = started(1);
        for actions in [vec![DockAction::Undock], vec![]] {
            docking.engine(EngineReport::Docked, now);
            assert_eq!(docking.poll(now + 5 * SECOND), actions);
            docking.engine(EngineReport::Undocked, now);
        }
        let outcome = docking.outcome().unwrap();
        assert_eq!((outcome.end, outcome.attempts), (DockEnd::NotCharging, 2));
    }

    #[test]
    fn an_undocking_before_charging_is_a_failed_attempt() {
        let (mut docking, now) = started(1);
        docking.engine(EngineReport::Docked, now);
        let actions = docking.engine(EngineReport::Undocked, now + SECOND);
        assert_eq!(actions, [DockAction::Reverse]);
    }

    #[test]
    fn lost_contact_leads_to_a_search_or_to_the_end() {
        let (mut docking, now) = going_home();
        assert!(docking.is_searching());
        assert_eq!(docking.lost_contact(Contradiction::Contact, now), []);
        docking.engine(EngineReport::Docked, now);
        assert!(!docking.is_searching());
        assert_eq!(
            docking.lost_contact(Contradiction::Leaving, now),
            [DockAction::Find]
        );
        docking.engine(EngineReport::Docked, now);
        assert_eq!(docking.lost_contact(Contradiction::Contact, now), []);
        assert_eq!(docking.outcome().unwrap().end, DockEnd::NotCharging);
    }

    #[test]
    fn cancelling_ends_the_search_or_the_plan() {
        let (mut docking, now) = started(1);
        assert_eq!(
            docking.cancel(DockEnd::Cancelled, now),
            [DockAction::Cancel]
        );
        assert_eq!(docking.outcome().unwrap().end, DockEnd::Cancelled);

        let (mut docking, now) = started(1);
        docking.engine(EngineReport::BaseNotFound, now);
        assert_eq!(docking.cancel(DockEnd::Safety, now), [DockAction::Stop]);
        assert_eq!(docking.poll(now + 60 * SECOND), []);
    }

    #[test]
    fn on_the_station_no_search_begins() {
        let now = Instant::now();
        let (mut docking, actions) = Docking::start(plan(2), false, true, now);
        assert_eq!(actions, []);
        assert_eq!(docking.poll(now + 5 * SECOND), []);
        assert_eq!(docking.outcome().unwrap().end, DockEnd::NotCharging);
    }
}
