//! Runs tasks one slice at a time, from a resumption to the next wait, within the budget.

use mlua::prelude::{LuaMultiValue, LuaResult, LuaThread};
use mlua::thread::ThreadStatus;

use super::Script;
use super::api::resume_values;
use super::budget::{self, SliceCost};
use super::declaration::no_declaration_error;
use super::events::Busy;
use super::exit::SliceStart;
use super::failure::VmError;
use super::life::Life;
use super::queue::Ready;
use super::sandbox;
use super::scheduler::Outcome;
use super::task::{Cancel, SubscriptionId, TaskId, TaskKind, TaskPhase, Wait, Wakeup};
use crate::robot::EndReason;

/// How a slice ended.
enum Slice {
    /// The task waits.
    Waits,
    Over(Outcome),
    Memory,
}

impl Script {
    /// Runs one slice of a task or handler that is ready.
    pub(super) fn run(&mut self, next: Ready) {
        let before = self.state.borrow().slice_start();
        let result = match next {
            Ready::Task(id) => self.run_task(id, before),
            Ready::Handler(id) => match self.begin_handler(id) {
                Ok(Some(task)) => self.run_task(task, before),
                Ok(None) => Ok(()),
                Err(error) => Err(error),
            },
        };
        if let Err(error) = result {
            self.vm_failed(&error, before);
        }
    }

    /// Creates the task for a subscription's next event.
    fn begin_handler(&mut self, id: SubscriptionId) -> LuaResult<Option<TaskId>> {
        let mut state = self.state.borrow_mut();
        let now = state.now;
        let Some(subscription) = state.subscriptions.get_mut(&id) else {
            return Ok(None);
        };
        subscription.busy = Busy::No;
        let Some(payload) = subscription.pop(now) else {
            return Ok(None);
        };
        let thread = self.lua.create_thread(subscription.function.clone())?;
        let answer = Wakeup::Deliver(payload);
        let task = state
            .tasks
            .add_running(thread, TaskKind::Handler(id), answer, now);
        if let Some(subscription) = state.subscriptions.get_mut(&id) {
            subscription.busy = Busy::Running(task);
            if subscription.once {
                state.subscriptions.remove(&id);
            }
        }
        Ok(Some(task))
    }

    fn run_task(&mut self, id: TaskId, before: SliceStart) -> LuaResult<()> {
        let Some((thread, answer)) = self.take_answer(id) else {
            return Ok(());
        };
        let values = resume_values(&self.lua, answer)?;
        let (slice, cost) = self.resume(id, &thread, values);
        self.account(&cost);
        if self.state.borrow().exit.broken {
            self.kill_broken(before);
            return Ok(());
        }
        if let Some(words) = self.refused_params(id, &slice) {
            let mut state = self.state.borrow_mut();
            state.kill(EndReason::Error, Some(words), before);
            return Ok(());
        }
        if cost.over {
            self.kill_over_budget(cost, before);
            return Ok(());
        }
        match slice {
            Slice::Memory => self.kill_out_of_memory(before),
            Slice::Waits => {}
            Slice::Over(outcome) => {
                let stopped = self.stop_if_requested();
                let outcome = if stopped { Outcome::Cancelled } else { outcome };
                self.state.borrow_mut().finish(id, outcome);
            }
        }
        self.check_frames(before)
    }

    fn take_answer(&mut self, id: TaskId) -> Option<(LuaThread, Wakeup)> {
        let mut state = self.state.borrow_mut();
        let task = state.tasks.get_mut(id)?;
        if !matches!(task.phase, TaskPhase::Ready(_)) {
            return None;
        }
        task.started = true;
        match std::mem::replace(&mut task.phase, TaskPhase::Running) {
            TaskPhase::Ready(answer) => Some((task.thread.clone(), answer)),
            TaskPhase::Waiting(_) | TaskPhase::Running => None,
        }
    }

    /// Resumes a coroutine until it waits or ends.
    fn resume(
        &mut self,
        id: TaskId,
        thread: &LuaThread,
        values: LuaMultiValue,
    ) -> (Slice, SliceCost) {
        {
            let mut state = self.state.borrow_mut();
            state.tasks.current = Some(id);
            state.can_wait = true;
            let limit = state.options.limits.callback_budget();
            budget::begin(limit, &state.options.chunk);
        }
        let mut result = thread.resume::<LuaMultiValue>(values);
        while let Ok(yielded) = &result
            && thread.status() == ThreadStatus::Resumable
            && yielded.front() != Some(&sandbox::mark())
        {
            // The script has yielded by itself, not through a waiting call: raise an error at that
            // line.
            result = thread.resume::<LuaMultiValue>(sandbox::mark());
        }
        let cost = budget::end();
        self.state.borrow_mut().tasks.current = None;
        let slice = match result {
            Ok(_) if thread.status() == ThreadStatus::Resumable => Slice::Waits,
            Ok(values) => Slice::Over(self.done(id, values)),
            Err(error) => match VmError::from_lua(&error) {
                VmError::Memory => Slice::Memory,
                VmError::Text(text) => Slice::Over(self.failed(id, text)),
            },
        };
        (slice, cost)
    }

    fn done(&self, id: TaskId, values: LuaMultiValue) -> Outcome {
        match self.cancel_of(id) {
            Cancel::No => Outcome::Done(values),
            Cancel::Requested | Cancel::Raised => Outcome::Cancelled,
        }
    }

    fn failed(&self, id: TaskId, text: String) -> Outcome {
        if self.cancel_of(id) == Cancel::No {
            return Outcome::Failed(text);
        }
        self.state.borrow_mut().log_clean_up_failure(&text);
        Outcome::Cancelled
    }

    fn cancel_of(&self, id: TaskId) -> Cancel {
        let state = self.state.borrow();
        state.tasks.get(id).map_or(Cancel::No, |task| task.cancel)
    }

    fn account(&self, cost: &SliceCost) {
        let mut state = self.state.borrow_mut();
        state.usage.cpu += cost.wall;
        state.usage.worst_callback = state.usage.worst_callback.max(cost.wall);
        state.count_stopping_time(cost.wall);
    }

    /// Begins to stop the script if the slice has called `script.stop`; how the slice ended does
    /// not matter then.
    fn stop_if_requested(&self) -> bool {
        let mut state = self.state.borrow_mut();
        let Some(reason) = state.exit.stop_requested.take() else {
            return false;
        };
        state.begin_stop(EndReason::Done, reason);
        true
    }

    /// The message if values were given for parameters that the script refuses or does not declare.
    /// Checked before any output of the first slice is sent.
    fn refused_params(&self, id: TaskId, slice: &Slice) -> Option<String> {
        let mut state = self.state.borrow_mut();
        if let Some(words) = state.params.refused.take() {
            return Some(words);
        }
        let loads = |wait: &TaskPhase| matches!(wait, TaskPhase::Waiting(Wait::Module(_)));
        let loading = matches!(slice, Slice::Waits)
            && state.tasks.get(id).is_some_and(|task| loads(&task.phase));
        let fails = matches!(slice, Slice::Over(Outcome::Failed(_)));
        if state.params.names.is_some() || loading || fails {
            return None;
        }
        no_declaration_error(&state.options.params)
    }

    fn kill_broken(&self, before: SliceStart) {
        let text = "a fault inside spykee, not of the script: please report it, with the script";
        let mut state = self.state.borrow_mut();
        state.kill(EndReason::Error, Some(text.to_owned()), before);
    }

    fn kill_over_budget(&self, cost: SliceCost, before: SliceStart) {
        let mut state = self.state.borrow_mut();
        let limit = state.options.limits.callback_budget_ms;
        let location = match cost.location {
            Some(location) => location.to_string(),
            None => state.options.chunk.clone(),
        };
        let text = format!(
            "{location}: ran longer than {limit} ms without waiting; put task.wait() into long loops"
        );
        state.kill(EndReason::Cpu, Some(text), before);
    }

    fn kill_out_of_memory(&self, before: SliceStart) {
        let mut state = self.state.borrow_mut();
        let limit = state.options.limits.memory_bytes / 1024;
        let text = format!(
            "{}: wanted more than the {limit} KiB of memory that a script may have; keep less, and set to nil what is not needed any more",
            state.options.chunk
        );
        state.kill(EndReason::Memory, Some(text), before);
    }

    /// Kills the script because the VM failed outside the script's own lines.
    fn vm_failed(&self, error: &mlua::Error, before: SliceStart) {
        match VmError::from_lua(error) {
            VmError::Memory => self.kill_out_of_memory(before),
            VmError::Text(text) => {
                let mut state = self.state.borrow_mut();
                state.kill(EndReason::Error, Some(text), before);
            }
        }
    }

    /// Kills the script if it holds too many frames even after a garbage collection, as for too
    /// much memory: frames are outside the VM's memory.
    fn check_frames(&self, before: SliceStart) -> LuaResult<()> {
        let (held, limit) = {
            let state = self.state.borrow();
            let held = std::rc::Rc::clone(&state.frames.held_bytes);
            (held, state.options.limits.frame_bytes)
        };
        if held.get() <= limit {
            return Ok(());
        }
        self.lua.gc_collect()?;
        if held.get() > limit {
            let mut state = self.state.borrow_mut();
            let text = format!(
                "{}: holds on to more than {} KiB of frames; keep fewer",
                state.options.chunk,
                limit / 1024
            );
            state.kill(EndReason::Memory, Some(text), before);
        }
        Ok(())
    }

    /// Advances the end of the script after a slice: a script whose last task has ended begins to
    /// stop, runs its next `script.on_stop` function, or ends.
    pub(super) fn advance_ending(&mut self) {
        let mut state = self.state.borrow_mut();
        if state.is_finished() {
            state.begin_stop(EndReason::Done, None);
        }
        if state.is_out_of_time() {
            return state.end_stopped();
        }
        let Life::Stopping(stopping) = &state.life else {
            return;
        };
        if !state.tasks.is_empty() {
            return;
        }
        let reason = stopping.exit.reason.name();
        let Some(handler) = state.exit.stop_handlers.pop_front() else {
            return state.end_stopped();
        };
        let now = state.now;
        let thread = self.lua.create_thread(handler);
        let reason = self.lua.create_string(reason);
        if let (Ok(thread), Ok(reason)) = (thread, reason) {
            let values = LuaMultiValue::from_iter([mlua::Value::String(reason)]);
            let start = Wakeup::Start(values);
            state
                .tasks
                .add(thread, TaskKind::StopHandler, start, None, now);
        }
    }
}
