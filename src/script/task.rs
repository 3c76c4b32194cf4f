//! The tasks of a script: their kinds, what they wait for, and what they are resumed with.

use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{LuaMultiValue, LuaThread};
use tokio::time::Instant;

use super::events::{EventName, Payload};
pub(super) use super::ids::{GroupId, SubscriptionId, TaskId};
use super::ids::{ModuleId, Timer};
use super::pace::Pace;
pub(super) use super::pace::SHORTEST_WAIT;
use crate::robot::{CallId, DockEnd, MotionEnd, MotionId};

/// Largest number of tasks at once, including timers and running handlers.
pub(super) const MAX_TASKS: usize = 256;

/// The value of `task.status` in scripts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Status {
    Running,
    Done,
    Failed,
    Cancelled,
}

impl Status {
    pub(super) fn name(self) -> &'static str {
        match self {
            Status::Running => "running",
            Status::Done => "done",
            Status::Failed => "failed",
            Status::Cancelled => "cancelled",
        }
    }
}

/// The part of a task that outlives it: the script's Task objects hold it.
#[derive(Debug)]
pub(super) struct Handle {
    pub(super) id: TaskId,
    pub(super) status: Cell<Status>,
    /// Total number of beats of `task.every` that were missed.
    pub(super) missed: Cell<u64>,
}

/// The kind of a task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TaskKind {
    /// The main chunk of the script's file.
    Main,
    /// `task.spawn`, `task.delay`, `task.every`, `robot.blink`.
    Spawned,
    /// One run of a subscription's function.
    Handler(SubscriptionId),
    /// One function of a group.
    Child(GroupId, usize),
    /// A function of `script.on_stop`.
    StopHandler,
    /// A line that a person typed.
    Line,
}

/// The progress of a cancellation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cancel {
    No,
    /// The next wait fails.
    Requested,
    /// A wait has failed; the next wait ends the task.
    Raised,
}

/// What a task waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wait {
    Time {
        since: Instant,
    },
    Beat {
        missed: u64,
    },
    Event(EventName),
    Motion(MotionId),
    Dock(CallId),
    Undock(CallId),
    Join(TaskId),
    Group(GroupId),
    /// Waits for a module's file, or for the task that runs the module.
    Module(ModuleId),
}

/// What a task is resumed with.
pub(super) enum Wakeup {
    /// The first resumption.
    Start(LuaMultiValue),
    /// The first resumption of a handler.
    Deliver(Payload),
    Slept(Duration),
    Beat(u64),
    Event(Payload),
    /// No event came: `nil, "timeout"`.
    NoEvent,
    /// `false, code`.
    Refused(&'static str),
    Motion(MotionEnd),
    Dock {
        end: DockEnd,
        attempts: u32,
        took: Duration,
    },
    Undock(DockEnd),
    Joined(Status, Option<String>),
    Values(LuaMultiValue),
    /// The state has changed: the prelude must check again.
    Again,
    /// An error to raise in the task, with its place.
    Failed(String),
    Cancelled,
}

/// Whether a task is ready, waiting or running.
pub(super) enum TaskPhase {
    Ready(Wakeup),
    Waiting(Wait),
    Running,
}

/// A coroutine of the script that the scheduler manages.
pub(super) struct Task {
    pub(super) thread: LuaThread,
    pub(super) kind: TaskKind,
    pub(super) phase: TaskPhase,
    pub(super) started: bool,
    pub(super) cancel: Cancel,
    pub(super) timer: Option<Timer>,
    pub(super) handle: Rc<Handle>,
    /// When the next beat of `task.every` is due.
    pub(super) beat: Option<Instant>,
    pub(super) pace: Pace,
}
