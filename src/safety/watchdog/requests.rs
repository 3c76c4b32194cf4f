//! Requests of behaviours that move the tracks; docking and undocking are in `docks`.

use std::time::Duration;

use tokio::time::Instant;

use super::{Caller, Watchdog};
use crate::robot::{BehaviourId, DockEnd, Intent, MotionEnd, MotionId, Priority, Setpoint};
use crate::safety::{Ended, capped};

/// The longest duration, thirty days; longer ones are shortened to it. A host may send any
/// duration, and adding it to the clock could overflow.
pub(super) const LONGEST: Duration = Duration::from_secs(30 * 24 * 60 * 60);

impl Watchdog {
    pub(super) fn asked(
        &mut self,
        by: BehaviourId,
        priority: Priority,
        intent: Intent,
        now: Instant,
    ) {
        self.leases.renew(by, now);
        let caller = |call| Caller { by, priority, call };
        match intent {
            Intent::Move {
                motion,
                setpoint,
                duration,
            } => self.move_asked((by, priority), motion, setpoint, duration, now),
            Intent::Release { motion } => {
                let over = self.arbiter.release(by, motion);
                self.tell_ended(over);
            }
            Intent::Stop => self.stop_asked(by, priority, now),
            Intent::Dock { call, plan } => self.dock_asked(caller(call), plan, now),
            Intent::Undock { call, timeout } => self.undock_asked(caller(call), timeout, now),
            Intent::CancelDock => self.cancel_docks(Some((by, priority)), now),
            Intent::Led { .. }
            | Intent::Play(_)
            | Intent::StopSound
            | Intent::Volume(_)
            | Intent::Say(_)
            | Intent::Stream { .. } => {}
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
        let borrows = self.borrower() == Some(who.0);
        if let Some(end) = self.refusal()
            && !borrows
        {
            let earlier = self.arbiter.clear_of(who.0, MotionEnd::Preempted);
            self.tell_ended(earlier);
            let by = who.0;
            return self.tell_ended(vec![Ended { by, motion, end }]);
        }
        let setpoint = if borrows {
            capped(setpoint, self.limits.rescue_power)
        } else {
            setpoint
        };
        let duration = duration.map(|duration| duration.min(LONGEST));
        let over = self.arbiter.claim(who, motion, setpoint, duration, now);
        self.tell_ended(over);
    }

    /// No behaviour can stop the way home of a robot with a low battery, except its own part of it:
    /// a borrower's stop returns the tracks.
    fn stop_asked(&mut self, by: BehaviourId, priority: Priority, now: Instant) {
        match self.borrower() {
            Some(borrower) if borrower == by => self.end_loan(now),
            Some(_) => return,
            None => {}
        }
        let over = self.arbiter.stop(by, priority);
        self.tell_ended(over);
        if self.homing.as_ref().is_some_and(|homing| !homing.forced) {
            self.cancel_docks(Some((by, priority)), now);
        }
    }
}
