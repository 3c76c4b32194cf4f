//! A robot with a low battery that could not get home: the alarm, and the tries that follow.

use std::time::Duration;

use tokio::time::Instant;

use super::Watchdog;
use crate::robot::{DockEnd, SafetyAction, Setpoint};
use crate::safety::{Outcome, Recovery, Try};
use crate::wire::{Command, Led, Sound};

/// The alarm, and what is done about its cause.
#[derive(Debug)]
pub(super) struct Alarm {
    pub(super) next: Instant,
    flash_on: bool,
    pub(super) recovery: Recovery,
}

impl Watchdog {
    /// How long the flash of the alarm stays on.
    const ALARM_FLASH: Duration = Duration::from_secs(1);

    /// The watchdog's own docking has failed: for the first time, or in one of the tries after that.
    pub(super) fn give_up(&mut self, outcome: Outcome, now: Instant) {
        let may_drive = self.may_drive_a_leg(now);
        let alarm = self.alarm.get_or_insert_with(|| Alarm {
            next: now,
            flash_on: false,
            recovery: Recovery::new(&self.limits, now),
        });
        let pause = alarm.recovery.failed(outcome.end, may_drive, now);
        let next = match self.docked() {
            true => "stays on the station".to_owned(),
            false if outcome.end == DockEnd::NotCharging => "searches again".to_owned(),
            false if pause.is_zero() => "tries again from elsewhere".to_owned(),
            false => format!("tries again in {} s", pause.as_secs_f64()),
        };
        let (end, attempts) = (outcome.end, outcome.attempts);
        let reason = format!("docking failed ({end}) {attempts} times: {next}");
        self.notice(SafetyAction::Alarm, reason);
    }

    /// Off the station and without a search under way: the next leg or the next search when it is time.
    pub(super) fn continue_recovery(&mut self, now: Instant) {
        if !self.is_recovering() {
            return;
        }
        let may_drive = self.may_drive_a_leg(now);
        let Some(alarm) = &mut self.alarm else {
            return;
        };
        match alarm.recovery.poll(may_drive, now) {
            None => {}
            Some(Try::Leg) => {
                let (leg, most) = (alarm.recovery.legs(), self.limits.recovery_legs);
                let reason =
                    format!("drives a short leg, {leg} of {most}, and searches from there");
                self.notice(SafetyAction::Dock, reason);
            }
            Some(Try::Search) => self.send_home(0, now),
        }
    }

    /// When [`Watchdog::continue_recovery`] has something to do.
    pub(super) fn recovery_deadline(&self) -> Option<Instant> {
        let alarm = self.alarm.as_ref().filter(|_| self.is_recovering())?;
        alarm.recovery.next_deadline(self.ticked)
    }

    /// What the watchdog's own leg wants of the tracks; `None` without one.
    pub(super) fn leg(&self, now: Instant) -> Option<Setpoint> {
        let alarm = self.alarm.as_ref().filter(|_| self.is_recovering())?;
        let setpoint = alarm.recovery.setpoint(now)?;
        self.may_drive_a_leg(now).then_some(setpoint)
    }

    /// A leg under way ends; the search follows.
    pub(super) fn end_leg(&mut self, now: Instant) {
        if let Some(alarm) = &mut self.alarm {
            alarm.recovery.end_leg(now);
        }
    }

    /// Out of reach, or on the station: no leg and no search is under way any more.
    pub(super) fn interrupt_recovery(&mut self, now: Instant) {
        if let Some(alarm) = &mut self.alarm {
            alarm.recovery.interrupt(now);
        }
    }

    /// The robot is somewhere else, or nobody knows what it does: a low one searches from there now.
    pub(super) fn search_at_once(&mut self, now: Instant) {
        if let Some(alarm) = &mut self.alarm {
            alarm.recovery.search_at_once(now);
        }
    }

    fn is_recovering(&self) -> bool {
        self.online && !self.docked() && self.homing.is_none()
    }

    /// Only while it is known that there is more than the critical level, and never at the end of a run.
    fn may_drive_a_leg(&self, now: Instant) -> bool {
        !self.parting && !self.docked() && !self.guard.critical() && self.guard.is_fresh(now)
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
        let due = |alarm: &&mut Alarm| self.online && alarm.next <= now;
        let Some(alarm) = self.alarm.as_mut().filter(due) else {
            return;
        };
        alarm.flash_on = !alarm.flash_on;
        let pause = match alarm.flash_on {
            true => Watchdog::ALARM_FLASH,
            false => self
                .limits
                .alarm_every
                .get()
                .saturating_sub(Watchdog::ALARM_FLASH),
        };
        alarm.next = now + pause.max(Watchdog::ALARM_FLASH);
        let on = alarm.flash_on;
        if on {
            self.send(Command::Play(Sound::Alarm));
        }
        self.send(Command::Led {
            led: Led::Flash,
            on,
        });
    }
}
