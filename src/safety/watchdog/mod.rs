//! All safety rules combined: facts and the time go in, acts come out.
//!
//! Every command that can move the robot is made here and nowhere else. A behaviour's motion
//! request goes through the [`Arbiter`], then through [`Watchdog::refusal`]; if it passes,
//! [`Tracks`] sends it.

mod acts;
mod docks;
mod homing;
mod link;
mod power;
mod recovery;
mod requests;
mod rules;
mod search;
#[cfg(test)]
mod tests;

use tokio::time::Instant;

use self::homing::Homing;
pub use self::recovery::ALARM;
use self::recovery::Alarm;
use super::{
    Act, Arbiter, BatteryGuard, Charging, DockOutcome, DockState, DockTracker, Drain, Fact, Leases,
    Limits, LowCause, Recovery, Tracks, Trail,
};
use crate::robot::{
    Battery, BehaviourId, CallId, DockEnd, MotionEnd, Priority, Setpoint, Stroke, WatchdogState,
};
use crate::wire::EngineReport;

/// A behaviour that waits for a docking or an undocking.
#[derive(Debug, Clone, Copy)]
struct Caller {
    by: BehaviourId,
    priority: Priority,
    call: CallId,
}

/// An undocking that a behaviour waits for.
#[derive(Debug, Clone)]
struct Leaving {
    caller: Caller,
    until: Instant,
}

/// A docking that has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DockReport {
    /// The behaviour that asked for it first; `None` for the watchdog's own docking.
    pub by: Option<BehaviourId>,
    /// Its outcome.
    pub outcome: DockOutcome,
}

/// The safety rules as one state machine. See the module.
#[derive(Debug, Clone)]
pub struct Watchdog {
    limits: Limits,
    online: bool,
    run_ending: bool,
    dock_tracker: DockTracker,
    /// BASE_FIND was sent, and neither a report of the robot nor another command has ended the
    /// search.
    searching: bool,
    /// BASE_FIND was sent, and neither a report of the robot nor a BASE_FIND_CANCEL that was surely
    /// delivered has ended the search: a stop alone may not end it, and a link may lose the
    /// BASE_FIND_CANCEL.
    may_search: bool,
    /// When the BASE_FIND_CANCEL that was sent over this link counts as delivered; see `search`.
    cancel_delivered_at: Option<Instant>,
    guard: BatteryGuard,
    drain: Drain,
    arbiter: Arbiter,
    leases: Leases,
    tracks: Tracks,
    trail: Trail,
    /// The path from the station to where the battery became low, until the first search from there
    /// has failed or something else has moved the robot.
    path_from_station: Option<Vec<Stroke>>,
    homing: Option<Homing>,
    leaving: Option<Leaving>,
    /// Present while the battery is low.
    recovery: Option<Recovery>,
    /// The calls that wait until a robot with a low battery is home.
    waiting: Vec<Caller>,
    /// The behaviour that the tracks may be lent to.
    rescuer: Option<BehaviourId>,
    alarm: Option<Alarm>,
    streaming: bool,
    /// Since when the robot has moved without sending anything, pauses in the motion included.
    silent_motion_since: Option<Instant>,
    /// The time of the last [`Watchdog::tick`].
    ticked: Instant,
    acts: Vec<Act>,
    /// The last docking that has ended, until it is reported.
    dock_report: Option<DockReport>,
}

impl Watchdog {
    /// Begins without a link; nothing moves.
    pub fn new(limits: Limits, now: Instant) -> Watchdog {
        Watchdog {
            guard: BatteryGuard::new(&limits),
            leases: Leases::new(limits.host_silence.get(), limits.host_grace.get()),
            dock_tracker: DockTracker::new(limits.charge_timeout.get()),
            limits,
            online: false,
            run_ending: false,
            searching: false,
            may_search: false,
            cancel_delivered_at: None,
            drain: Drain::default(),
            arbiter: Arbiter::default(),
            tracks: Tracks::new(now),
            trail: Trail::new(now),
            path_from_station: None,
            homing: None,
            leaving: None,
            recovery: None,
            waiting: Vec::new(),
            rescuer: None,
            alarm: None,
            streaming: false,
            silent_motion_since: None,
            ticked: now,
            acts: Vec::new(),
            dock_report: None,
        }
    }

    /// Returns the docking that has ended since the last call, if one has.
    pub fn take_dock_report(&mut self) -> Option<DockReport> {
        self.dock_report.take()
    }

    /// Takes a fact in and returns what to do now.
    pub fn take(&mut self, fact: Fact, now: Instant) -> Vec<Act> {
        self.absorb(fact, now);
        self.tick(now)
    }

    /// Takes a fact in without returning acts: they come with the next [`Watchdog::tick`] or
    /// [`Watchdog::take`], which must follow immediately. For facts that arrive together.
    pub fn absorb(&mut self, fact: Fact, now: Instant) {
        match fact {
            Fact::LinkUp { docked, power } => self.link_up(docked, power, now),
            Fact::LinkDown => self.link_down(now),
            Fact::BytesReceived => self.note_received(now),
            Fact::Power(power) => self.power(power, now),
            Fact::Engine(news) => self.engine(news, now),
            Fact::Streaming(on) => {
                if on && !self.streaming {
                    self.note_received(now);
                }
                self.streaming = on;
            }
            Fact::Asked {
                by,
                priority,
                intent,
            } => self.asked(by, priority, intent, now),
            Fact::Alive(by) => self.leases.renew(by, now),
            Fact::Gone(by) => self.gone(by, now),
            Fact::Rescuer(by) => self.set_rescuer(by, now),
            Fact::Suspended => self.wake(now),
            Fact::RunEnding => self.end_run(now),
        }
    }

    /// Advances the time and returns what to do now.
    pub fn tick(&mut self, now: Instant) -> Vec<Act> {
        self.ticked = now;
        self.confirm_cancel(now);
        self.check_hosts(now);
        self.check_stream(now);
        let over = self.arbiter.expire(now);
        self.tell_ended(over);
        self.check_place(now);
        self.check_power_silence(now);
        self.continue_homing(now);
        self.check_leaving(now);
        self.sound_alarm(now);
        self.drive(now);
        self.trail.record(self.tracks.last_sent(), now);
        self.drain.advance(self.activity(), now);
        std::mem::take(&mut self.acts)
    }

    /// When [`Watchdog::tick`] has something to do, seen from its last call. A time in the past
    /// means at once.
    pub fn next_deadline(&self) -> Option<Instant> {
        if !self.online {
            return None;
        }
        let homing = match &self.homing {
            Some(homing) if !self.may_charge() => homing.docking.next_deadline(),
            _ => None,
        };
        let silence = if self.docked() {
            None
        } else {
            self.guard.next_deadline()
        };
        [
            self.arbiter.next_deadline(),
            self.leases
                .next_deadline(self.arbiter.claimants(), self.ticked),
            self.tracks.next_deadline(),
            self.stream_deadline(),
            self.leaving.as_ref().map(|leaving| leaving.until),
            self.dock_tracker.next_deadline(self.guard.low().is_some()),
            self.alarm.as_ref().map(|alarm| alarm.next),
            self.recovery_deadline(),
            silence,
            self.guard.unconfirmed_deadline(),
            homing,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// The state shown in the status line.
    pub fn state(&self) -> WatchdogState {
        match (&self.homing, &self.alarm) {
            _ if !self.online => WatchdogState::Offline,
            (_, Some(_)) => WatchdogState::Alarm,
            _ if self.guard.low().is_some() && !self.docked() => WatchdogState::LowGoingHome,
            _ if self.docked() => WatchdogState::Docked,
            (Some(_), _) => WatchdogState::Docking,
            (None, None) => WatchdogState::Free,
        }
    }

    /// Why the battery counts as low; `None` if it does not, or the robot was released.
    pub fn low(&self) -> Option<LowCause> {
        self.guard.low()
    }

    /// Where the robot is.
    pub fn place(&self) -> DockState {
        self.dock_tracker.place()
    }

    /// Whether the robot is on its station, by its own report or because it charges.
    pub fn docked(&self) -> bool {
        self.dock_tracker.on_station()
    }

    /// What is believed of the battery; `None` before the first report.
    pub fn battery(&self) -> Option<Battery> {
        let minutes = self.drain.minutes_left();
        Some(Battery {
            percent: self.guard.level()?,
            charging: self.guard.charging() == Charging::Confirmed,
            minutes_left: minutes.map(|minutes| (minutes * 10.0).round() as f32 / 10.0),
        })
    }

    /// Whether the last setpoint sent to the tracks moves them.
    pub fn moving(&self) -> bool {
        self.tracks.moving_since().is_some()
    }

    /// Whether the robot may be in motion: its tracks were told to move, it searches for its
    /// station, or it leaves it.
    pub fn is_robot_moving(&self) -> bool {
        self.moving() || self.searching || self.leaving.is_some() || self.dock_tracker.is_leaving()
    }

    /// Why no behaviour, except one that has borrowed the tracks, may move the robot now; `None` if
    /// all may.
    pub fn refusal(&self) -> Option<MotionEnd> {
        if !self.online {
            Some(MotionEnd::Disconnected)
        } else if self.run_ending {
            Some(MotionEnd::Cancelled)
        } else if self.guard.low().is_some() || self.guard.critical() {
            Some(MotionEnd::Safety)
        } else if self.docked() || self.dock_tracker.is_leaving() {
            Some(MotionEnd::Docked)
        } else if self.homing.is_some() {
            Some(MotionEnd::Preempted)
        } else {
            None
        }
    }

    fn engine(&mut self, news: EngineReport, now: Instant) {
        match news {
            EngineReport::Docked => {
                self.search_ended();
                self.dock_tracker.docked(now);
                self.end_motion(MotionEnd::Docked);
                self.interrupt_recovery(now);
            }
            EngineReport::Undocked => self.undocked(now),
            EngineReport::BaseNotFound => self.search_ended(),
            EngineReport::Charged | EngineReport::Unknown(_) => {}
        }
        let actions = self
            .homing
            .as_mut()
            .map(|homing| homing.docking.engine(news, now));
        self.execute_dock_actions(actions.unwrap_or_default(), now);
        if news == EngineReport::Undocked && self.homing.is_none() {
            self.search_at_once(now);
        }
        let change = match news {
            EngineReport::Docked => self.guard.contact(),
            _ => None,
        };
        self.apply_battery_change(change, now);
    }

    fn undocked(&mut self, now: Instant) {
        // The position of a robot that left without being asked is not known: it may have been
        // carried.
        if self.dock_tracker.is_leaving() {
            self.trail.begin(now)
        } else {
            self.trail.lose()
        }
        self.path_from_station = None;
        self.dock_tracker.undocked(now);
        self.guard.undocked();
        self.guard.excuse_silence(now);
        if let Some(leaving) = self.leaving.take() {
            self.answer_undock(leaving.caller, DockEnd::Done);
        }
    }

    fn gone(&mut self, by: BehaviourId, now: Instant) {
        self.arbiter.forget(by);
        self.leases.forget(by);
        if self
            .leaving
            .as_ref()
            .is_some_and(|leaving| leaving.caller.by == by)
        {
            self.leaving = None;
        }
        self.waiting.retain(|caller| caller.by != by);
        if self.rescuer == Some(by) {
            self.set_rescuer(None, now);
        }
        let Some(homing) = &mut self.homing else {
            return;
        };
        homing.callers.retain(|caller| caller.by != by);
        if homing.callers.is_empty() && !homing.forced {
            let actions = homing.docking.cancel(DockEnd::Cancelled, now);
            self.execute_dock_actions(actions, now);
        }
    }

    /// The only place that makes a MOVE other than a stop.
    fn drive(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        if self.homing.is_none() {
            let wanted = match self.refusal() {
                None => self.arbiter.setpoint(),
                Some(_) => self.between_searches(now).unwrap_or(Setpoint::STOP),
            };
            self.tracks.want(wanted);
        }
        if let Some(setpoint) = self.tracks.poll(now) {
            if !setpoint.is_stop() {
                self.silent_motion_since.get_or_insert(now);
            }
            self.send(setpoint.command());
        }
    }
}
