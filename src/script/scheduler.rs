//! The scheduler's rules: which task runs next, how a task is cancelled, and what follows from its
//! end. Everything here works without running a line of the script.
//!
//! The order is the same in every run: ready tasks are queued, timers fire by time and then in the
//! order in which they were set, and tasks that wait for the same event wake in the order of their
//! creation.

use mlua::prelude::LuaMultiValue;

use super::events::Busy;
use super::ids::GroupId;
use super::life::Life;
use super::motion::Owner;
use super::output::Level;
use super::queue::Due;
use super::state::State;
use super::task::{Cancel, Status, SubscriptionId, TaskId, TaskKind, TaskPhase, Wait, Wakeup};
use crate::robot::{EndReason, Intent};

/// The error that the wait of a cancelled task raises.
pub(super) const CANCELLED: &str = "cancelled";

/// This many failures of a subscription's function in a row end the script.
const MAX_FAILURES: u32 = 5;

/// How a coroutine ended.
pub(super) enum Outcome {
    Done(LuaMultiValue),
    Failed(String),
    Cancelled,
}

impl Outcome {
    fn status(&self) -> Status {
        match self {
            Outcome::Done(_) => Status::Done,
            Outcome::Failed(_) => Status::Failed,
            Outcome::Cancelled => Status::Cancelled,
        }
    }

    fn text(&self) -> Option<String> {
        match self {
            Outcome::Failed(text) => Some(text.clone()),
            _ => None,
        }
    }
}

impl State {
    /// Fires every timer that is due.
    pub(super) fn fire_due_timers(&mut self) {
        while let Some(due) = self.tasks.next_due(self.now) {
            match due {
                Due::Wait(id) => self.time_out(id),
                Due::Run(id) => self.tasks.enqueue_due(id),
                Due::Handle(id) => {
                    if let Some(subscription) = self.subscriptions.get_mut(&id) {
                        subscription.busy = Busy::No;
                    }
                    self.schedule(id);
                }
            }
        }
    }

    /// Ends a wait whose time is over.
    fn time_out(&mut self, id: TaskId) {
        let Some(TaskPhase::Waiting(wait)) = self.tasks.get(id).map(|task| &task.phase) else {
            return;
        };
        let answer = match *wait {
            Wait::Time { since } => Wakeup::Slept(self.now.saturating_duration_since(since)),
            Wait::Beat { missed } => Wakeup::Beat(missed),
            Wait::Event(_) => Wakeup::NoEvent,
            Wait::Group(group) => {
                self.end_group(group);
                Wakeup::Refused("timeout")
            }
            Wait::Module(_) => Wakeup::Again,
            Wait::Join(_) | Wait::Motion(_) | Wait::Dock(_) | Wait::Undock(_) => {
                Wakeup::Refused("timeout")
            }
        };
        self.tasks.wake(id, answer, self.now);
    }

    /// Cancels a task: its motion ends now, its wait fails, and what it waits for is cancelled too.
    /// A task that has not started never starts.
    pub(super) fn cancel(&mut self, id: TaskId) {
        self.release(Owner::Task(id));
        let Some(task) = self.tasks.get_mut(id) else {
            return;
        };
        if task.cancel != Cancel::No {
            return;
        }
        task.cancel = Cancel::Raised;
        match &mut task.phase {
            TaskPhase::Running => task.cancel = Cancel::Requested,
            TaskPhase::Ready(_) if !task.started => self.finish(id, Outcome::Cancelled),
            TaskPhase::Ready(answer) => *answer = Wakeup::Cancelled,
            TaskPhase::Waiting(wait) => {
                let wait = *wait;
                self.cancel_wait(wait);
                self.tasks.wake(id, Wakeup::Cancelled, self.now);
            }
        }
    }

    /// Cancels what a task was waiting for.
    fn cancel_wait(&mut self, wait: Wait) {
        match wait {
            Wait::Motion(motion) if self.motion.current() == Some(motion) => {
                self.motion.ended(motion);
                self.output.send(Intent::Release { motion });
            }
            Wait::Dock(_) => self.output.send(Intent::CancelDock),
            Wait::Group(group) => self.end_group(group),
            _ => {}
        }
    }

    /// Handles the end of a task: ends its motion and wakes the tasks that wait for it.
    pub(super) fn finish(&mut self, id: TaskId, outcome: Outcome) {
        let Some(task) = self.tasks.remove(id) else {
            return;
        };
        let status = outcome.status();
        task.handle.status.set(status);
        self.release(Owner::Task(id));
        for waiter in self.tasks.waiting_for(|wait| *wait == Wait::Join(id)) {
            let answer = Wakeup::Joined(status, outcome.text());
            self.tasks.wake(waiter, answer, self.now);
        }
        match (task.kind, outcome) {
            (TaskKind::Child(group, index), outcome) => self.child_ended(group, index, outcome),
            (TaskKind::Handler(subscription), outcome) => {
                self.handler_ended(subscription, &outcome)
            }
            (TaskKind::Main, Outcome::Failed(text)) => self.fail(text),
            (TaskKind::Line, outcome) => {
                let answer = self.evaluated(outcome);
                self.output.answer(answer);
            }
            (TaskKind::Spawned | TaskKind::StopHandler, Outcome::Failed(text)) => {
                self.log_failure(&text)
            }
            _ => {}
        }
    }

    /// Handles the end of one run of a subscription's function.
    fn handler_ended(&mut self, id: SubscriptionId, outcome: &Outcome) {
        if let Outcome::Failed(text) = outcome {
            self.log_failure(text);
        }
        let Some(subscription) = self.subscriptions.get_mut(&id) else {
            // The subscription was removed meanwhile, or was for one event only.
            return self.release(Owner::Subscription(id));
        };
        subscription.busy = Busy::No;
        match outcome {
            Outcome::Failed(text) => {
                subscription.failures += 1;
                if subscription.failures >= MAX_FAILURES {
                    let name = subscription.event.name();
                    let text = self.explained(text);
                    let text = format!(
                        "{text}\n(the '{name}' handler failed {MAX_FAILURES} times in a row)"
                    );
                    return self.begin_stop(EndReason::Error, Some(text));
                }
            }
            Outcome::Done(_) | Outcome::Cancelled => subscription.failures = 0,
        }
        self.schedule(id);
    }

    /// Queues a subscription's next run if an event is waiting, or sets a timer if it is too early
    /// for the run.
    pub(super) fn schedule(&mut self, id: SubscriptionId) {
        let Some(subscription) = self.subscriptions.get_mut(&id) else {
            return;
        };
        if subscription.busy != Busy::No || !subscription.has_waiting() {
            return;
        }
        subscription.busy = match subscription.delayed_until(self.now) {
            Some(at) => Busy::Timed(self.tasks.call_handler_at(id, at)),
            None => {
                self.tasks.call_handler(id);
                Busy::Queued
            }
        };
    }

    /// Ends a subscription. A run in progress continues, and so does its motion.
    pub(super) fn unsubscribe(&mut self, id: SubscriptionId) {
        let Some(subscription) = self.subscriptions.remove(&id) else {
            return;
        };
        match subscription.busy {
            Busy::Running(_) => {}
            Busy::Timed(timer) => {
                self.tasks.cancel_timer(timer);
                self.release(Owner::Subscription(id));
            }
            Busy::No | Busy::Queued => self.release(Owner::Subscription(id)),
        }
    }

    /// Ends the script because its main task has failed.
    fn fail(&mut self, text: String) {
        let text = self.explained(&text);
        self.begin_stop(EndReason::Error, Some(text));
    }

    /// Logs the error of a cancelled task, unless it is the cancellation's own error.
    pub(super) fn log_clean_up_failure(&mut self, text: &str) {
        if !text.ends_with(CANCELLED) {
            self.log(Level::Warn, &format!("while cleaning up: {text}"));
        }
    }

    /// Whether nothing is left that could run: no tasks and no subscriptions.
    pub(super) fn is_finished(&self) -> bool {
        matches!(self.life, Life::Running)
            && !self.options.interactive
            && self.tasks.is_empty()
            && self.subscriptions.is_empty()
    }
}

impl State {
    /// Handles the end of a child of a group.
    pub(super) fn child_ended(&mut self, id: GroupId, index: usize, outcome: Outcome) {
        let Some(group) = self.groups.get_mut(&id) else {
            return;
        };
        let parent = group.parent;
        let answer = match outcome {
            Outcome::Done(values) => group.child_done(index, values).map(Wakeup::Values),
            Outcome::Failed(text) => Some(Wakeup::Failed(text)),
            Outcome::Cancelled => Some(Wakeup::Cancelled),
        };
        if let Some(answer) = answer {
            self.end_group(id);
            self.tasks.wake(parent, answer, self.now);
        }
    }

    /// Ends a group: children that have not ended are cancelled, and run their clean-up before
    /// their parent continues.
    pub(super) fn end_group(&mut self, id: GroupId) {
        if let Some(group) = self.groups.remove(&id) {
            for child in group.children {
                self.cancel(child);
            }
        }
    }
}
