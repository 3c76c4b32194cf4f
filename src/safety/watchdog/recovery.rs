//! What a robot with a low battery does between two searches: loans, legs and pauses; and the
//! alarm.

use std::time::Duration;

use tokio::time::Instant;

use super::Watchdog;
use crate::robot::{BehaviourId, DockEnd, Event, MotionEnd, SafetyAction, Setpoint};
use crate::safety::{
    Act, Activity, AfterFailure, DockOutcome, DockState, HostLife, Recovery, RecoveryOptions,
    RecoveryStep, Rescue,
};
use crate::wire::{Command, Led, Sound};

/// The commands that sound the alarm: at full volume, whatever volume was set before.
pub const ALARM: [Command; 2] = [Command::Volume(100), Command::Play(Sound::Alarm)];

/// A person's help is needed.
#[derive(Debug, Clone)]
pub(super) struct Alarm {
    pub(super) next: Instant,
    flash_on: bool,
}

impl Watchdog {
    /// How long the flash of the alarm stays on.
    const ALARM_FLASH: Duration = Duration::from_secs(1);

    /// Whether a rescue behaviour should be running: the battery is low and the robot is not on its
    /// station. True some time before the first loan, so that its host has time to start.
    pub fn wants_rescue(&self) -> bool {
        let off = self.run_ending || self.limits.rescue == Rescue::Off;
        !off && self.guard.low().is_some() && !self.docked()
    }

    /// Whether to switch off everything that the way home does not need: the battery is nearly
    /// empty and does not charge. The rescue behaviour's camera and the alarm are needed.
    pub fn shed(&self) -> bool {
        self.guard.critical() && self.place() != DockState::Charging
    }

    /// Whether the alarm controls volume, headlight and sounds. It sets the volume to 100 % each
    /// time, because a script may have set it to 0 before. The volume is not restored: after the
    /// alarm it stays until the next script sets it.
    pub fn alarm_sounds(&self) -> bool {
        self.alarm.is_some() && self.online
    }

    /// Begins what follows a failed search of the watchdog's own.
    pub(super) fn handle_failed_search(&mut self, outcome: DockOutcome, now: Instant) {
        let options = self.recovery_options(outcome.took);
        let stuck = outcome.end == DockEnd::NotCharging && self.place() == DockState::Unknown;
        let Some(recovery) = &mut self.recovery else {
            return;
        };
        let next = recovery.failed(outcome.end, options, now);
        let failures = recovery.failures();
        if recovery.is_alarming() || stuck {
            self.alarm.get_or_insert(Alarm {
                next: now,
                flash_on: false,
            });
            self.answer_waiting(DockEnd::Safety, now);
        }
        let action = match self.alarm {
            Some(_) => SafetyAction::Alarm,
            None => SafetyAction::Dock,
        };
        let (end, next) = (outcome.end, self.begin(next, now));
        self.announce(
            action,
            format!("docking failed ({end}) {failures} times: {next}"),
        );
    }

    /// What may follow a search that took this long.
    fn recovery_options(&self, took: Duration) -> RecoveryOptions {
        let usable = !self.run_ending && !self.docked() && self.limits.rescue != Rescue::Off;
        let rates = [Activity::Searching, Activity::Standing].map(|what| self.drain.rate(what));
        let longest_useful_pause = match rates {
            // A known rate is above zero.
            [Some(searching), Some(standing)] => {
                took.mul_f64((searching / standing).clamp(0.5, 2.0))
            }
            _ => took,
        };
        RecoveryOptions {
            rescuer: if usable { self.rescuer } else { None },
            leg: self.may_drive_a_leg(),
            longest_useful_pause,
            critical: self.guard.critical(),
        }
    }

    /// Informs a borrower of its loan, and returns a description of what follows.
    fn begin(&mut self, next: AfterFailure, now: Instant) -> String {
        let way = self.path_from_station.take();
        match next {
            AfterFailure::Search => "searches again".into(),
            AfterFailure::Leg => {
                format!("drives short leg {}, and searches from there", self.legs())
            }
            AfterFailure::Pause(pause) => format!("tries again in {:.0} s", pause.as_secs_f64()),
            AfterFailure::Loan => {
                let (seconds, power) = (self.limits.rescue_time.get(), self.limits.rescue_power);
                if let Some(by) = self.borrower() {
                    let began = self.recovery.as_ref().map_or(now, Recovery::began);
                    let loan = Event::Loan {
                        seconds,
                        power,
                        low_for: now.saturating_duration_since(began),
                        way,
                    };
                    self.acts.push(Act::Tell(by, loan));
                }
                let seconds = seconds.as_secs_f64();
                format!("a rescue behaviour may drive for {seconds} s, then it searches from there")
            }
        }
    }

    /// Off the station and without a docking under way: begins the next leg or search when it is
    /// due.
    pub(super) fn continue_recovery(&mut self, now: Instant) {
        if self.docked() {
            return;
        }
        self.watch_borrower(now);
        let may_drive = self.may_drive_a_leg();
        let next = self
            .recovery
            .as_mut()
            .and_then(|recovery| recovery.poll(may_drive, now));
        match next {
            None => {}
            Some(RecoveryStep::Leg) => {
                self.end_motion(MotionEnd::Safety);
                let next = self.begin(AfterFailure::Leg, now);
                self.announce(
                    SafetyAction::Dock,
                    format!("no behaviour has driven: {next}"),
                );
            }
            Some(RecoveryStep::Search) => self.send_home(now),
        }
    }

    /// Notes whether the borrower drives, and ends its loan if its host falls silent meanwhile.
    fn watch_borrower(&mut self, now: Instant) {
        let Some(by) = self.borrower() else {
            return;
        };
        let moves = self.arbiter.claimants().any(|claimant| claimant == by);
        let silent = moves && self.leases.host_life(by, now) != HostLife::Alive;
        if let Some(recovery) = &mut self.recovery {
            recovery.note_motion(moves, now);
            if silent {
                recovery.end(now);
            }
        }
    }

    /// The recovery, while it is what the watchdog does.
    fn active_recovery(&self) -> Option<&Recovery> {
        if self.is_recovering() {
            self.recovery.as_ref()
        } else {
            None
        }
    }

    /// When [`Watchdog::continue_recovery`] has something to do.
    pub(super) fn recovery_deadline(&self) -> Option<Instant> {
        let recovery = self.active_recovery()?;
        recovery.next_deadline(self.ticked)
    }

    /// The setpoint of a robot with a low battery between two searches; `None` if the tracks stand
    /// still.
    pub(super) fn between_searches(&self, now: Instant) -> Option<Setpoint> {
        let recovery = self.active_recovery()?;
        if recovery.borrower().is_some() {
            return Some(self.arbiter.setpoint());
        }
        let setpoint = recovery.setpoint(now)?;
        self.may_drive_a_leg().then_some(setpoint)
    }

    /// The behaviour that the tracks are lent to now.
    pub(super) fn borrower(&self) -> Option<BehaviourId> {
        let recovery = self.active_recovery()?;
        recovery.borrower()
    }

    /// Ends a loan or a leg; the search follows.
    pub(super) fn end_loan(&mut self, now: Instant) {
        if let Some(recovery) = &mut self.recovery {
            recovery.end(now);
        }
    }

    /// Sets the behaviour that the tracks may be lent to. A loan to another behaviour ends.
    pub(super) fn set_rescuer(&mut self, by: Option<BehaviourId>, now: Instant) {
        self.rescuer = by;
        if let Some(recovery) = &mut self.recovery
            && recovery
                .borrower()
                .is_some_and(|borrower| by != Some(borrower))
        {
            recovery.end(now);
        }
    }

    /// Out of reach, or on the station: ends a loan, a leg or a search.
    pub(super) fn interrupt_recovery(&mut self, now: Instant) {
        self.path_from_station = None;
        self.trail.lose();
        if let Some(recovery) = &mut self.recovery {
            recovery.interrupt(now);
        }
    }

    /// The robot was moved, or its activity is not known: with a low battery it searches from there
    /// now.
    pub(super) fn search_at_once(&mut self, now: Instant) {
        if let Some(recovery) = &mut self.recovery {
            recovery.search_at_once(now);
        }
    }

    fn legs(&self) -> u32 {
        self.recovery.as_ref().map_or(0, |recovery| recovery.legs())
    }

    fn is_recovering(&self) -> bool {
        self.online && !self.docked() && self.homing.is_none()
    }

    /// Whether a leg is allowed: by the config, off the station, and before the run ends.
    fn may_drive_a_leg(&self) -> bool {
        !self.run_ending && !self.docked() && self.limits.recovery_legs > 0
    }

    /// Ends the alarm and switches off the light if the alarm has switched it on.
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
        let pause = if alarm.flash_on {
            Watchdog::ALARM_FLASH
        } else {
            self.limits
                .alarm_every
                .get()
                .saturating_sub(Watchdog::ALARM_FLASH)
        };
        alarm.next = now + pause.max(Watchdog::ALARM_FLASH);
        let on = alarm.flash_on;
        if on {
            ALARM.into_iter().for_each(|command| self.send(command));
        }
        self.send(Command::Led {
            led: Led::Flash,
            on,
        });
    }
}
