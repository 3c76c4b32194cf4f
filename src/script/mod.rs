//! The VM of one behaviour: sandbox, budget, tasks and the Lua API (see `behaviours/README.md`).
//!
//! The module is synchronous and single-threaded: [`Script`] takes events and the current time,
//! runs the tasks that are ready, and returns their output. It has no socket and no clock, and
//! needs no async runtime. All I/O is done by the host.
//!
//! A script that runs too long without waiting or uses too much memory is killed with a reason: its
//! motion ends and the output of its last slice is discarded, except log lines, parameters and
//! saved pictures. A hang *inside* one library call cannot be interrupted here; the surrounding
//! process has to handle it.
//!
//! The parts: `sandbox` creates a restricted VM; `budget` and `interrupt` end slices that run too
//! long; `task`, `queue` and `scheduler` decide which task runs next; `slice` runs it; `exit`
//! ends the script; `api/` contains the native functions of each Lua namespace; `stdlib/` contains
//! the part of the library that is written in Lua.

mod address;
mod annotated_frame;
mod api;
mod arguments;
mod budget;
mod daily_limits;
mod declaration;
mod eval;
mod events;
mod exit;
mod failure;
mod failure_log;
mod frame_state;
mod group;
mod ids;
mod interrupt;
mod life;
mod modules;
mod motion;
mod nearest;
mod options;
mod output;
mod pace;
mod params;
mod picture_store;
mod plain;
mod queue;
mod sandbox;
mod scenario_api;
mod scheduler;
mod slice;
mod sound;
mod state;
pub mod stdlib;
mod store;
mod streams;
mod task;
#[cfg(test)]
pub(crate) mod tests;

use std::cell::RefCell;
use std::rc::Rc;

use mlua::prelude::{Lua, LuaMultiValue, LuaResult};
use tokio::time::Instant;

use crate::robot::EndReason;

use api::Shared;
use life::{Life, is_kill};
use state::State;
use task::{TaskKind, Wakeup};

pub use annotated_frame::{AnnotatedFrame, LabelledBlob};
pub(crate) use budget::{running, set_simulated_wall_factor, stuck, when_stuck};
pub(crate) use daily_limits::{MAX_ENTRY, MAX_KIND, MAX_NOTICE};
pub(crate) use declaration::{Declaration, param_values};
pub(crate) use failure::printable;
pub use failure::{Failure, ScriptExit, SourceLocation};
pub use failure_log::Explain;
pub use modules::{ModuleFile, ModuleName, NoModule};
pub(crate) use modules::{Target, resolve};
pub use nearest::{nearest, suggestion};
pub use options::{Calibration, Limits, Options};
pub use output::{Evaluated, Level, LogLine, Output};
pub use params::{GivenParam, ParamOrigin, ParamValue};
pub(crate) use picture_store::{NAMES as PICTURE_NAMES, file_name as picture_name};
pub use sandbox::MAX_SOURCE;
pub(crate) use sandbox::{check_source as read_text, compile_error};
pub use scenario_api::{ScenarioApi, ScenarioCall, ScenarioCallError, ScenarioCallResult};
pub use state::Usage;
pub use stdlib::RESCUE;

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
    /// Loads a script without running it.
    ///
    /// # Errors
    ///
    /// If the source is larger than 256 KiB, is not UTF-8, contains control characters (as compiled
    /// code does) or does not compile. The message names file and line.
    pub fn load(source: &[u8], options: Options, now: Instant) -> Result<Script, Failure> {
        Script::load_with(source, options, api::ApiSet::Robot, now)
    }

    /// Loads a scenario script: it has `scenario`, `expect` and `sim`, and of the usual names only
    /// `task`, `log`, `script`, `print` and `require`.
    ///
    /// # Errors
    ///
    /// As [`Script::load`].
    pub fn with_scenario_api(
        source: &[u8],
        options: Options,
        scenario_api: Rc<dyn ScenarioApi>,
        now: Instant,
    ) -> Result<Script, Failure> {
        Script::load_with(source, options, api::ApiSet::Scenario(scenario_api), now)
    }

    /// Loads a scenario script with an empty source and a scenario API that refuses every call.
    pub(crate) fn empty_scenario(options: Options, now: Instant) -> Result<Script, Failure> {
        Script::with_scenario_api(b"", options, Rc::new(RefusingScenarioApi), now)
    }

    fn load_with(
        source: &[u8],
        options: Options,
        api_set: api::ApiSet,
        now: Instant,
    ) -> Result<Script, Failure> {
        let chunk = options.chunk.clone();
        let text = sandbox::check_source(source, &chunk)?;
        Script::start(text, options, api_set, now).map_err(|error| match &error {
            mlua::Error::SyntaxError { message, .. } => {
                Failure::Syntax(failure::printable(message, 1000))
            }
            other => Failure::Machine {
                chunk,
                reason: match failure::VmError::from_lua(other) {
                    failure::VmError::Memory => "not enough memory".to_owned(),
                    failure::VmError::Text(text) => text,
                },
            },
        })
    }

    fn start(
        source: &str,
        options: Options,
        api_set: api::ApiSet,
        now: Instant,
    ) -> LuaResult<Script> {
        let lua = sandbox::open()?;
        let chunk = options.chunk.clone();
        let seed = options.seed;
        let text = source.to_owned();
        let state = Rc::new(RefCell::new(State::new(options, now)));
        state.borrow_mut().failure_log.source = text;
        sandbox::seed(&lua, seed)?;
        api::install(&lua, &state, api_set)?;
        let main = lua.create_thread(sandbox::compile(&lua, source, &chunk)?)?;
        let start = Wakeup::Start(LuaMultiValue::new());
        state
            .borrow_mut()
            .tasks
            .add(main, TaskKind::Main, start, None, now);
        let used_after_collection = 0;
        Ok(Script {
            lua,
            state,
            used_after_collection,
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
            let line = LogLine::new(Level::Warn, &why.to_string());
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

    /// Restores the store that an earlier run of the script saved.
    ///
    /// # Errors
    ///
    /// If `file` is not the content of a store; the store is then unchanged.
    pub fn restore(&mut self, file: &[u8]) -> Result<(), serde_json::Error> {
        self.state.borrow_mut().store.restore(file)
    }

    /// Whether the store has changed since its file was last taken.
    pub fn has_store_changed(&self) -> bool {
        self.state.borrow().store.has_changed()
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

    /// The resources that the script has used so far.
    pub fn usage(&self) -> Usage {
        let mut usage = self.state.borrow().usage;
        usage.memory_bytes = self.lua.used_memory() as u64;
        usage
    }
}

/// A scenario API that refuses every call; enough to list the names that scripts can use.
struct RefusingScenarioApi;

impl ScenarioApi for RefusingScenarioApi {
    fn answer(&self, call: ScenarioCall<'_>) -> ScenarioCallResult {
        Err(format!("{} is not possible here", call.name).into())
    }
}

impl std::fmt::Debug for Script {
    /// Prints the name only: values of the VM are never printed.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let state = self.state.borrow();
        f.debug_tuple("Script").field(&state.options.name).finish()
    }
}
