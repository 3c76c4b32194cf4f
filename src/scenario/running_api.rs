//! Handles the calls of a scenario's script while it runs.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use super::arguments::Arguments;
use super::behaviours::Behaviours;
use super::refusal::CallError;
use super::run_record::RunRecord;
use crate::agent::Behaviour;
use crate::script::{ScenarioApi, ScenarioCall, ScenarioCallResult, SourceLocation};
use crate::sim::Handle;

/// A command for the simulation, executed when the script waits.
pub(super) enum ScenarioCommand {
    Run(Vec<Behaviour>),
    Stop,
    Vanish,
}

/// What the script of a running scenario calls.
pub(super) struct RunningScenarioApi {
    pub(super) sim: Handle,
    pub(super) behaviours: Behaviours,
    pub(super) record: RunRecord,
    pub(super) began: Instant,
    /// The index in the file of the scenario to run, from 0.
    wanted: usize,
    declared: Cell<usize>,
    commands: RefCell<VecDeque<ScenarioCommand>>,
    running: Cell<bool>,
    end: RefCell<Option<Result<(), String>>>,
    location: RefCell<Option<SourceLocation>>,
    expected: RefCell<Option<(Option<SourceLocation>, String)>>,
}

impl RunningScenarioApi {
    pub(super) fn new(
        sim: Handle,
        behaviours: Behaviours,
        record: RunRecord,
        wanted: usize,
    ) -> RunningScenarioApi {
        RunningScenarioApi {
            sim,
            behaviours,
            record,
            began: Instant::now(),
            wanted,
            declared: Cell::new(0),
            commands: RefCell::default(),
            running: Cell::new(false),
            end: RefCell::default(),
            location: RefCell::default(),
            expected: RefCell::default(),
        }
    }

    /// Takes the next command.
    pub(super) fn take_command(&self) -> Option<ScenarioCommand> {
        self.commands.borrow_mut().pop_front()
    }

    /// Takes the result of the scenario's function: `Ok` if it returned, or the error that it
    /// raised.
    pub(super) fn take_end(&self) -> Option<Result<(), String>> {
        self.end.borrow_mut().take()
    }

    /// Returns the place of the script's last call.
    pub(super) fn last_location(&self) -> Option<SourceLocation> {
        self.location.borrow().clone()
    }

    /// Takes the failed `expect`: its place and its message.
    pub(super) fn take_expected(&self) -> Option<(Option<SourceLocation>, String)> {
        self.expected.borrow_mut().take()
    }

    /// Records that no behaviours are running.
    pub(super) fn has_stopped(&self) {
        self.running.set(false);
    }

    pub(super) fn time(&self) -> Duration {
        self.began.elapsed()
    }

    fn declare(&self) -> Value {
        let index = self.declared.get();
        self.declared.set(index + 1);
        (index == self.wanted).into()
    }

    fn run(&self, named: &[Value]) -> Result<(), CallError> {
        if self.running.get() {
            return Err(CallError::Running);
        }
        let behaviours = self.behaviours.load(named)?;
        self.record.begin();
        self.running.set(true);
        self.push(ScenarioCommand::Run(behaviours));
        Ok(())
    }

    fn push(&self, command: ScenarioCommand) {
        self.commands.borrow_mut().push_back(command);
    }
}

impl ScenarioApi for RunningScenarioApi {
    fn answer(&self, asked: ScenarioCall<'_>) -> ScenarioCallResult {
        let call = asked.name;
        let location = asked.location;
        let given = Arguments(asked.arguments);
        if call == "expected" {
            let message = given.text(0).unwrap_or_default().to_owned();
            // The first failure counts: later ones may be consequences of it.
            self.expected
                .borrow_mut()
                .get_or_insert((location.cloned(), message));
            return Ok(Value::Null);
        }
        if call != "finished" {
            *self.location.borrow_mut() = location.cloned();
        }
        match call {
            "scenario" => return Ok(self.declare()),
            "finished" => {
                let end = if given.is_true(0) {
                    Ok(())
                } else {
                    Err(given.text(1).unwrap_or_default().to_owned())
                };
                *self.end.borrow_mut() = Some(end);
            }
            // The script itself does the waiting.
            "sim:wait" | "sim:wait_until" => {}
            "running" => return Ok(self.running.get().into()),
            "sim:run" => self.run(asked.arguments)?,
            "sim:stop" => self.push(ScenarioCommand::Stop),
            "sim:kill" => self.sim.disconnect_all(),
            "vanish" => self.push(ScenarioCommand::Vanish),
            _ => return Ok(self.call(call, given)?),
        }
        Ok(Value::Null)
    }
}
