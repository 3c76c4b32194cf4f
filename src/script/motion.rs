//! The script's current setpoint, as far as the script knows, and its owner.

use std::time::Duration;

use tokio::time::Instant;

use super::task::{SubscriptionId, TaskId};
use crate::robot::{MotionId, Setpoint};

/// The owner of a setpoint; a setpoint ends with its owner. A handler's setpoint belongs to its
/// subscription, so it outlives the single run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Owner {
    Task(TaskId),
    Subscription(SubscriptionId),
    /// All lines that a person types: a setpoint lasts from one line to the next.
    Lines,
}

#[derive(Debug, Clone, Copy)]
struct Current {
    motion: MotionId,
    owner: Owner,
    setpoint: Setpoint,
    /// How long the tracks run on after its time; `None` if it ends by another call only.
    runs_on: Option<Duration>,
    /// It waits until the robot's queue has room for it.
    waits: bool,
    since: Instant,
}

#[derive(Debug, Default)]
pub(super) struct Motion {
    last: u64,
    current: Option<Current>,
}

impl Motion {
    pub(super) fn set(
        &mut self,
        owner: Owner,
        setpoint: Setpoint,
        runs_on: Option<Duration>,
        now: Instant,
    ) -> MotionId {
        self.last += 1;
        let motion = MotionId(self.last);
        self.current = Some(Current {
            motion,
            owner,
            setpoint,
            runs_on,
            waits: false,
            since: now,
        });
        motion
    }

    /// Whether exactly this setpoint is already active, without a time limit and with the same
    /// owner.
    pub(super) fn is_set(&self, owner: Owner, setpoint: Setpoint) -> bool {
        self.current.is_some_and(|current| {
            current.owner == owner && current.setpoint == setpoint && current.runs_on.is_none()
        })
    }

    /// Removes the setpoint of an owner that has ended; returns the motion to release, if it was
    /// the current one.
    pub(super) fn release(&mut self, owner: Owner) -> Option<MotionId> {
        let current = self.current.filter(|current| current.owner == owner)?;
        self.current = None;
        Some(current.motion)
    }

    /// Removes the current setpoint, whoever owns it; returns the motion to release.
    pub(super) fn release_any(&mut self) -> Option<MotionId> {
        self.current.take().map(|current| current.motion)
    }

    /// Records that a motion waits for the robot's queue, or that it has begun.
    pub(super) fn set_waiting(&mut self, motion: MotionId, waits: bool, now: Instant) {
        if let Some(current) = &mut self.current
            && current.motion == motion
        {
            current.waits = waits;
            current.since = now;
        }
    }

    /// Records that the robot side has ended a motion. Returns how long the tracks run on.
    pub(super) fn ended(&mut self, motion: MotionId) -> Duration {
        let ended = self.current.take_if(|current| current.motion == motion);
        ended
            .and_then(|current| current.runs_on)
            .unwrap_or_default()
    }

    pub(super) fn current(&self) -> Option<MotionId> {
        self.current.map(|current| current.motion)
    }

    /// The setpoint of the current motion, unless it waits for the robot's queue.
    pub(super) fn begun(&self) -> Option<Setpoint> {
        let current = self.current.filter(|current| !current.waits)?;
        Some(current.setpoint)
    }

    /// The current motion if it has a time limit, and since when it is active.
    pub(super) fn timed(&self) -> Option<(MotionId, Setpoint, Instant)> {
        let current = self
            .current
            .filter(|current| current.runs_on.is_some() && !current.waits)?;
        Some((current.motion, current.setpoint, current.since))
    }

    pub(super) fn waits(&self) -> bool {
        self.current.is_some_and(|current| current.waits)
    }

    pub(super) fn is_on(&self) -> bool {
        self.begun().is_some_and(|setpoint| !setpoint.is_stop())
    }
}
