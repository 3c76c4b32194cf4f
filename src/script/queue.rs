//! Which task runs next: the queue of tasks that are ready, and the timers.

use std::cell::Cell;
use std::collections::{BTreeMap, VecDeque};
use std::rc::Rc;

use mlua::prelude::LuaThread;
use tokio::time::Instant;

use super::ids::{SubscriptionId, TaskId, Timer};
use super::pace::{Pace, SHORTEST_WAIT};
use super::task::{Cancel, Handle, Status, Task, TaskKind, TaskPhase, Wait, Wakeup};

/// What a timer is for.
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
    /// The task that is running.
    pub(super) current: Option<TaskId>,
}

impl Tasks {
    /// Returns the next unused id.
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

    fn insert(
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

    /// Adds a task that is run at once, without passing through the queue.
    pub(super) fn add_running(
        &mut self,
        thread: LuaThread,
        kind: TaskKind,
        answer: Wakeup,
        now: Instant,
    ) -> TaskId {
        let handle = self.insert(thread, kind, answer, now);
        handle.id
    }

    pub(super) fn remove(&mut self, id: TaskId) -> Option<Task> {
        let task = self.all.remove(&id)?;
        if let Some(timer) = task.timer {
            self.timers.remove(&timer);
        }
        Some(task)
    }

    /// Makes a task wait, at most until `deadline`.
    pub(super) fn wait(&mut self, id: TaskId, wait: Wait, deadline: Option<Instant>) {
        if let Some(task) = self.all.get_mut(&id) {
            task.phase = TaskPhase::Waiting(wait);
        }
        if let Some(at) = deadline {
            self.set_timer(id, at, Due::Wait(id));
        }
    }

    /// Ends a task's wait and puts the task into the queue.
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

    /// Sets a timer for a subscription.
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

    /// Takes the next timer that is due at `now`.
    pub(super) fn next_due(&mut self, now: Instant) -> Option<Due> {
        let first = self.timers.first_entry()?;
        (first.key().0 <= now).then(|| first.remove())
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

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.all.clear();
        self.ready.clear();
        self.timers.clear();
    }
}
