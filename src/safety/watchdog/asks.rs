//! What behaviours ask for: motion, docking and undocking, and who is told how it ended.

use std::time::Duration;

use tokio::time::Instant;

use super::{Leaving, Watchdog};
use crate::robot::{BehaviourId, CallId, DockEnd, DockPlan, MotionEnd, Priority};
use crate::safety::{Approach, Ask, Charging, Ended, Retry};
use crate::wire::{Command, Engage};

/// The longest time that is heeded, thirty days. A host may send any, and the clock that they are
/// added to ends somewhere.
const LONGEST: Duration = Duration::from_secs(30 * 24 * 60 * 60);

/// The shortest time of a docking: with none at all there is nothing to wait for.
const SHORTEST: Duration = Duration::from_millis(1);

/// Calls that wait for one docking; what a host asks beyond that is refused.
const MOST_CALLERS: usize = 64;

impl Watchdog {
    pub(super) fn asked(&mut self, by: BehaviourId, priority: Priority, ask: Ask, now: Instant) {
        self.leases.renew(by, now);
        match ask {
            Ask::Move {
                motion,
                setpoint,
                duration,
            } => match self.refusal() {
                Some(end) => {
                    let earlier = self.arbiter.clear_of(by, MotionEnd::Preempted);
                    self.tell_ended(earlier);
                    self.tell_ended(vec![Ended { by, motion, end }]);
                }
                None => {
                    let duration = duration.map(|duration| duration.min(LONGEST));
                    let over = self
                        .arbiter
                        .wish((by, priority), motion, setpoint, duration, now);
                    self.tell_ended(over);
                }
            },
            Ask::Release(motion) => {
                let over = self.arbiter.release(by, motion);
                self.tell_ended(over);
            }
            Ask::Stop => self.stop_asked(by, priority, now),
            Ask::Dock(call, plan) => self.dock_asked((by, call), plan, now),
            Ask::Undock(call, timeout) => self.undock_asked((by, call), timeout, now),
            Ask::CancelDock => self.cancel_dock_asked(now),
        }
    }

    pub(super) fn stop_asked(&mut self, by: BehaviourId, priority: Priority, now: Instant) {
        let over = self.arbiter.stop(by, priority);
        self.tell_ended(over);
        self.end_leg(now);
        if self.homing.as_ref().is_some_and(|homing| !homing.forced) {
            self.cancel_dock_asked(now);
        }
    }

    pub(super) fn dock_asked(
        &mut self,
        caller: (BehaviourId, CallId),
        plan: DockPlan,
        now: Instant,
    ) {
        if !self.online {
            return self.answer_dock(caller, DockEnd::Disconnected, 0, Duration::ZERO);
        }
        if self.parting {
            return self.answer_dock(caller, DockEnd::Cancelled, 0, Duration::ZERO);
        }
        if self.guard.charging() != Charging::No {
            return self.answer_dock(caller, DockEnd::AlreadyDocked, 0, Duration::ZERO);
        }
        if self.alarm.is_some() {
            return self.answer_dock(caller, DockEnd::Safety, 0, Duration::ZERO);
        }
        if let Some(homing) = &mut self.homing {
            if homing.callers.len() < MOST_CALLERS {
                return homing.callers.push(caller);
            }
            return self.answer_dock(caller, DockEnd::Safety, 0, Duration::ZERO);
        }
        let plan = DockPlan {
            timeout: plan.timeout.clamp(SHORTEST, LONGEST),
            charge_timeout: plan.charge_timeout.clamp(SHORTEST, LONGEST),
            ..plan
        };
        let approach = Approach {
            plan,
            retry: Retry::Reverse(Watchdog::BACK_OFF_TIME),
        };
        self.start_homing(approach, vec![caller], now);
    }

    pub(super) fn undock_asked(
        &mut self,
        caller: (BehaviourId, CallId),
        timeout: Duration,
        now: Instant,
    ) {
        let refused = if !self.online {
            Some(DockEnd::Disconnected)
        } else if self.parting {
            Some(DockEnd::Cancelled)
        } else if !self.docked() {
            Some(DockEnd::NotDocked)
        } else if self.guard.at_or_below_low() || self.guard.critical() {
            Some(DockEnd::Safety)
        } else {
            None
        };
        if let Some(end) = refused {
            return self.answer_undock(caller, end);
        }
        if let Some(earlier) = self.leaving.take() {
            self.answer_undock(earlier.caller, DockEnd::Cancelled);
        }
        self.leaving = Some(Leaving {
            caller,
            until: now + timeout.min(LONGEST),
        });
        self.send(Command::Engine(Engage::Undock));
    }

    /// Whoever waits for the docking hears `cancelled`; the watchdog's own goes on.
    pub(super) fn cancel_dock_asked(&mut self, now: Instant) {
        let Some(homing) = &mut self.homing else {
            return;
        };
        if homing.forced {
            for caller in std::mem::take(&mut homing.callers) {
                self.answer_dock(caller, DockEnd::Cancelled, 0, Duration::ZERO);
            }
            return;
        }
        let orders = homing.docking.cancel(DockEnd::Cancelled, now);
        self.follow(orders, now);
    }
}
