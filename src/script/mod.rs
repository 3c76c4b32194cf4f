//! The VM of one behaviour: sandbox, budget, tasks and the Lua API. It is synchronous and has no
//! socket and no clock: [`Script`] takes events and the current time, runs the tasks that are
//! ready, and returns their output. A hang inside one library call cannot be interrupted here; the
//! surrounding process has to handle it.

mod api;
mod arguments;
mod budget;
mod damage;
mod declaration;
mod eval;
mod failure;
mod frame_state;
mod interrupt;
mod modules;
mod motion;
mod options;
mod output;
mod picture_store;
mod plain;
mod sandbox;
mod state;
mod store;
mod streams;
mod task;
#[cfg(test)]
pub(crate) mod tests;

use std::cell::RefCell;
use std::rc::Rc;
use std::time::Duration;

use mlua::prelude::{IntoLuaMulti, Lua, LuaMultiValue, LuaResult, LuaTable, LuaThread, LuaValue};
use mlua::thread::ThreadStatus;
use tokio::time::Instant;

use crate::api::EventName;
use crate::robot::{DockEnd, EndReason, Event, Frame, MotionEnd};
use crate::wire::Stream;
use api::{Shared, battery_table, frame_to_lua, of_row};
use budget::SliceCost;
use declaration::no_declaration_error;
use failure::{Life, VmError, is_kill};
use modules::Progress;
use state::{Busy, CANCELLED, Outcome, SliceStart, State};
use streams::audio_to_lua;
use task::{
    Cancel, Payload, Ready, Status, SubscriptionId, TaskId, TaskKind, TaskPhase, Wait, Wakeup,
};

pub(crate) use budget::{running, set_simulated_wall_factor, stuck, when_stuck};
pub use declaration::{GivenParam, ParamOrigin, ParamValue};
pub(crate) use declaration::{check_declaration, set_given};
pub(crate) use failure::printable;
pub use failure::{Explain, Failure, ScriptExit, SourceLocation};
pub use frame_state::{AnnotatedFrame, LabelledBlob};
pub use modules::{ModuleFile, ModuleName, NoModule, RESCUE, module_names};
pub(crate) use modules::{Target, resolve};
pub use options::{
    Calibration, Limits, NOTICES_A_DAY, Options, ScenarioApi, ScenarioCall, ScenarioCallError,
    ScenarioCallResult,
};
pub(crate) use output::{DailyLimits, MAX_ENTRY, MAX_KIND, MAX_NOTICE};
pub use output::{Evaluated, FromHost, Level, LogLine};
pub(crate) use picture_store::{NAMES as PICTURE_NAMES, file_name as picture_name};
pub use sandbox::MAX_SOURCE;
pub(crate) use sandbox::{check_source as read_text, compile_error};
pub use state::Usage;

/// A script with its VM. It stays on the thread that created it.
///
/// Each call gets the current time, which must not run backwards. The loop of a host: deliver
/// pending events; call [`run_ready`](Script::run_ready) while [`is_ready`](Script::is_ready) is
/// true, taking the output after each call; sleep until [`next_deadline`](Script::next_deadline) or
/// the next event; stop when [`ended`](Script::ended) returns `Some`.
pub struct Script {
    // Dropped first: the state holds only weak references to values of the VM.
    lua: Lua,
    state: Shared,
    /// Bytes in use after the last complete garbage collection.
    used_after_collection: usize,
}

impl Script {
    /// Loads a script without running it. Refuses a source that is larger than 256 KiB, contains
    /// control characters (as compiled code does) or does not compile.
    pub fn load(source: &[u8], options: Options, now: Instant) -> Result<Script, Failure> {
        Script::load_with(source, options, None, now)
    }

    /// Loads a scenario script: it has `scenario`, `expect` and `sim`, and of the usual names only
    /// `task`, `log`, `script`, `print` and `require`.
    pub fn with_scenario_api(
        source: &[u8],
        options: Options,
        scenario_api: Rc<dyn ScenarioApi>,
        now: Instant,
    ) -> Result<Script, Failure> {
        Script::load_with(source, options, Some(Some(scenario_api)), now)
    }

    /// Loads a scenario script with an empty source and no scenario API: enough to list the names
    /// that scripts can use.
    pub(crate) fn empty_scenario(options: Options, now: Instant) -> Result<Script, Failure> {
        Script::load_with(b"", options, Some(None), now)
    }

    /// `scenario`: for a scenario script, its API, if it can be called.
    fn load_with(
        source: &[u8],
        options: Options,
        scenario: Option<Option<Rc<dyn ScenarioApi>>>,
        now: Instant,
    ) -> Result<Script, Failure> {
        let chunk = options.chunk.clone();
        let text = sandbox::check_source(source, &chunk)?;
        Script::start(text, options, scenario, now).map_err(|error| match &error {
            mlua::Error::SyntaxError { message, .. } => {
                Failure::Syntax(failure::printable(message, 1000))
            }
            other => Failure::Machine {
                chunk,
                reason: VmError::from_lua(other).text_or("not enough memory"),
            },
        })
    }

    fn start(
        source: &str,
        options: Options,
        scenario: Option<Option<Rc<dyn ScenarioApi>>>,
        now: Instant,
    ) -> LuaResult<Script> {
        let lua = sandbox::open()?;
        let chunk = options.chunk.clone();
        let seed = options.seed;
        let is_scenario = scenario.is_some();
        let mut state = State::new(options, now);
        state.failure_log.source = source.to_owned();
        state.scenario_api = scenario.flatten();
        let state = Rc::new(RefCell::new(state));
        sandbox::seed(&lua, seed)?;
        api::install(&lua, &state, is_scenario)?;
        let main = lua.create_thread(sandbox::compile(&lua, source, &chunk)?)?;
        let start = Wakeup::Start(LuaMultiValue::new());
        state
            .borrow_mut()
            .tasks
            .add(main, TaskKind::Main, start, None, now);
        Ok(Script {
            lua,
            state,
            used_after_collection: 0,
        })
    }

    /// Sets the function that explains failures in plain words wherever they are logged or
    /// reported.
    pub fn explain_with(&mut self, explain: Explain) {
        self.state.borrow_mut().failure_log.explain = Some(explain);
    }

    /// Changes the value of a parameter while the script runs, on behalf of a person. A refusal is
    /// logged.
    pub fn set_live_param(&mut self, name: &str, value: ParamValue, now: Instant) {
        let mut state = self.state.borrow_mut();
        state.tick(now);
        if state.has_ended() {
            return;
        }
        if let Err(why) = api::set_live_param(&self.lua, &mut state, name, value) {
            let now = state.now;
            let line = LogLine::new(Level::Warn, &why);
            state.output.log(line, now);
        }
    }

    /// Runs one garbage collection step if enough garbage has accumulated, so that slices need not.
    pub fn collect_garbage_step(&mut self) {
        let used = self.lua.used_memory();
        if used > self.used_after_collection + self.used_after_collection / 20
            && self.lua.gc_step().unwrap_or(true)
        {
            self.used_after_collection = self.lua.used_memory();
        }
    }

    /// Runs the next task that is ready or due until it waits. It runs only one slice, so that the
    /// host can send a sign of life in between. Does nothing if no task is ready.
    pub fn run_ready(&mut self, now: Instant) {
        {
            let mut state = self.state.borrow_mut();
            state.tick(now);
            state.fire_due_timers();
        }
        let next = self.state.borrow_mut().tasks.next_ready();
        match next {
            Some(next) => self.run(next),
            None => self.state.borrow_mut().examine_frame_for_motion(),
        }
        self.advance_ending();
        self.state.borrow_mut().drop_unused_streams();
    }

    /// Whether [`run_ready`](Script::run_ready) has something to do, as of the time of the last
    /// call.
    pub fn is_ready(&self) -> bool {
        self.state.borrow().is_ready()
    }

    /// When [`run_ready`](Script::run_ready) should be called next; not in the future if something
    /// is ready. `None` if only an event can make the script continue.
    pub fn next_deadline(&self) -> Option<Instant> {
        let state = self.state.borrow();
        if state.is_ready() {
            return Some(state.now);
        }
        state.next_deadline()
    }

    /// Whether a setpoint of this script is active, as far as the script knows. A setpoint to stand
    /// still counts, since it needs signs of life too.
    pub fn has_motion(&self) -> bool {
        self.state.borrow().motion.current().is_some()
    }

    /// Restores the store that an earlier run of the script saved. It is
    /// unchanged if `file` is not the content of a store.
    pub fn restore(&mut self, file: &[u8]) -> Result<(), serde_json::Error> {
        self.state.borrow_mut().store.restore(file)
    }

    /// Whether the store has changed since its file was last taken.
    pub fn has_store_changed(&self) -> bool {
        self.state.borrow().store.changed
    }

    /// Returns the content of the store's file, at most 1 MiB, if it has changed since it was last
    /// taken.
    pub fn take_store(&mut self) -> Option<Vec<u8>> {
        self.state.borrow_mut().store.take_file()
    }

    /// Returns a frame that the script has examined and what was found in it, as soon as no ready
    /// task can still examine that frame: at most ten frames a second with [`Options::detections`],
    /// at most two with only [`Options::annotate_dir`], and none without either.
    pub fn take_annotated_frame(&mut self) -> Option<AnnotatedFrame> {
        self.state.borrow_mut().take_annotated_frame()
    }

    /// Ends the script. Its motion ends now. For `cpu`, `memory` and `safety` no further line of it
    /// runs. For every other reason its tasks are cancelled and may clean up, and the functions
    /// given to `script.on_stop` run, within 0.5 s and without moving; while they wait, keep
    /// calling [`run_ready`](Script::run_ready) until [`ended`](Script::ended) returns `Some`.
    pub fn stop(&mut self, reason: EndReason, now: Instant) {
        {
            let mut state = self.state.borrow_mut();
            state.tick(now);
            if is_kill(reason) {
                let before = state.slice_start();
                return state.kill(reason, None, before);
            }
            state.begin_stop(reason, None);
        }
        self.advance_ending();
        while self.is_ready() {
            self.run_ready(now);
        }
    }

    /// How the script ended; `None` while it is running or stopping.
    pub fn ended(&self) -> Option<ScriptExit> {
        match &self.state.borrow().life {
            Life::Ended(exit) => Some(exit.clone()),
            _ => None,
        }
    }

    /// Returns every name that the VM defines: globals such as `print`, and fields such as
    /// `robot.move`.
    pub(crate) fn known_names(&self) -> std::collections::BTreeSet<String> {
        api::every_path(&self.lua)
    }

    pub fn usage(&self) -> Usage {
        let mut usage = self.state.borrow().usage;
        usage.memory_bytes = self.lua.used_memory() as u64;
        usage
    }

    /// Runs one slice of a task or handler that is ready.
    fn run(&mut self, next: Ready) {
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
        let argument = payload_to_lua(&payload, &self.lua)?;
        let start = Wakeup::Start(argument.into_lua_multi(&self.lua)?);
        let kind = TaskKind::Handler(id);
        let task = state.tasks.insert(thread, kind, start, now).id;
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
        if self.state.borrow().broken {
            let text =
                "a fault inside spykee, not of the script: please report it, with the script";
            self.kill(EndReason::Error, text.to_owned(), before);
            return Ok(());
        }
        if let Some(words) = self.refused_params(id, &slice) {
            self.kill(EndReason::Error, words, before);
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
        match std::mem::replace(&mut task.phase, TaskPhase::Running) {
            TaskPhase::Ready(answer) => {
                task.started = true;
                Some((task.thread.clone(), answer))
            }
            other => {
                task.phase = other;
                None
            }
        }
    }

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
            Ok(values) => Slice::Over(self.outcome(id, Outcome::Done(values))),
            Err(error) => match VmError::from_lua(&error) {
                VmError::Memory => Slice::Memory,
                VmError::Text(text) => Slice::Over(self.outcome(id, Outcome::Failed(text))),
            },
        };
        (slice, cost)
    }

    /// How a task ended that returned or failed: a cancelled one cannot do anything but clean up.
    fn outcome(&self, id: TaskId, outcome: Outcome) -> Outcome {
        let mut state = self.state.borrow_mut();
        let task = state.tasks.get(id);
        if task.is_none_or(|task| task.cancel == Cancel::No) {
            return outcome;
        }
        if let Outcome::Failed(text) = outcome {
            state.log_clean_up_failure(&text);
        }
        Outcome::Cancelled
    }

    fn account(&self, cost: &SliceCost) {
        let mut state = self.state.borrow_mut();
        state.usage.cpu += cost.wall;
        state.usage.worst_callback = state.usage.worst_callback.max(cost.wall);
        if let Life::Stopping { spent, .. } = &mut state.life {
            *spent += cost.wall;
        }
    }

    /// Begins to stop the script if the slice has called `script.stop`; how the slice ended does
    /// not matter then.
    fn stop_if_requested(&self) -> bool {
        let mut state = self.state.borrow_mut();
        let Some(reason) = state.stop_requested.take() else {
            return false;
        };
        state.begin_stop(EndReason::Done, reason);
        true
    }

    /// The message if values were given for parameters that the script refuses or does not declare.
    /// Checked before any output of the first slice is sent.
    fn refused_params(&self, id: TaskId, slice: &Slice) -> Option<String> {
        let mut state = self.state.borrow_mut();
        if let Some(words) = state.refused_params.take() {
            return Some(words);
        }
        let loads = |wait: &TaskPhase| matches!(wait, TaskPhase::Waiting(Wait::Module(_)));
        let loading = matches!(slice, Slice::Waits)
            && state.tasks.get(id).is_some_and(|task| loads(&task.phase));
        let fails = matches!(slice, Slice::Over(Outcome::Failed(_)));
        if state.declared_params.is_some() || loading || fails {
            return None;
        }
        no_declaration_error(&state.options.params)
    }

    fn kill(&self, reason: EndReason, text: String, before: SliceStart) {
        self.state.borrow_mut().kill(reason, Some(text), before);
    }

    fn kill_over_budget(&self, cost: SliceCost, before: SliceStart) {
        let limit = self.state.borrow().options.limits.callback_budget_ms;
        let location = match cost.location {
            Some(location) => location.to_string(),
            None => self.chunk(),
        };
        let text = format!(
            "{location}: ran longer than {limit} ms without waiting; put task.wait() into long loops"
        );
        self.kill(EndReason::Cpu, text, before);
    }

    fn kill_out_of_memory(&self, before: SliceStart) {
        let chunk = self.chunk();
        let limit = self.state.borrow().options.limits.memory_bytes / 1024;
        let text = format!(
            "{chunk}: wanted more than the {limit} KiB of memory that a script may have; keep less, and set to nil what is not needed any more"
        );
        self.kill(EndReason::Memory, text, before);
    }

    fn chunk(&self) -> String {
        self.state.borrow().options.chunk.clone()
    }

    /// Kills the script because the VM failed outside the script's own lines.
    fn vm_failed(&self, error: &mlua::Error, before: SliceStart) {
        match VmError::from_lua(error) {
            VmError::Memory => self.kill_out_of_memory(before),
            VmError::Text(text) => self.kill(EndReason::Error, text, before),
        }
    }

    /// Kills the script if it holds too many frames even after a garbage collection, as for too
    /// much memory: frames are outside the VM's memory.
    fn check_frames(&self, before: SliceStart) -> LuaResult<()> {
        let limit = self.state.borrow().options.limits.memory_bytes;
        let is_too_much = || self.state.borrow().frames.held_bytes() > limit;
        if !is_too_much() {
            return Ok(());
        }
        self.lua.gc_collect()?;
        if is_too_much() {
            let chunk = self.chunk();
            let limit = limit / 1024;
            let text = format!("{chunk}: holds on to more than {limit} KiB of frames; keep fewer");
            self.kill(EndReason::Memory, text, before);
        }
        Ok(())
    }

    /// Advances the end of the script after a slice: a script whose last task has ended begins to
    /// stop, runs its next `script.on_stop` function, or ends.
    fn advance_ending(&mut self) {
        let mut state = self.state.borrow_mut();
        if state.is_finished() {
            state.begin_stop(EndReason::Done, None);
        }
        if state.is_out_of_time() {
            return state.end_stopped();
        }
        let Life::Stopping { exit, .. } = &state.life else {
            return;
        };
        if !state.tasks.is_empty() {
            return;
        }
        let reason = exit.reason.name();
        let Some(handler) = state.stop_handlers.pop_front() else {
            return state.end_stopped();
        };
        let now = state.now;
        let thread = self.lua.create_thread(handler);
        let reason = self.lua.create_string(reason);
        if let (Ok(thread), Ok(reason)) = (thread, reason) {
            let values = LuaMultiValue::from_iter([LuaValue::String(reason)]);
            let start = Wakeup::Start(values);
            state
                .tasks
                .add(thread, TaskKind::StopHandler, start, None, now);
        }
    }

    /// Runs what a person typed: an expression, or statements. The answer is
    /// [`FromHost::Evaluated`], sent when the line has finished, which may
    /// involve waiting. Does nothing if the script is ending.
    ///
    /// `more` allows the answer [`Evaluated::Incomplete`].
    pub fn evaluate(&mut self, text: &str, more: bool, now: Instant) {
        let chunk = {
            let mut state = self.state.borrow_mut();
            state.tick(now);
            if !state.is_running() {
                return;
            }
            state.next_input(text)
        };
        let begun = eval::compile(&self.lua, text, &chunk, more).and_then(|function| {
            let thread = self.lua.create_thread(function);
            thread.map_err(|error| eval::refused(&error))
        });
        let mut state = self.state.borrow_mut();
        match begun {
            Ok(thread) => {
                let start = Wakeup::Start(LuaMultiValue::new());
                state.tasks.add(thread, TaskKind::Line, start, None, now);
            }
            Err(Evaluated::Failed(text)) => {
                let text = state.explained(&text);
                state
                    .output
                    .push(FromHost::Evaluated(Evaluated::Failed(text)));
            }
            Err(answer) => state.output.push(FromHost::Evaluated(answer)),
        }
    }

    /// Stops everything that the lines have started: the motion ends now, tasks end as soon as they
    /// have cleaned up, handlers are removed. Variables and functions stay.
    pub fn interrupt(&mut self, now: Instant) {
        {
            let mut state = self.state.borrow_mut();
            state.tick(now);
            if !state.is_running() {
                return;
            }
            state.cancel_all();
            state.output.send_stop();
        }
        self.advance_ending();
    }

    /// Returns the script's output since the last call, in order. It is bounded: a script that
    /// sends too much gets errors, and excess log lines are replaced by their number.
    pub fn take_output(&mut self) -> Vec<FromHost> {
        self.state.borrow_mut().output.take()
    }

    pub fn deliver(&mut self, event: Event, now: Instant) {
        let mut state = self.state.borrow_mut();
        state.tick(now);
        if !state.has_ended() {
            state.deliver(event);
        }
    }

    /// Delivers a frame to the script; it replaces one that no handler has taken. Returns `false`
    /// if its markers show that it is not a valid picture; the script then does not get it.
    pub fn deliver_frame(&mut self, frame: Frame, now: Instant) -> bool {
        let mut state = self.state.borrow_mut();
        state.tick(now);
        state.has_ended() || state.deliver_frame(frame)
    }

    /// Whether the script needs frames: something listens to them or waits for one, or the script
    /// has switched the video on.
    pub fn wants_frames(&self) -> bool {
        let state = self.state.borrow();
        !state.has_ended()
            && (state.streams.is_on(Stream::Video) || state.has_listener(EventName::Frame))
    }

    /// Delivers a module that the script has requested, or the reason why it cannot be loaded.
    pub fn deliver_module(
        &mut self,
        name: &ModuleName,
        file: Result<ModuleFile, NoModule>,
        now: Instant,
    ) {
        let mut state = self.state.borrow_mut();
        state.tick(now);
        let Some(id) = state.modules.find(name.as_str()) else {
            return;
        };
        if state.has_ended() || !matches!(state.modules.progress(id), Progress::Requested) {
            return;
        }
        let progress = match file {
            Err(NoModule(words)) => Progress::Missing(printable(&words, 400)),
            Ok(file) => match state.modules.record_file(id, &file) {
                Err(why) => Progress::Missing(why),
                Ok(chunk) => api::compile_module(&self.lua, &file.source, &chunk),
            },
        };
        state.modules.set(id, progress);
        state.answer(Wait::Module(id), || Wakeup::Again);
    }
}

impl std::fmt::Debug for Script {
    /// Prints the name only: values of the VM are never printed.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let state = self.state.borrow();
        f.debug_tuple("Script").field(&state.options.name).finish()
    }
}

enum Slice {
    Waits,
    Over(Outcome),
    Memory,
}

/// The argument of handlers: an empty table if the event has no payload.
fn payload_to_lua(payload: &Payload, lua: &Lua) -> LuaResult<LuaValue> {
    let event = match payload {
        Payload::Frame(frame) => return frame_to_lua(lua, frame),
        Payload::Noise { dbfs, own } => {
            let table = lua.create_table_with_capacity(0, 2)?;
            table.raw_set("dbfs", *dbfs)?;
            table.raw_set("own", *own)?;
            return Ok(LuaValue::Table(of_row("Noise", table)));
        }
        Payload::Event(event) => event,
    };
    let table = event_table(lua, event)?;
    let row = EventName::from_event(event).and_then(|name| crate::api::event(name.name()));
    let object = row.and_then(|row| row.payload);
    let table = match object {
        Some(object) => of_row(object, table),
        None => table,
    };
    Ok(LuaValue::Table(table))
}

fn event_table(lua: &Lua, event: &Event) -> LuaResult<LuaTable> {
    let table = lua.create_table()?;
    match event {
        Event::Connected { info, .. } => table.raw_set("address", info.address.as_str())?,
        Event::Disconnected { reason } => table.raw_set("reason", reason.as_str())?,
        Event::Battery(battery) | Event::BatteryLow(battery) | Event::BatteryOk(battery) => {
            return battery_table(lua, *battery, Duration::ZERO);
        }
        Event::Charging { on } => table.raw_set("on", *on)?,
        Event::Audio(samples) => return audio_to_lua(lua, samples),
        Event::Safety { action, reason } => {
            table.raw_set("action", action.name())?;
            table.raw_set("reason", reason.as_str())?;
        }
        Event::Engine { code } => table.raw_set("code", *code)?,
        Event::DriveGrant { seconds, power } => {
            table.raw_set("seconds", seconds.as_secs_f64())?;
            table.raw_set("power", power.get())?;
        }
        _ => {}
    }
    Ok(table)
}

/// The values for `Thread::resume`: plain arguments at the start; after a yield `true` and the
/// return values of the waiting call, or `false` and the error to raise.
fn resume_values(lua: &Lua, answer: Wakeup) -> LuaResult<LuaMultiValue> {
    match answer {
        Wakeup::Start(values) => Ok(values),
        // The text has its place already.
        Wakeup::Failed(text) => (false, text, true).into_lua_multi(lua),
        Wakeup::Cancelled => (false, CANCELLED).into_lua_multi(lua),
        answer => {
            let mut values = returned(lua, answer)?;
            values.push_front(LuaValue::Boolean(true));
            Ok(values)
        }
    }
}

fn returned(lua: &Lua, answer: Wakeup) -> LuaResult<LuaMultiValue> {
    match answer {
        Wakeup::Slept(time) => time.as_secs_f64().into_lua_multi(lua),
        Wakeup::Beat(missed) => (missed as f64).into_lua_multi(lua),
        Wakeup::Event(payload) => payload_to_lua(&payload, lua)?.into_lua_multi(lua),
        Wakeup::NoEvent => (LuaValue::Nil, "timeout").into_lua_multi(lua),
        Wakeup::Refused(code) => (false, code).into_lua_multi(lua),
        Wakeup::Motion(end) => (end == MotionEnd::Done, end.name()).into_lua_multi(lua),
        Wakeup::Dock(outcome) => {
            let info = lua.create_table_with_capacity(0, 2)?;
            info.raw_set("attempts", outcome.attempts)?;
            info.raw_set("seconds", outcome.took.as_secs_f64())?;
            let info = of_row("DockInfo", info);
            let docked = matches!(outcome.end, DockEnd::Done | DockEnd::AlreadyDocked);
            (docked, outcome.end.name(), info).into_lua_multi(lua)
        }
        Wakeup::Undock(end) => {
            let undocked = matches!(end, DockEnd::Done | DockEnd::NotDocked);
            (undocked, end.name()).into_lua_multi(lua)
        }
        Wakeup::Joined(status, Some(text)) => {
            (status == Status::Done, status.name(), text).into_lua_multi(lua)
        }
        Wakeup::Joined(status, None) => (status == Status::Done, status.name()).into_lua_multi(lua),
        Wakeup::Again => "again".into_lua_multi(lua),
        Wakeup::Values(values) => Ok(values),
        Wakeup::Start(_) | Wakeup::Failed(_) | Wakeup::Cancelled => Ok(LuaMultiValue::new()),
    }
}
