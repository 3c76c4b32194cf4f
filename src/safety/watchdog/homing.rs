//! Low battery and the way home: the watchdog's own docking, and behaviours' dockings that it takes
//! over.

use std::time::Duration;

use tokio::time::Instant;

use super::{Caller, DockReport, Watchdog};
use crate::robot::{DockEnd, DockPlan, Event, MotionEnd, Priority, SafetyAction, Setpoint};
use crate::safety::{Act, DockAction, DockLimits, Docking, LowCause, Recovery, Retry};
use crate::wire::{Command, Engage};

/// A docking under way and the calls that wait for it.
#[derive(Debug, Clone)]
pub(super) struct Homing {
    pub(super) docking: Docking,
    /// Begun by the watchdog: no behaviour can end it.
    pub(super) forced: bool,
    pub(super) callers: Vec<Caller>,
}

impl Homing {
    /// The highest priority of its callers.
    pub(super) fn priority(&self) -> Option<Priority> {
        self.callers.iter().map(|caller| caller.priority).max()
    }
}

impl Watchdog {
    /// How a behaviour's docking backs off between attempts: at this power, percent ...
    const BACK_OFF_PERCENT: f64 = 30.0;
    /// ... for this long.
    pub(super) const BACK_OFF_TIME: Duration = Duration::from_millis(1500);

    /// The rule with the highest precedence: stop and go home, in one batch of acts.
    pub(super) fn became_low(&mut self, cause: LowCause, now: Instant) {
        self.end_motion(MotionEnd::Safety);
        self.path_from_station = self.trail.take(now);
        self.dock_tracker.expect_charge(now);
        if let Some(battery) = self.battery() {
            self.acts.push(Act::Announce(Event::BatteryLow(battery)));
        }
        let (action, what) = if self.docked() {
            let what = "stays on the station and waits for charging";
            (SafetyAction::Hold, what)
        } else {
            (SafetyAction::Dock, "stops and goes home")
        };
        self.announce(action, format!("{cause}: {what}"));
        self.recovery = Some(Recovery::new(&self.limits, now));
        self.pursue_home(now);
    }

    pub(super) fn released(&mut self, now: Instant) {
        self.end_alarm();
        if self.recovery.take().is_some() {
            self.end_motion(MotionEnd::Safety);
        }
        if let Some(battery) = self.battery() {
            let reason = format!("battery at {}", battery.percent);
            self.announce(SafetyAction::Release, reason);
            self.acts.push(Act::Announce(Event::BatteryOk(battery)));
        }
        let waiting = std::mem::take(&mut self.waiting);
        match self.homing.as_mut().filter(|homing| homing.forced) {
            Some(homing) if !waiting.is_empty() => {
                (homing.forced, homing.callers) = (false, waiting);
            }
            Some(_) => self.end_docking(DockEnd::Cancelled, now),
            None => {
                for caller in waiting {
                    self.answer_dock(caller, DockEnd::Safety, 0, Duration::ZERO);
                }
            }
        }
    }

    /// Starts or continues the way home if the battery is low and no docking of the watchdog's is
    /// under way. A behaviour's docking becomes the watchdog's own.
    pub(super) fn pursue_home(&mut self, now: Instant) {
        let underway = self.homing.as_ref().is_some_and(|homing| homing.forced);
        if !self.online || self.guard.low().is_none() || underway {
            return;
        }
        if self.docked() {
            return self.send_home(now);
        }
        if self.homing.is_some() {
            self.search_at_once(now);
        }
        self.continue_recovery(now);
    }

    /// Begins a search of the watchdog's own or, on the station, the wait for charging.
    pub(super) fn send_home(&mut self, now: Instant) {
        let plan = DockPlan {
            timeout: self.limits.dock_timeout.get(),
            retries: 0,
            charge_timeout: self.limits.charge_timeout.get(),
        };
        let retry = Retry::Never;
        if let Some(homing) = self.homing.take() {
            self.waiting.extend(homing.callers);
        }
        self.end_motion(MotionEnd::Safety);
        self.start_homing(DockLimits { plan, retry }, vec![], now);
        if let Some(homing) = &mut self.homing {
            homing.forced = true;
        }
    }

    pub(super) fn start_homing(
        &mut self,
        approach: DockLimits,
        callers: Vec<Caller>,
        now: Instant,
    ) {
        self.end_motion(MotionEnd::Preempted);
        self.tracks.want(Setpoint::STOP);
        let (docking, actions) = Docking::start(approach, self.docked(), now);
        self.homing = Some(Homing {
            docking,
            forced: false,
            callers,
        });
        self.execute_dock_actions(actions, now);
    }

    pub(super) fn continue_homing(&mut self, now: Instant) {
        if !self.online || self.may_charge() {
            return;
        }
        let actions = self.homing.as_mut().map(|homing| homing.docking.poll(now));
        self.execute_dock_actions(actions.unwrap_or_default(), now);
        self.pursue_home(now);
    }

    /// Executes the docking's actions, then checks whether it has ended.
    pub(super) fn execute_dock_actions(&mut self, actions: Vec<DockAction>, now: Instant) {
        for action in actions {
            match action {
                DockAction::Find => {
                    self.halt(now);
                    self.send(Command::Engine(Engage::Dock));
                }
                DockAction::Cancel => self.cancel_search(now),
                DockAction::Reverse => {
                    self.halt(now);
                    self.tracks.want(Watchdog::back_off());
                }
                DockAction::Halt => self.halt(now),
                DockAction::Undock => {
                    let timeout = Docking::LEAVE_TIMEOUT;
                    self.dock_tracker.leave_station(timeout, now);
                    self.send(Command::Engine(Engage::Undock));
                }
            }
        }
        self.answer_homing(now);
    }

    /// Answers the calls that wait for a docking that has ended; a failure of the watchdog's own
    /// goes to [`Watchdog::handle_failed_search`].
    pub(super) fn answer_homing(&mut self, now: Instant) {
        let over = |homing: &mut Homing| homing.docking.outcome().is_some();
        let Some(homing) = self.homing.take_if(over) else {
            return;
        };
        let Some(outcome) = homing.docking.outcome() else {
            return;
        };
        let by = match homing.callers.first() {
            Some(caller) if !homing.forced => Some(caller.by),
            _ => None,
        };
        self.dock_report = Some(DockReport { by, outcome });
        for caller in homing.callers {
            self.answer_dock(caller, outcome.end, outcome.attempts, outcome.took);
        }
        if !homing.forced {
            return;
        }
        match outcome.end {
            DockEnd::Done | DockEnd::AlreadyDocked => self.answer_waiting(DockEnd::Done, now),
            DockEnd::Disconnected => self.answer_waiting(DockEnd::Disconnected, now),
            _ => self.handle_failed_search(outcome, now),
        }
    }

    /// Tells the callers that wait for the watchdog's way home how it ended.
    pub(super) fn answer_waiting(&mut self, end: DockEnd, now: Instant) {
        let (failures, took) = self
            .recovery
            .as_ref()
            .map_or_else(Default::default, |recovery| {
                let took = now.saturating_duration_since(recovery.began());
                (recovery.failures(), took)
            });
        let attempts = failures + u32::from(end == DockEnd::Done);
        for caller in std::mem::take(&mut self.waiting) {
            self.answer_dock(caller, end, attempts, took);
        }
    }

    fn back_off() -> Setpoint {
        let backwards = -Watchdog::BACK_OFF_PERCENT;
        Setpoint::from_percent(backwards, backwards).unwrap_or(Setpoint::STOP)
    }
}
