//! The tasks of a script: their kinds, what they wait for, what they are resumed with, and the queue
//! of those that are ready.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{LuaMultiValue, LuaThread, LuaValue};
use tokio::time::Instant;

use crate::api::EventName;
use crate::robot::{CallId, DockEnd, DockOutcome, Event, Frame, MotionEnd, MotionId};

/// Largest number of tasks at once, including timers and running handlers.
pub(super) const MAX_TASKS: usize = 256;

/// The shortest wait: shorter ones would let a script spin without time passing.
pub(super) const SHORTEST_WAIT: Duration = Duration::from_millis(1);
/// How often one task may be resumed within [`SHORTEST_WAIT`] before it must wait.
const MAX_RESUMPTIONS: u32 = 64;

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

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum TaskKind {
    /// The main chunk of the script's file.
    Main,
    /// `task.spawn`, `task.delay`, `task.every`, `robot.blink`.
    Spawned,
    Handler(SubscriptionId),
    Child(GroupId, usize),
    StopHandler,
    Line,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Cancel {
    No,
    /// The next wait fails.
    Requested,
    /// A wait has failed; the next wait ends the task.
    Raised,
}

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

/// What a handler gets, or a task that waits for an event.
#[derive(Clone)]
pub(super) enum Payload {
    Event(Rc<Event>),
    Frame(Rc<Frame>),
    Noise { dbfs: f64, own: bool },
}

pub(super) enum Wakeup {
    /// The arguments of the task's function.
    Start(LuaMultiValue),
    Slept(Duration),
    Beat(u64),
    Event(Payload),
    /// No event came: `nil, "timeout"`.
    NoEvent,
    /// `false, code`.
    Refused(&'static str),
    Motion(MotionEnd),
    Dock(DockOutcome),
    Undock(DockEnd),
    Joined(Status, Option<String>),
    Values(LuaMultiValue),
    /// The state has changed: the prelude must check again.
    Again,
    /// An error to raise in the task, with its place.
    Failed(String),
    Cancelled,
}

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

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct TaskId(pub(super) u64);

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct SubscriptionId(pub(super) u64);

/// Identifies a `task.all`, `task.race` or `task.timeout` in progress.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(super) struct GroupId(pub(super) u64);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ModuleId(pub(super) usize);

/// When a timer fires, and its number; timers with equal times fire in the order in which they were
/// set.
pub(super) type Timer = (Instant, u64);

/// How often a task was resumed within the current [`SHORTEST_WAIT`].
#[derive(Debug, Clone, Copy)]
pub(super) struct Pace {
    since: Instant,
    count: u32,
}

impl Pace {
    pub(super) fn new(now: Instant) -> Pace {
        Pace {
            since: now,
            count: 0,
        }
    }

    /// Counts a resumption; `true` if there were too many.
    pub(super) fn is_too_fast(&mut self, now: Instant) -> bool {
        if now.saturating_duration_since(self.since) >= SHORTEST_WAIT {
            *self = Pace::new(now);
        }
        self.count += 1;
        self.count > MAX_RESUMPTIONS
    }
}

/// When a group ends, and what its caller gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Rule {
    /// Ends when all tasks are done; returns the first result of each.
    All,
    /// Ends when the first task is done; returns its results.
    Race,
    /// Ends when its only task is done, and returns `true` and the results. At the timeout it ends
    /// with `false, "timeout"`.
    Timeout,
}

pub(super) struct Group {
    pub(super) parent: TaskId,
    pub(super) rule: Rule,
    pub(super) children: Vec<TaskId>,
    pub(super) results: Vec<LuaValue>,
    pub(super) missing: usize,
}

impl Group {
    pub(super) fn new(parent: TaskId, rule: Rule, children: Vec<TaskId>) -> Group {
        let missing = children.len();
        Group {
            parent,
            rule,
            results: vec![LuaValue::Nil; missing],
            children,
            missing,
        }
    }

    /// Records that a child is done. Returns the parent's results if that ends the group.
    pub(super) fn child_done(
        &mut self,
        index: usize,
        mut values: LuaMultiValue,
    ) -> Option<LuaMultiValue> {
        match self.rule {
            Rule::Race => Some(values),
            Rule::Timeout => {
                values.push_front(LuaValue::Boolean(true));
                Some(values)
            }
            Rule::All => {
                if let Some(result) = self.results.get_mut(index) {
                    *result = values.pop_front().unwrap_or(LuaValue::Nil);
                }
                self.missing -= 1;
                if self.missing > 0 {
                    return None;
                }
                Some(LuaMultiValue::from_vec(self.results.split_off(0)))
            }
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Due {
    /// The wait of a task has timed out.
    Wait(TaskId),
    /// A task that was delayed, or resumed too often, may run now.
    Run(TaskId),
    /// A subscription with a rate may handle its next event.
    Handle(SubscriptionId),
}

/// An entry of the queue: something that can run now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Ready {
    Task(TaskId),
    Handler(SubscriptionId),
}

/// All tasks, the queue of those that are ready, and the timers.
#[derive(Default)]
pub(super) struct Tasks {
    all: BTreeMap<TaskId, Task>,
    ready: VecDeque<Ready>,
    timers: BTreeMap<Timer, Due>,
    last_id: u64,
    pub(super) current: Option<TaskId>,
}

impl Tasks {
    pub(super) fn next_id(&mut self) -> u64 {
        self.last_id += 1;
        self.last_id
    }

    pub(super) fn len(&self) -> usize {
        self.all.len()
    }

    pub(super) fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    pub(super) fn get(&self, id: TaskId) -> Option<&Task> {
        self.all.get(&id)
    }

    pub(super) fn get_mut(&mut self, id: TaskId) -> Option<&mut Task> {
        self.all.get_mut(&id)
    }

    pub(super) fn ids(&self) -> Vec<TaskId> {
        self.all.keys().copied().collect()
    }

    /// The task that is running; `None` while the host calls.
    pub(super) fn running(&mut self) -> Option<&mut Task> {
        self.all.get_mut(&self.current?)
    }

    /// Adds a task that runs at `start`, or as soon as possible.
    pub(super) fn add(
        &mut self,
        thread: LuaThread,
        kind: TaskKind,
        answer: Wakeup,
        start: Option<Instant>,
        now: Instant,
    ) -> Rc<Handle> {
        let handle = self.insert(thread, kind, answer, now);
        let id = handle.id;
        match start {
            Some(at) => self.set_timer(id, at, Due::Run(id)),
            None => self.enqueue(id, now),
        }
        handle
    }

    /// Adds a task without putting it into the queue.
    pub(super) fn insert(
        &mut self,
        thread: LuaThread,
        kind: TaskKind,
        answer: Wakeup,
        now: Instant,
    ) -> Rc<Handle> {
        let id = TaskId(self.next_id());
        let handle = Rc::new(Handle {
            id,
            status: Cell::new(Status::Running),
            missed: Cell::new(0),
        });
        // A task inherits the pace of its creator, so that chains of tasks that create tasks are
        // slowed as well.
        let pace = self.running().map_or(Pace::new(now), |maker| maker.pace);
        let task = Task {
            thread,
            kind,
            phase: TaskPhase::Ready(answer),
            started: false,
            cancel: Cancel::No,
            timer: None,
            handle: Rc::clone(&handle),
            beat: None,
            pace,
        };
        self.all.insert(id, task);
        handle
    }

    pub(super) fn remove(&mut self, id: TaskId) -> Option<Task> {
        let task = self.all.remove(&id)?;
        if let Some(timer) = task.timer {
            self.timers.remove(&timer);
        }
        Some(task)
    }

    pub(super) fn wait(&mut self, id: TaskId, wait: Wait, deadline: Option<Instant>) {
        if let Some(task) = self.all.get_mut(&id) {
            task.phase = TaskPhase::Waiting(wait);
        }
        if let Some(at) = deadline {
            self.set_timer(id, at, Due::Wait(id));
        }
    }

    pub(super) fn wake(&mut self, id: TaskId, answer: Wakeup, now: Instant) {
        let Some(task) = self.all.get_mut(&id) else {
            return;
        };
        task.phase = TaskPhase::Ready(answer);
        if let Some(timer) = task.timer.take() {
            self.timers.remove(&timer);
        }
        self.enqueue(id, now);
    }

    pub(super) fn wake_at(&mut self, id: TaskId, answer: Wakeup, at: Instant) {
        if let Some(task) = self.all.get_mut(&id) {
            task.phase = TaskPhase::Ready(answer);
            if let Some(timer) = task.timer.take() {
                self.timers.remove(&timer);
            }
            self.set_timer(id, at, Due::Run(id));
        }
    }

    fn enqueue(&mut self, id: TaskId, now: Instant) {
        let Some(task) = self.all.get_mut(&id) else {
            return;
        };
        if task.pace.is_too_fast(now) {
            self.set_timer(id, now + SHORTEST_WAIT, Due::Run(id));
        } else {
            self.ready.push_back(Ready::Task(id));
        }
    }

    fn set_timer(&mut self, id: TaskId, at: Instant, due: Due) {
        let timer = (at, self.next_id());
        if let Some(task) = self.all.get_mut(&id) {
            task.timer = Some(timer);
            self.timers.insert(timer, due);
        }
    }

    pub(super) fn call_handler_at(&mut self, id: SubscriptionId, at: Instant) -> Timer {
        let timer = (at, self.next_id());
        self.timers.insert(timer, Due::Handle(id));
        timer
    }

    pub(super) fn cancel_timer(&mut self, timer: Timer) {
        self.timers.remove(&timer);
    }

    /// Puts the next run of a subscription's function into the queue.
    pub(super) fn call_handler(&mut self, id: SubscriptionId) {
        self.ready.push_back(Ready::Handler(id));
    }

    /// Puts a paced or delayed task, whose timer has fired, into the queue.
    pub(super) fn enqueue_due(&mut self, id: TaskId) {
        if let Some(task) = self.all.get_mut(&id) {
            task.timer = None;
            self.ready.push_back(Ready::Task(id));
        }
    }

    pub(super) fn next_due(&mut self, now: Instant) -> Option<Due> {
        let first = self.timers.first_entry()?;
        if first.key().0 > now {
            return None;
        }
        Some(first.remove())
    }

    pub(super) fn next_timer(&self) -> Option<Instant> {
        self.timers.keys().next().map(|(at, _)| *at)
    }

    pub(super) fn next_ready(&mut self) -> Option<Ready> {
        self.ready.pop_front()
    }

    pub(super) fn is_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    /// The tasks whose wait satisfies `wanted`, in the order of their creation.
    pub(super) fn waiting_for(&self, wanted: impl Fn(&Wait) -> bool) -> Vec<TaskId> {
        let waits = |task: &Task| matches!(&task.phase, TaskPhase::Waiting(wait) if wanted(wait));
        self.all
            .iter()
            .filter(|(_, task)| waits(task))
            .map(|(id, _)| *id)
            .collect()
    }

    pub(super) fn clear(&mut self) {
        self.all.clear();
        self.ready.clear();
        self.timers.clear();
    }
}
