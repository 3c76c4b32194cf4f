//! Low battery and the way home: the watchdog's own docking, and a behaviour's docking that it takes
//! over.

use std::time::Duration;

use tokio::time::Instant;

use super::{Caller, Watchdog};
use crate::robot::{DockEnd, DockPlan, Event, MotionEnd, Priority, SafetyAction, Setpoint};
use crate::safety::{Act, Approach, Docking, LowCause, Order, Retry};
use crate::wire::{Command, Engage};

/// A docking under way and who waits for it.
#[derive(Debug)]
pub(super) struct Homing {
    pub(super) docking: Docking,
    /// Begun by the watchdog: no behaviour can end it.
    pub(super) forced: bool,
    pub(super) callers: Vec<Caller>,
}

impl Homing {
    /// The highest of those that wait for it.
    pub(super) fn priority(&self) -> Option<Priority> {
        self.callers.iter().map(|caller| caller.priority).max()
    }
}

impl Watchdog {
    /// How far a behaviour's docking backs off between tries: at this power ...
    const BACK_OFF_PERCENT: f64 = 30.0;
    /// ... for this long.
    pub(super) const BACK_OFF_TIME: Duration = Duration::from_millis(1500);

    /// The rule above all others: stop and go home, in one batch of acts.
    pub(super) fn became_low(&mut self, cause: LowCause, now: Instant) {
        self.end_motion(MotionEnd::Safety);
        self.whereabouts.expect_charge(now);
        if let Some(battery) = self.battery() {
            self.acts.push(Act::Announce(Event::BatteryLow(battery)));
        }
        let (action, what) = if self.docked() {
            let what = "stays on the station and waits for charging";
            (SafetyAction::Hold, what)
        } else {
            (SafetyAction::Dock, "stops and goes home")
        };
        self.notice(action, format!("{cause}: {what}"));
        self.pursue_home(now);
    }

    pub(super) fn released(&mut self, now: Instant) {
        self.end_alarm();
        if let Some(battery) = self.battery() {
            self.notice(
                SafetyAction::Release,
                format!("battery at {}", battery.percent),
            );
            self.acts.push(Act::Announce(Event::BatteryOk(battery)));
        }
        let Some(homing) = &mut self.homing else {
            return;
        };
        if homing.forced && homing.callers.is_empty() {
            let orders = homing.docking.cancel(DockEnd::Cancelled, now);
            self.follow(orders, now);
        } else {
            homing.forced = false;
        }
    }

    /// Low, off the station and not on the way home: goes home. A behaviour's docking becomes the
    /// watchdog's own.
    pub(super) fn pursue_home(&mut self, now: Instant) {
        let underway = self.homing.as_ref().is_some_and(|homing| homing.forced);
        if !self.online || self.guard.low().is_none() || underway || self.alarm.is_some() {
            return;
        }
        self.send_home(self.limits.dock_retries, now);
    }

    /// Begins the watchdog's own docking, with so many tries after the first.
    pub(super) fn send_home(&mut self, retries: u32, now: Instant) {
        let plan = DockPlan {
            timeout: self.limits.dock_timeout.get(),
            retries,
            charge_timeout: self.limits.charge_timeout.get(),
        };
        let approach = Approach {
            plan,
            retry: Retry::Pause(self.limits.dock_pause.get()),
        };
        let callers = self
            .homing
            .take()
            .map(|homing| homing.callers)
            .unwrap_or_default();
        self.start_homing(approach, callers, now);
        if let Some(homing) = &mut self.homing {
            homing.forced = true;
        }
    }

    pub(super) fn start_homing(&mut self, approach: Approach, callers: Vec<Caller>, now: Instant) {
        self.end_motion(MotionEnd::Preempted);
        let (docking, orders) = Docking::start(approach, self.docked(), now);
        self.homing = Some(Homing {
            docking,
            forced: false,
            callers,
        });
        self.follow(orders, now);
    }

    pub(super) fn continue_homing(&mut self, now: Instant) {
        if !self.online || self.may_charge() {
            return;
        }
        let orders = self.homing.as_mut().map(|homing| homing.docking.poll(now));
        self.follow(orders.unwrap_or_default(), now);
        self.pursue_home(now);
        self.continue_recovery(now);
    }

    /// Does what the docking wants, then looks whether it is over.
    pub(super) fn follow(&mut self, orders: Vec<Order>, now: Instant) {
        for order in orders {
            match order {
                Order::Find => {
                    self.halt(now);
                    self.send(Command::Engine(Engage::Dock));
                }
                Order::Cancel => {
                    self.send(Command::Engine(Engage::CancelDock));
                    self.halt(now);
                }
                Order::Reverse => {
                    self.halt(now);
                    self.tracks.want(Watchdog::back_off());
                }
                Order::Halt => self.halt(now),
                Order::Undock => {
                    let timeout = Docking::LEAVE_TIMEOUT;
                    self.whereabouts.leave_station(timeout, now);
                    self.send(Command::Engine(Engage::Undock));
                }
            }
        }
        self.answer_homing(now);
    }

    /// Tells whoever waits for a docking that is over; a forced one that failed sounds the alarm.
    pub(super) fn answer_homing(&mut self, now: Instant) {
        let over = |homing: &mut Homing| homing.docking.outcome().is_some();
        let Some(homing) = self.homing.take_if(over) else {
            return;
        };
        let Some(outcome) = homing.docking.outcome() else {
            return;
        };
        let gave_up = !matches!(
            outcome.end,
            DockEnd::Done | DockEnd::AlreadyDocked | DockEnd::Cancelled | DockEnd::Disconnected
        );
        let end = if homing.forced && gave_up {
            DockEnd::Safety
        } else {
            outcome.end
        };
        for caller in homing.callers {
            self.answer_dock(caller, end, outcome.attempts, outcome.took);
        }
        if homing.forced && gave_up {
            self.give_up(outcome, now);
        } else if let Some(alarm) = &mut self.alarm {
            alarm.recovery.interrupt(now);
        }
    }

    fn back_off() -> Setpoint {
        let backwards = -Watchdog::BACK_OFF_PERCENT;
        Setpoint::from_percent(backwards, backwards).unwrap_or(Setpoint::STOP)
    }
}
