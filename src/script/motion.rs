//! The one setpoint that a script has on, as far as it knows, and to whom it belongs.

use tokio::time::Instant;

use crate::robot::{MotionId, Setpoint};

use super::ids::{SubscriptionId, TaskId};

/// Who made a setpoint; it ends with its owner. A handler's setpoints outlive the single run: they
/// belong to its subscription.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Owner {
    Task(TaskId),
    Subscription(SubscriptionId),
    /// The lines that a person types: a setpoint holds from one to the next.
    Lines,
}

#[derive(Debug, Clone, Copy)]
struct Current {
    motion: MotionId,
    owner: Owner,
    setpoint: Setpoint,
    timed: bool,
    since: Instant,
}

/// See the module documentation.
#[derive(Debug, Default)]
pub(super) struct Motion {
    last: u64,
    current: Option<Current>,
}

impl Motion {
    /// A new setpoint takes the place of the one before.
    pub(super) fn set(
        &mut self,
        owner: Owner,
        setpoint: Setpoint,
        timed: bool,
        now: Instant,
    ) -> MotionId {
        self.last += 1;
        let motion = MotionId(self.last);
        self.current = Some(Current {
            motion,
            owner,
            setpoint,
            timed,
            since: now,
        });
        motion
    }

    /// Whether this very setpoint is on already, without an end, and by the same owner.
    pub(super) fn is_set(&self, owner: Owner, setpoint: Setpoint) -> bool {
        self.current.is_some_and(|current| {
            current.owner == owner && current.setpoint == setpoint && !current.timed
        })
    }

    /// An owner is gone: the setpoint to release, if it was the current one.
    pub(super) fn release(&mut self, owner: Owner) -> Option<MotionId> {
        let current = self.current.filter(|current| current.owner == owner)?;
        self.current = None;
        Some(current.motion)
    }

    /// The script is gone: the setpoint to release.
    pub(super) fn release_any(&mut self) -> Option<MotionId> {
        self.current.take().map(|current| current.motion)
    }

    /// A setpoint has ended out there.
    pub(super) fn ended(&mut self, motion: MotionId) {
        if self.current() == Some(motion) {
            self.current = None;
        }
    }

    /// The current setpoint.
    pub(super) fn current(&self) -> Option<MotionId> {
        self.current.map(|current| current.motion)
    }

    /// What the tracks should do now.
    pub(super) fn setpoint(&self) -> Option<Setpoint> {
        self.current.map(|current| current.setpoint)
    }

    /// The motion with a time that is on, and since when.
    pub(super) fn timed(&self) -> Option<(MotionId, Setpoint, Instant)> {
        let current = self.current.filter(|current| current.timed)?;
        Some((current.motion, current.setpoint, current.since))
    }

    /// Whether a track turns.
    pub(super) fn is_on(&self) -> bool {
        self.current
            .is_some_and(|current| !current.setpoint.is_stop())
    }
}
