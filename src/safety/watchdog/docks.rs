//! Docking and undocking for behaviours: which requests are accepted, which wait, and their
//! answers.
//!
//! A docking belongs to the callers that wait for it and has the highest of their priorities. Like
//! a setpoint, it is refused while a higher priority drives, ends as `preempted` when a higher
//! priority wants to drive, and is cancelled only by its own callers and by equal or higher
//! priorities.

use std::time::Duration;

use tokio::time::Instant;

use super::homing::Homing;
use super::requests::LONGEST;
use super::{Caller, Leaving, Watchdog};
use crate::robot::{BehaviourId, DockEnd, DockPlan, Priority};
use crate::safety::{DockLimits, DockState, Retry};
use crate::wire::{Command, Engage};

/// The shortest timeout of a docking: with none at all there would be nothing to wait for.
const SHORTEST: Duration = Duration::from_millis(1);

/// The most calls that may wait for a docking; further requests are refused.
const MAX_CALLERS: usize = 64;

impl Watchdog {
    pub(super) fn dock_asked(&mut self, caller: Caller, plan: DockPlan, now: Instant) {
        if let Some(end) = self.dock_refusal(caller) {
            return self.answer_dock(caller, end, 0, Duration::ZERO);
        }
        if self.guard.low().is_some() {
            return self.waiting.push(caller);
        }
        if let Some(homing) = &mut self.homing {
            return homing.callers.push(caller);
        }
        let plan = DockPlan {
            timeout: plan.timeout.clamp(SHORTEST, LONGEST),
            charge_timeout: plan.charge_timeout.clamp(SHORTEST, LONGEST),
            ..plan
        };
        let approach = DockLimits {
            plan,
            retry: Retry::Reverse(Watchdog::BACK_OFF_TIME),
        };
        self.start_homing(approach, vec![caller], now);
    }

    fn dock_refusal(&self, caller: Caller) -> Option<DockEnd> {
        let callers = self
            .homing
            .as_ref()
            .map_or(0, |homing| homing.callers.len());
        let crowded = callers + self.waiting.len() >= MAX_CALLERS;
        if !self.online {
            Some(DockEnd::Disconnected)
        } else if self.run_ending {
            Some(DockEnd::Cancelled)
        } else if self.place() == DockState::Charging {
            Some(DockEnd::AlreadyDocked)
        } else if self.alarm.is_some() || crowded {
            Some(DockEnd::Safety)
        } else if self.is_outranked(caller.priority) {
            Some(DockEnd::Preempted)
        } else {
            None
        }
    }

    pub(super) fn undock_asked(&mut self, caller: Caller, timeout: Duration, now: Instant) {
        if let Some(end) = self.undock_refusal(caller) {
            return self.answer_undock(caller, end);
        }
        if let Some(earlier) = self.leaving.take() {
            self.answer_undock(earlier.caller, DockEnd::Cancelled);
        }
        let timeout = timeout.min(LONGEST);
        let until = now + timeout;
        self.leaving = Some(Leaving { caller, until });
        self.dock_tracker.leave_station(timeout, now);
        self.send(Command::Engine(Engage::Undock));
    }

    fn undock_refusal(&self, caller: Caller) -> Option<DockEnd> {
        let left = matches!(self.place(), DockState::Left(_)) && !self.dock_tracker.is_leaving();
        let low = self.guard.low().is_some() || self.guard.at_or_below_low();
        if !self.online {
            Some(DockEnd::Disconnected)
        } else if self.run_ending {
            Some(DockEnd::Cancelled)
        } else if left {
            Some(DockEnd::NotDocked)
        } else if low || self.guard.critical() {
            Some(DockEnd::Safety)
        } else if self.is_outranked(caller.priority) || self.docks_above(caller.priority) {
            Some(DockEnd::Preempted)
        } else {
            None
        }
    }

    /// Ends waiting docking calls as `cancelled`: those of `by` itself and those of equal or lower
    /// priority; with `None`, all. When no call is left the docking ends, unless it is the
    /// watchdog's own.
    pub(super) fn cancel_docks(&mut self, by: Option<(BehaviourId, Priority)>, now: Instant) {
        let stays = |caller: &Caller| {
            by.is_some_and(|(by, priority)| caller.by != by && caller.priority > priority)
        };
        let waiting = std::mem::take(&mut self.waiting).into_iter();
        let (stay, mut over): (Vec<Caller>, Vec<Caller>) = waiting.partition(stays);
        self.waiting = stay;
        if let Some(homing) = self.homing.as_mut().filter(|homing| !homing.forced) {
            if !homing.callers.iter().any(stays) {
                return self.end_docking(DockEnd::Cancelled, now);
            }
            let callers = std::mem::take(&mut homing.callers).into_iter();
            let (stay, gone): (Vec<Caller>, Vec<Caller>) = callers.partition(stays);
            homing.callers = stay;
            over.extend(gone);
        }
        for caller in over {
            self.answer_dock(caller, DockEnd::Cancelled, 0, Duration::ZERO);
        }
    }

    /// Ends a docking under way and tells its callers.
    pub(super) fn end_docking(&mut self, end: DockEnd, now: Instant) {
        let actions = self
            .homing
            .as_mut()
            .map(|homing| homing.docking.cancel(end, now));
        self.execute_dock_actions(actions.unwrap_or_default(), now);
    }

    /// Whether the docking under way belongs to behaviours that all have lower priority.
    pub(super) fn outranks_docking(&self, priority: Priority) -> bool {
        let lower = |homing: &Homing| !homing.forced && homing.priority() < Some(priority);
        self.homing.as_ref().is_some_and(lower)
    }

    /// Whether a behaviour of higher priority drives, or waits for an undocking.
    fn is_outranked(&self, priority: Priority) -> bool {
        let leaves = self.leaving.as_ref().map(|leaving| leaving.caller.priority);
        self.arbiter.priority().max(leaves) > Some(priority)
    }

    /// Whether a behaviour of higher priority waits for a docking.
    fn docks_above(&self, priority: Priority) -> bool {
        let homing = self.homing.as_ref();
        homing.and_then(Homing::priority) > Some(priority)
    }
}
