//! The rules that depend on time: silent hosts, silent streams, a silent battery.

use tokio::time::Instant;

use super::Watchdog;
use crate::robot::{BehaviourId, DockEnd, EndReason, MotionEnd, SafetyAction};
use crate::safety::{Act, BatteryChange, HostLife};

impl Watchdog {
    /// Holds the motion of a host that shows no life, and ends the host if it stays silent.
    pub(super) fn check_hosts(&mut self, now: Instant) {
        let moving: Vec<BehaviourId> = self.arbiter.claimants().collect();
        for by in moving {
            match self.leases.host_life(by, now) {
                HostLife::Alive => {
                    self.arbiter.hold(by, false);
                }
                HostLife::Silent => self.hold_silent(by, now),
                HostLife::Dead => self.end_silent(by, now),
            }
        }
    }

    /// A silent host that stands by does no harm: it is only kept from getting the tracks.
    fn hold_silent(&mut self, by: BehaviourId, now: Instant) {
        if self.arbiter.hold(by, true) && self.arbiter.driver() == Some(by) {
            self.halt(now);
            let silence = self.limits.host_silence.get().as_millis();
            self.announce(
                SafetyAction::Stop,
                format!("a script showed no life for {silence} ms"),
            );
        }
    }

    fn end_silent(&mut self, by: BehaviourId, now: Instant) {
        if self.arbiter.driver() == Some(by) {
            self.halt(now);
        }
        self.arbiter.forget(by);
        self.leases.forget(by);
        let silence = self.limits.host_silence.get() + self.limits.host_grace.get();
        let reason = format!("a script showed no life for {} ms", silence.as_millis());
        self.announce(SafetyAction::Kill, reason);
        self.acts.push(Act::Kill(by, EndReason::Cpu));
    }

    pub(super) fn stream_deadline(&self) -> Option<Instant> {
        if !self.streaming {
            return None;
        }
        let since = self.silent_motion_since?;
        Some(since + self.limits.stream_silence.get())
    }

    /// Stops a robot that moves while its stream is silent, and reconnects to find out whether it
    /// still answers.
    pub(super) fn check_stream(&mut self, now: Instant) {
        if self.stream_deadline().is_none_or(|due| due > now) {
            return;
        }
        self.silent_motion_since = None;
        self.halt(now);
        self.end_motion(MotionEnd::Disconnected);
        self.interrupt_recovery(now);
        let silence = self.limits.stream_silence.get().as_secs_f64();
        let reason = format!("no bytes from the robot for {silence} s while it moves");
        self.announce(SafetyAction::Reconnect, reason.clone());
        self.acts.push(Act::Reconnect(reason));
    }

    pub(super) fn check_power_silence(&mut self, now: Instant) {
        if !self.online {
            return;
        }
        if self
            .guard
            .unconfirmed_deadline()
            .is_some_and(|due| due <= now)
        {
            let change = self.guard.expire_unconfirmed(now);
            self.dock_tracker.power(false, now);
            self.apply_battery_change(change, now);
        }
        if self.docked() {
            self.guard.excuse_silence(now);
        } else if let Some(BatteryChange::BecameLow(cause)) = self.guard.poll(now) {
            self.became_low(cause, now);
        }
    }

    /// Lets a robot with a low battery search for its station when it may no longer be on it. If
    /// the contacts did not charge, the docking ends as failed, and the alarm calls for a person.
    pub(super) fn check_place(&mut self, now: Instant) {
        let low = self.guard.low().is_some();
        let Some(doubt) = self.dock_tracker.poll(low, now) else {
            return;
        };
        if !low {
            return;
        }
        if let Some(homing) = self.homing.as_mut().filter(|homing| homing.forced) {
            let actions = homing.docking.lost_contact(doubt, now);
            self.execute_dock_actions(actions, now);
        }
        self.search_at_once(now);
    }

    pub(super) fn check_leaving(&mut self, now: Instant) {
        if let Some(leaving) = self.leaving.take_if(|leaving| leaving.until <= now) {
            self.answer_undock(leaving.caller, DockEnd::Timeout);
        }
    }
}
