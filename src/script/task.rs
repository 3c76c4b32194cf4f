//! The tasks of a script: what each is, what it waits for, and what it is resumed with.

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

/// The most tasks that may live at once, timers and running handlers included.
pub(super) const MAX_TASKS: usize = 256;

/// What the script reads as `task.status`.
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
    /// Beats of `task.every` that came too late, in all.
    pub(super) missed: Cell<u64>,
}

/// What a task is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TaskKind {
    /// The file itself.
    Main,
    /// `task.spawn`, `task.delay`, `task.every`, `robot.blink`.
    Spawned,
    /// One run of a subscription's function.
    Handler(SubscriptionId),
    /// One function of a group.
    Child(GroupId, usize),
    /// A function of `script.on_stop`.
    Farewell,
    /// What a person typed.
    Line,
}

/// How far a cancellation has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cancel {
    No,
    /// The next wait fails.
    Asked,
    /// A wait has failed; the next one is the end.
    Told,
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
    /// For a module's file, or for the task that runs it.
    Module(ModuleId),
}

/// What a task is resumed with.
pub(super) enum Answer {
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
    /// What was waited for has changed: look again.
    Again,
    /// An error to raise in the task, with its place.
    Failed(String),
    Cancelled,
}

/// Waits, or will run.
pub(super) enum TaskPhase {
    Ready(Answer),
    Waiting(Wait),
    Running,
}

/// One coroutine of the script that the scheduler knows.
pub(super) struct Task {
    pub(super) thread: LuaThread,
    pub(super) kind: TaskKind,
    pub(super) phase: TaskPhase,
    pub(super) started: bool,
    pub(super) cancel: Cancel,
    pub(super) timer: Option<Timer>,
    pub(super) handle: Rc<Handle>,
    /// When `task.every` beats next.
    pub(super) beat: Option<Instant>,
    pub(super) pace: Pace,
}
