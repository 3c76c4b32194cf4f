//! The calls of `sim` that look at the simulated robot or change something around it.

use std::path::Path;

use serde_json::{Value, json};

use super::arguments::Arguments;
use super::stage::PlayStage;
use crate::sim::{Fault, FaultsError, Point, Pose, What};

/// Farther away, metres, nothing can be put.
const FAR: f64 = 1000.0;

impl PlayStage {
    pub(super) fn call(&self, call: &str, given: Arguments<'_>) -> Result<Value, String> {
        match call {
            "sim:place" => self.put_robot(given),
            "sim:place_ball" => self.put_ball(given),
            "sim:battery" if given.has(0) => {
                self.sim
                    .set_battery(given.number(0, "percent", 0.0, 100.0)?);
                Ok(Value::Null)
            }
            "sim:noise" => {
                let level = given.number(0, "dbfs", -90.0, -3.0)?;
                self.sim.disturb(level, given.seconds(1)?);
                Ok(Value::Null)
            }
            "sim:light" => {
                self.sim.set_light(given.number(0, "factor", 0.0, 10.0)?);
                Ok(Value::Null)
            }
            "sim:hide_station" => {
                self.sim.hide_station(given.flag(0, "hidden")?);
                Ok(Value::Null)
            }
            "sim:break_charger" => {
                self.sim.set_charging_broken(given.flag(0, "broken")?);
                Ok(Value::Null)
            }
            "sim:fault" => self.begin_fault(given),
            _ => self.look(call, given),
        }
    }

    fn look(&self, call: &str, given: Arguments<'_>) -> Result<Value, String> {
        let state = self.sim.state();
        Ok(match call {
            "sim:seed" => self.cast.seed.into(),
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
            "sim:photos" => pictures(&self.cast.data).into(),
            "sim:distance" => state.distance.into(),
            "sim:collisions" => state.collisions.into(),
            "sim:ended" => {
                let name = given.optional_text(0, "the behaviour's name")?;
                self.chronicle.ended(name).into()
            }
            "sim:log" => {
                let text = given.optional_text(0, "the text")?;
                self.chronicle.lines(text.unwrap_or_default())
            }
            _ => return Err("it does not exist".to_owned()),
        })
    }

    fn put_robot(&self, given: Arguments<'_>) -> Result<Value, String> {
        let place = given.fields(0, "the place", &["x", "y", "heading"])?;
        let missing = |name| format!("{name} is missing; as in {{ x = 1, y = 2, heading = 0 }}");
        let old = self.sim.state().pose;
        self.sim.place(Pose {
            x: place.number("x", -FAR, FAR)?.ok_or_else(|| missing("x"))?,
            y: place.number("y", -FAR, FAR)?.ok_or_else(|| missing("y"))?,
            heading: place.number("heading", -FAR, FAR)?.unwrap_or(old.heading),
        });
        Ok(Value::Null)
    }

    fn ball_number(&self, given: Arguments<'_>) -> Result<usize, String> {
        let balls = self.sim.world().balls.len();
        match balls {
            0 => Err("there is no ball in this world".to_owned()),
            balls => given
                .whole(0, "the ball's number", balls)
                .map(|number| number - 1),
        }
    }

    fn ball(&self, given: Arguments<'_>) -> Result<Value, String> {
        let index = self.ball_number(given)?;
        let first = self.sim.world().balls[index].at.point();
        let now = self
            .sim
            .look_back(|trace| trace.balls().get(index).copied());
        let at = now.unwrap_or(first);
        Ok(json!({"x": at.x, "y": at.y}))
    }

    fn put_ball(&self, given: Arguments<'_>) -> Result<Value, String> {
        let index = self.ball_number(given)?;
        let place = given.fields(1, "the place", &["x", "y"])?;
        let (x, y) = (place.number("x", -FAR, FAR)?, place.number("y", -FAR, FAR)?);
        let (Some(x), Some(y)) = (x, y) else {
            return Err("the place needs x and y, as in { x = 1, y = 2 }".to_owned());
        };
        self.sim.put_ball(index, Point::new(x, y));
        Ok(Value::Null)
    }

    fn sounds(&self) -> Value {
        self.sim.look_back(|trace| {
            let sound = |what: &What| match what {
                What::Sound(sound) => Some(sound.name()),
                What::Photo => Some("snapshot"),
                _ => None,
            };
            let sounds = trace.events().iter().filter_map(|happened| {
                let name = sound(&happened.what)?;
                Some(json!({"name": name, "time": happened.at.as_secs_f64()}))
            });
            sounds.collect()
        })
    }

    /// As in the YAML of `spykee sim --faults`, which is JSON too.
    fn begin_fault(&self, given: Arguments<'_>) -> Result<Value, String> {
        let list = json!({"faults": [given.value(0)]}).to_string();
        let faults = Fault::list_from_yaml(&list, "fault").map_err(|error| match error {
            FaultsError::Invalid { message, .. } => message,
            other => other.to_string(),
        })?;
        for fault in faults {
            self.sim.begin(fault);
        }
        Ok(Value::Null)
    }
}

/// How many pictures the behaviours keep.
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
