//! What behaviours ask for that moves the tracks; docking and undocking stand in `docks`.

use std::time::Duration;

use tokio::time::Instant;

use super::{Caller, Watchdog};
use crate::robot::{BehaviourId, DockEnd, MotionEnd, MotionId, Priority, Setpoint};
use crate::safety::{Ask, Ended};

/// The longest time that is heeded, thirty days. A host may send any, and the clock that they are
/// added to ends somewhere.
pub(super) const LONGEST: Duration = Duration::from_secs(30 * 24 * 60 * 60);

impl Watchdog {
    pub(super) fn asked(&mut self, by: BehaviourId, priority: Priority, ask: Ask, now: Instant) {
        self.leases.renew(by, now);
        let caller = |call| Caller { by, priority, call };
        match ask {
            Ask::Move {
                motion,
                setpoint,
                duration,
            } => self.move_asked((by, priority), motion, setpoint, duration, now),
            Ask::Release(motion) => {
                let over = self.arbiter.release(by, motion);
                self.tell_ended(over);
            }
            Ask::Stop => self.stop_asked(by, priority, now),
            Ask::Dock(call, plan) => self.dock_asked(caller(call), plan, now),
            Ask::Undock(call, timeout) => self.undock_asked(caller(call), timeout, now),
            Ask::CancelDock => self.cancel_docks(Some((by, priority)), now),
        }
    }

    fn move_asked(
        &mut self,
        who: (BehaviourId, Priority),
        motion: MotionId,
        setpoint: Setpoint,
        duration: Option<Duration>,
        now: Instant,
    ) {
        if self.refusal() == Some(MotionEnd::Preempted) && self.outranks_docking(who.1) {
            self.end_docking(DockEnd::Preempted, now);
        }
        if let Some(end) = self.refusal() {
            let earlier = self.arbiter.clear_of(who.0, MotionEnd::Preempted);
            self.tell_ended(earlier);
            let by = who.0;
            return self.tell_ended(vec![Ended { by, motion, end }]);
        }
        let duration = duration.map(|duration| duration.min(LONGEST));
        let over = self.arbiter.wish(who, motion, setpoint, duration, now);
        self.tell_ended(over);
    }

    /// The way home of a low robot, with the watchdog's own legs, is no behaviour's to stop.
    fn stop_asked(&mut self, by: BehaviourId, priority: Priority, now: Instant) {
        let over = self.arbiter.stop(by, priority);
        self.tell_ended(over);
        if self.homing.as_ref().is_some_and(|homing| !homing.forced) {
            self.cancel_docks(Some((by, priority)), now);
        }
    }
}
