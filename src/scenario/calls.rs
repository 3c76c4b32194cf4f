//! The `sim` calls that observe the simulated robot or change its environment.

use std::path::Path;

use serde_json::{Value, json};

use super::arguments::Arguments;
use super::refusal::CallError;
use super::running_api::RunningScenarioApi;
use crate::clock::{self, Date};
use crate::sim::{Fault, Point, Pose, TraceEventKind};

impl RunningScenarioApi {
    pub(super) fn call(&self, call: &str, given: Arguments<'_>) -> Result<Value, CallError> {
        match call {
            "sim:place" => Ok(self.put_robot(given)),
            "sim:place_ball" => self.put_ball(given),
            "sim:battery" if !given.value(0).is_null() => {
                self.sim.set_battery(given.number(0));
                Ok(Value::Null)
            }
            "sim:noise" => {
                self.sim.disturb(given.number(0), given.seconds(1));
                Ok(Value::Null)
            }
            "sim:light" => {
                self.sim.set_light(given.number(0));
                Ok(Value::Null)
            }
            "sim:hide_station" => {
                self.sim.hide_station(given.is_true(0));
                Ok(Value::Null)
            }
            "sim:break_charger" => {
                self.sim.set_charging_broken(given.is_true(0));
                Ok(Value::Null)
            }
            "sim:clock" => {
                let date: Date = given.text(0).unwrap_or_default().parse()?;
                clock::begin_virtual(Some(date.at(&self.behaviours.zone())));
                Ok(Value::Null)
            }
            "sim:fault" => self.begin_fault(given),
            _ => self.look(call, given),
        }
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
            "sim:collisions" => state.collisions.into(),
            "sim:ended" => self.record.ended(given.text(0)).into(),
            "sim:log" => self.record.lines(given.text(0).unwrap_or_default())?,
            _ => return Err(CallError::Unknown),
        })
    }

    fn put_robot(&self, given: Arguments<'_>) -> Value {
        let old = self.sim.state().pose;
        let number = |key, old| given.option(0, key).unwrap_or(old);
        self.sim.place(Pose {
            x: number("x", old.x),
            y: number("y", old.y),
            heading: number("heading", old.heading),
        });
        Value::Null
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

    fn put_ball(&self, given: Arguments<'_>) -> Result<Value, CallError> {
        let index = self.ball_number(given)?;
        let number = |key| given.option(1, key).unwrap_or_default();
        self.sim
            .put_ball(index, Point::new(number("x"), number("y")));
        Ok(Value::Null)
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
    fn begin_fault(&self, given: Arguments<'_>) -> Result<Value, CallError> {
        let list = json!({"faults": [given.value(0)]}).to_string();
        let faults = Fault::list_from_yaml(&list, "fault")
            .map_err(|error| CallError::Fault(error.into_message()))?;
        for fault in faults {
            self.sim.begin(fault);
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
