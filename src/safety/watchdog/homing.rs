//! Low battery and the way home: the watchdog's own docking, a behaviour's docking that it takes
//! over, and the alarm when all tries have failed.

use std::time::Duration;

use tokio::time::Instant;

use super::Watchdog;
use crate::robot::{
    Battery, BehaviourId, CallId, DockEnd, DockPlan, Event, MotionEnd, SafetyAction, Setpoint,
};
use crate::safety::{Act, Approach, Docking, Limits, LowCause, Order, Retry};
use crate::wire::{Command, Engage, Led, Power, Sound};

/// A docking under way and who waits for it.
#[derive(Debug)]
pub(super) struct Homing {
    pub(super) docking: Docking,
    /// Begun by the watchdog: no behaviour can end it.
    pub(super) forced: bool,
    pub(super) callers: Vec<(BehaviourId, CallId)>,
}

/// The alarm of a robot that cannot get home.
#[derive(Debug, Clone, Copy)]
pub(super) struct Alarm {
    pub(super) next: Instant,
    flash_on: bool,
}

impl Watchdog {
    /// How far a behaviour's docking backs off between tries: at this power ...
    const BACK_OFF_PERCENT: f64 = 30.0;
    /// ... for this long.
    pub(super) const BACK_OFF_TIME: Duration = Duration::from_millis(1500);
    /// How long the flash of the alarm stays on.
    const ALARM_FLASH: Duration = Duration::from_secs(1);

    /// The rule above all others: stop and go home, in one batch of acts.
    pub(super) fn became_low(&mut self, cause: LowCause, now: Instant) {
        self.end_motion(MotionEnd::Safety);
        if let Some(battery) = self.battery.map(Battery::from) {
            self.acts.push(Act::Announce(Event::BatteryLow(battery)));
        }
        let (action, what) = match self.on_station {
            true => (
                SafetyAction::Hold,
                "stays on the station and waits for charging",
            ),
            false => (SafetyAction::Dock, "stops and goes home"),
        };
        self.notice(action, format!("{cause}: {what}"));
        self.pursue_home(now);
    }

    pub(super) fn released(&mut self, power: Power, now: Instant) {
        self.end_alarm();
        self.notice(
            SafetyAction::Release,
            format!("battery at {} %", power.percent),
        );
        self.acts
            .push(Act::Announce(Event::BatteryOk(power.into())));
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
        let Limits {
            dock_timeout,
            dock_retries,
            charge_timeout,
            dock_pause,
            ..
        } = &self.limits;
        let plan = DockPlan {
            timeout: dock_timeout.get(),
            retries: *dock_retries,
            charge_timeout: charge_timeout.get(),
        };
        let approach = Approach {
            plan,
            retry: Retry::Pause(dock_pause.get()),
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

    pub(super) fn start_homing(
        &mut self,
        approach: Approach,
        callers: Vec<(BehaviourId, CallId)>,
        now: Instant,
    ) {
        self.end_motion(MotionEnd::Preempted);
        let (docking, orders) = Docking::start(approach, self.on_station, now);
        self.homing = Some(Homing {
            docking,
            forced: false,
            callers,
        });
        self.follow(orders, now);
    }

    pub(super) fn continue_homing(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        let orders = self.homing.as_mut().map(|homing| homing.docking.poll(now));
        self.follow(orders.unwrap_or_default(), now);
        self.pursue_home(now);
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
                Order::Undock => self.send(Command::Engine(Engage::Undock)),
            }
        }
        self.answer_homing(now);
    }

    /// Tells whoever waits for a docking that is over; a forced one that failed ends in the alarm.
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
            self.alarm = Some(Alarm {
                next: now,
                flash_on: false,
            });
            let reason = format!(
                "docking failed ({}) {} times",
                outcome.end, outcome.attempts
            );
            self.notice(SafetyAction::Alarm, reason);
        }
    }

    /// Leaves no light on that the alarm has switched on.
    pub(super) fn end_alarm(&mut self) {
        if self.alarm.take().is_some_and(|alarm| alarm.flash_on) {
            self.send(Command::Led {
                led: Led::Flash,
                on: false,
            });
        }
    }

    pub(super) fn sound_alarm(&mut self, now: Instant) {
        let Some(alarm) = self.alarm.filter(|alarm| self.online && alarm.next <= now) else {
            return;
        };
        let flash_on = !alarm.flash_on;
        let pause = match flash_on {
            true => Watchdog::ALARM_FLASH,
            false => self
                .limits
                .alarm_every
                .get()
                .saturating_sub(Watchdog::ALARM_FLASH),
        };
        if flash_on {
            self.send(Command::Play(Sound::Alarm));
        }
        self.send(Command::Led {
            led: Led::Flash,
            on: flash_on,
        });
        self.alarm = Some(Alarm {
            next: now + pause.max(Watchdog::ALARM_FLASH),
            flash_on,
        });
    }

    fn back_off() -> Setpoint {
        let backwards = -Watchdog::BACK_OFF_PERCENT;
        Setpoint::from_percent(backwards, backwards).unwrap_or(Setpoint::STOP)
    }
}
