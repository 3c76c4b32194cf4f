//! Handles the calls of a scenario's script while it is played.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::time::Duration;

use serde_json::Value;
use tokio::time::Instant;

use super::arguments::Arguments;
use super::cast::Cast;
use super::refusal::CallError;
use super::run_record::RunRecord;
use crate::agent::Behaviour;
use crate::script::{SourceLocation, Stage, StageAnswer, StageCall};
use crate::sim::Handle;

/// A command for the laboratory, executed when the script waits.
pub(super) enum StageCommand {
    Run(Vec<Behaviour>),
    Stop,
    Vanish,
}

/// The stage of a played scenario: handles its script's calls.
pub(super) struct PlayStage {
    pub(super) sim: Handle,
    pub(super) cast: Cast,
    pub(super) record: RunRecord,
    pub(super) began: Instant,
    /// The index in the file of the scenario to play, from 0.
    wanted: usize,
    declared: Cell<usize>,
    commands: RefCell<VecDeque<StageCommand>>,
    running: Cell<bool>,
    end: RefCell<Option<Result<(), String>>>,
    place: RefCell<Option<SourceLocation>>,
    expected: RefCell<Option<(Option<SourceLocation>, String)>>,
}

impl PlayStage {
    pub(super) fn new(sim: Handle, cast: Cast, record: RunRecord, wanted: usize) -> PlayStage {
        PlayStage {
            sim,
            cast,
            record,
            began: Instant::now(),
            wanted,
            declared: Cell::new(0),
            commands: RefCell::default(),
            running: Cell::new(false),
            end: RefCell::default(),
            place: RefCell::default(),
            expected: RefCell::default(),
        }
    }

    /// Takes the next command.
    pub(super) fn take_command(&self) -> Option<StageCommand> {
        self.commands.borrow_mut().pop_front()
    }

    /// Takes the result of the scenario's function: `Ok` if it returned, or the error that it
    /// raised.
    pub(super) fn take_end(&self) -> Option<Result<(), String>> {
        self.end.borrow_mut().take()
    }

    /// Returns the place of the script's last call.
    pub(super) fn last_place(&self) -> Option<SourceLocation> {
        self.place.borrow().clone()
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
        let behaviours = self.cast.behaviours(named)?;
        self.record.begin();
        self.running.set(true);
        self.push(StageCommand::Run(behaviours));
        Ok(())
    }

    fn push(&self, command: StageCommand) {
        self.commands.borrow_mut().push_back(command);
    }
}

impl Stage for PlayStage {
    fn answer(&self, asked: StageCall<'_>) -> StageAnswer {
        let (call, place) = (asked.name, asked.place);
        let given = Arguments(asked.arguments);
        if call == "expected" {
            let message = given.text(0).unwrap_or_default().to_owned();
            // The first failure counts: later ones may be consequences of it.
            self.expected
                .borrow_mut()
                .get_or_insert((place.cloned(), message));
            return Ok(Value::Null);
        }
        if call != "played" {
            *self.place.borrow_mut() = place.cloned();
        }
        match call {
            "scenario" => return Ok(self.declare()),
            "played" => {
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
            "sim:stop" => self.push(StageCommand::Stop),
            "sim:kill" => self.sim.disconnect_all(),
            "vanish" => self.push(StageCommand::Vanish),
            _ => return Ok(self.call(call, given)?),
        }
        Ok(Value::Null)
    }
}
