//! Handles the calls of a scenario's script while it runs.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::path::Path;
use std::time::Duration;

use serde_json::{Value, json};
use tokio::time::Instant;

use super::CallError;
use super::behaviours::Behaviours;
use super::run_record::RunRecord;
use crate::agent::Behaviour;
use crate::clock::{self, Date};
use crate::script::{ScenarioApi, ScenarioCall, ScenarioCallResult, SourceLocation};
use crate::sim::{Fault, Handle, Point, Pose, TraceEventKind};

/// A command for the simulation, executed when the script waits.
pub(super) enum ScenarioCommand {
    Run(Vec<Behaviour>),
    Stop,
    Vanish,
}

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

    pub(super) fn take_command(&self) -> Option<ScenarioCommand> {
        self.commands.borrow_mut().pop_front()
    }

    /// Takes the result of the scenario's function: `Ok` if it returned, or the error that it
    /// raised.
    pub(super) fn take_end(&self) -> Option<Result<(), String>> {
        self.end.borrow_mut().take()
    }

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

    fn call(&self, call: &str, given: Arguments<'_>) -> Result<Value, CallError> {
        match call {
            "sim:place" => self.put_robot(given),
            "sim:place_ball" => self.put_ball(given)?,
            "sim:battery" if !given.value(0).is_null() => self.sim.set_battery(given.number(0)),
            "sim:noise" => self.sim.disturb(given.number(0), given.seconds(1)),
            "sim:light" => self.sim.set_light(given.number(0)),
            "sim:hide_station" => self.sim.hide_station(given.is_true(0)),
            "sim:break_charger" => self.sim.set_charging_broken(given.is_true(0)),
            "sim:clock" => {
                let date: Date = given.text(0).unwrap_or_default().parse()?;
                clock::begin_virtual(Some(date.at(&self.behaviours.zone())));
            }
            "sim:fault" => self.begin_fault(given)?,
            _ => return self.look(call, given),
        }
        Ok(Value::Null)
    }

    fn look(&self, call: &str, given: Arguments<'_>) -> Result<Value, CallError> {
        let state = self.sim.state();
        Ok(match call {
            "sim:seed" => self.behaviours.seed.into(),
            "sim:time" => self.time().as_secs_f64().into(),
            "sim:pose" => {
                json!({"x": state.pose.x, "y": state.pose.y, "heading": state.pose.heading})
            }
            "sim:ball" => self.ball(given)?,
            "sim:battery" => state.battery.into(),
            "sim:charging" => state.charging.into(),
            "sim:docked" => state.docked.into(),
            "sim:connected" => state.user.is_some().into(),
            "sim:leds" => {
                let leds = state.leds;
                json!({"flash": leds.flash, "left": leds.left, "right": leds.right})
            }
            "sim:sounds" => self.sounds(),
            "sim:photos" => pictures(&self.behaviours.data).into(),
            "sim:distance" => state.distance.into(),
            "sim:moving" => state.moving().into(),
            "sim:turned" => self.sim.look_back(|trace| trace.turned()).into(),
            "sim:collisions" => state.collisions.into(),
            "sim:ended" => self.record.ended(given.text(0)).into(),
            "sim:log" => self.record.lines(given.text(0).unwrap_or_default())?,
            _ => return Err(CallError::Unknown),
        })
    }

    fn put_robot(&self, given: Arguments<'_>) {
        let old = self.sim.state().pose;
        let number = |key, old| given.option(0, key).unwrap_or(old);
        self.sim.place(Pose {
            x: number("x", old.x),
            y: number("y", old.y),
            heading: number("heading", old.heading),
        });
    }

    fn ball_number(&self, given: Arguments<'_>) -> Result<usize, CallError> {
        let number = given.number(0);
        let balls = self.sim.world().balls.len();
        if balls == 0 {
            return Err(CallError::NoBall);
        }
        if !(1.0..=balls as f64).contains(&number) {
            return Err(CallError::BallNumber { balls, number });
        }
        Ok(number as usize - 1)
    }

    fn ball(&self, given: Arguments<'_>) -> Result<Value, CallError> {
        let index = self.ball_number(given)?;
        let first = self.sim.world().balls[index].at.point();
        let now = self
            .sim
            .look_back(|trace| trace.balls().get(index).copied());
        let at = now.unwrap_or(first);
        Ok(json!({"x": at.x, "y": at.y}))
    }

    fn put_ball(&self, given: Arguments<'_>) -> Result<(), CallError> {
        let index = self.ball_number(given)?;
        let number = |key| given.option(1, key).unwrap_or_default();
        self.sim
            .put_ball(index, Point::new(number("x"), number("y")));
        Ok(())
    }

    fn sounds(&self) -> Value {
        self.sim.look_back(|trace| {
            let sound = |kind: &TraceEventKind| match kind {
                TraceEventKind::Sound(sound) => Some(sound.name()),
                TraceEventKind::Photo => Some("snapshot"),
                _ => None,
            };
            let sounds = trace.events().iter().filter_map(|happened| {
                let name = sound(&happened.kind)?;
                Some(json!({"name": name, "time": happened.at.as_secs_f64()}))
            });
            sounds.collect()
        })
    }

    /// Accepts the format of `spykee sim --faults`: JSON is valid YAML.
    fn begin_fault(&self, given: Arguments<'_>) -> Result<(), CallError> {
        let list = json!({"faults": [given.value(0)]}).to_string();
        let faults = Fault::list_from_yaml(&list, "fault")
            .map_err(|error| CallError::Fault(error.into_message()))?;
        for fault in faults {
            self.sim.begin(fault);
        }
        Ok(())
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

/// Counts the pictures in the behaviours' data folder, recursively.
fn pictures(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else {
        return 0;
    };
    let is_picture = |path: &Path| path.extension().is_some_and(|ending| ending == "jpg");
    entries
        .flatten()
        .map(|entry| match entry.file_type() {
            Ok(kind) if kind.is_dir() => pictures(&entry.path()),
            _ => usize::from(is_picture(&entry.path())),
        })
        .sum()
}

#[derive(Clone, Copy)]
pub(super) struct Arguments<'a>(pub(super) &'a [Value]);

impl<'a> Arguments<'a> {
    pub(super) fn value(self, index: usize) -> &'a Value {
        self.0.get(index).unwrap_or(&Value::Null)
    }

    pub(super) fn number(self, index: usize) -> f64 {
        self.value(index).as_f64().unwrap_or_default()
    }

    pub(super) fn seconds(self, index: usize) -> Duration {
        seconds(self.value(index))
    }

    pub(super) fn is_true(self, index: usize) -> bool {
        self.value(index) == &Value::Bool(true)
    }

    pub(super) fn text(self, index: usize) -> Option<&'a str> {
        self.value(index).as_str()
    }

    pub(super) fn option(self, index: usize, key: &str) -> Option<f64> {
        self.value(index).get(key)?.as_f64()
    }
}

/// Converts a number of seconds to a duration; zero for any other value.
pub(super) fn seconds(value: &Value) -> Duration {
    let seconds = value.as_f64().unwrap_or_default();
    Duration::try_from_secs_f64(seconds).unwrap_or_default()
}
