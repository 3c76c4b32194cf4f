//! What a person at the page or a program by the API may want done, and how it is done: through the
//! run's desk, so that there is one definition of each errand, or on the simulated world, with the
//! words of scenarios.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::world::Simulation;
use crate::control::{self, Answer, Errand, Run};
use crate::lab::{Factor, Tempo};
use crate::robot::{DockEnd, DockPlan, ParamValue, Percent};
use crate::sim::{Fault, Handle, Point, Pose};
use crate::wire;

/// How long an undocking may take.
pub(super) const UNDOCK: Duration = Duration::from_secs(15);
/// Places are no farther away than this, metres.
const FAR: f64 = 1000.0;

/// One thing to do.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
#[schemars(rename = "Order")]
pub(super) enum PageCommand {
    /// Drive to the station.
    Dock,
    /// Leave it.
    Undock,
    /// Switch a light.
    Led {
        /// Which.
        light: Light,
        /// On or off.
        on: bool,
    },
    /// Play a sound, such as `laser`; `spykee robot play --help` lists them.
    Play {
        /// Its name.
        sound: String,
    },
    /// Stop the music.
    StopSound,
    /// Set the volume.
    Volume {
        /// 0..=100.
        percent: Percent,
    },
    /// Start, stop or restart a behaviour.
    Behaviour {
        /// Which.
        name: String,
        /// What is to become of it.
        change: Turn,
    },
    /// Change a parameter that a running behaviour has declared as live.
    Param {
        /// The behaviour.
        name: String,
        /// The parameter.
        param: String,
        /// Its new value.
        value: ParamValue,
    },
    /// Change the simulated world.
    Sim {
        /// What.
        change: Change,
    },
}

/// What is to become of a behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Turn {
    /// It begins.
    Start,
    /// It ends.
    Stop,
    /// It ends if it runs, and begins anew from its file.
    Restart,
}

impl From<Turn> for control::Change {
    fn from(turn: Turn) -> control::Change {
        match turn {
            Turn::Start => control::Change::Start,
            Turn::Stop => control::Change::Stop,
            Turn::Restart => control::Change::Restart,
        }
    }
}

/// A light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Light {
    /// The headlight.
    Flash,
    /// The left one.
    Left,
    /// The right one.
    Right,
}

/// A change of the simulated world, with the words of scenarios (`sim:place` and so on).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "sim", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Change {
    /// Carry the robot somewhere.
    Place {
        /// Metres.
        x: f64,
        /// Metres.
        y: f64,
        /// Radians; as before unless given.
        heading: Option<f64>,
    },
    /// Put a ball somewhere, at rest.
    PlaceBall {
        /// 1 is the world's first.
        number: usize,
        /// Metres.
        x: f64,
        /// Metres.
        y: f64,
    },
    /// Set the battery's level.
    Battery {
        /// 0..=100.
        percent: f64,
    },
    /// Make all light so many times as bright as in the world.
    Light {
        /// 0..=10.
        factor: f64,
    },
    /// A tone at the microphone.
    Noise {
        /// Its loudness, -90..=-3 dBFS.
        dbfs: f64,
        /// 0.1..=60.
        seconds: f64,
    },
    /// The station cannot be found, or can again.
    HideStation {
        /// It cannot.
        hidden: bool,
    },
    /// The station has no current, or has it again.
    BreakCharger {
        /// It has none.
        broken: bool,
    },
    /// Begin a fault, as in the YAML of `spykee sim --faults`.
    Fault {
        /// `fault` is its name; the rest are its numbers.
        fault: Map<String, Value>,
    },
    /// End all faults.
    ClearFaults,
    /// Hold the simulation's own clock, or let it go on.
    Pause {
        /// Hold it.
        paused: bool,
    },
    /// Let a paused clock go on for 0.1 s.
    Step,
    /// Let the clock go so many times as fast as the one on the wall.
    Speed {
        /// 1..=100.
        factor: f64,
    },
}

/// What became of it: done or not, and in words.
pub(super) type Done = (bool, String);

/// Does it. Dropping the wait gives it up.
pub(super) async fn perform(order: PageCommand, run: &Run, sim: Option<&Simulation>) -> Done {
    match errand(order) {
        Ok(errand) => in_words(run.perform(errand).await),
        Err(order) => match (*order, sim) {
            (PageCommand::Sim { change }, Some(sim)) => told(alter(change, sim)),
            (PageCommand::Param { name, param, value }, _) => {
                let turned = run.roster.turn(&name, &param, value);
                told(turned)
            }
            (PageCommand::Play { sound }, _) => {
                (false, format!("there is no sound `{}`", short(&sound)))
            }
            _ => (false, "this robot is no simulated one".to_owned()),
        },
    }
}

/// What the run's desk can do for it; what that cannot is given back.
pub(super) fn errand(order: PageCommand) -> Result<Errand, Box<PageCommand>> {
    Ok(match order {
        PageCommand::Dock => Errand::Dock(DockPlan::DEFAULT),
        PageCommand::Undock => Errand::Undock(UNDOCK),
        PageCommand::Led { light, on } => Errand::Led {
            led: light.into(),
            on,
        },
        PageCommand::StopSound => Errand::StopSound,
        PageCommand::Behaviour { name, change } => Errand::Behaviour {
            name,
            change: change.into(),
        },
        PageCommand::Volume { percent } => Errand::Volume(percent),
        PageCommand::Play { ref sound } => match wire::Sound::from_name(sound) {
            Some(sound) => Errand::Play(sound),
            None => return Err(Box::new(order)),
        },
        other @ (PageCommand::Param { .. } | PageCommand::Sim { .. }) => {
            return Err(Box::new(other));
        }
    })
}

impl From<Light> for wire::Led {
    fn from(light: Light) -> wire::Led {
        match light {
            Light::Flash => wire::Led::Flash,
            Light::Left => wire::Led::Left,
            Light::Right => wire::Led::Right,
        }
    }
}

pub(super) fn in_words(answer: Answer) -> Done {
    match answer {
        Answer::Done | Answer::Overview(_) | Answer::Picture(_) | Answer::Behaviours(_) => {
            (true, String::new())
        }
        Answer::Docked { end, .. } => (good(end), end.name().to_owned()),
        Answer::Undocked(end) => (good(end), end.name().to_owned()),
        Answer::NoPicture => (false, "no picture came in time".to_owned()),
        Answer::Offline => (false, "the robot is out of reach".to_owned()),
        Answer::Refused(why) => (false, why),
    }
}

pub(super) fn good(end: DockEnd) -> bool {
    matches!(
        end,
        DockEnd::Done | DockEnd::AlreadyDocked | DockEnd::NotDocked
    )
}

fn told(altered: Result<(), impl std::fmt::Display>) -> Done {
    match altered {
        Ok(()) => (true, String::new()),
        Err(error) => (false, error.to_string()),
    }
}

/// Why the simulation is not altered.
#[derive(Debug, thiserror::Error)]
enum AlterError {
    #[error("{0} is out of range")]
    Range(&'static str),
    #[error("the speed is out of range: 1 to 100")]
    Speed,
    #[error("this simulation runs in real time; start it with --fast to control its clock")]
    NoTempo,
    #[error("{0}")]
    Fault(String),
}

fn alter(change: Change, simulation: &Simulation) -> Result<(), AlterError> {
    let sim = &simulation.robot;
    match change {
        Change::Place { x, y, heading } => {
            let heading = heading.unwrap_or_else(|| sim.state().pose.heading);
            let far = [x, y, heading].iter().all(|number| number.abs() <= FAR);
            within(far, "a place")?;
            sim.place(Pose::new(x, y, heading));
        }
        Change::PlaceBall { number, x, y } => {
            within(x.abs() <= FAR && y.abs() <= FAR, "a place")?;
            within(
                (1..=sim.world().balls.len()).contains(&number),
                "the ball's number",
            )?;
            sim.put_ball(number - 1, Point::new(x, y));
        }
        Change::Battery { percent } => {
            within((0.0..=100.0).contains(&percent), "percent")?;
            sim.set_battery(percent);
        }
        Change::Light { factor } => {
            within((0.0..=10.0).contains(&factor), "the factor of light")?;
            sim.set_light(factor);
        }
        Change::Noise { dbfs, seconds } => {
            within((-90.0..=-3.0).contains(&dbfs), "the loudness")?;
            within((0.1..=60.0).contains(&seconds), "seconds")?;
            sim.disturb(dbfs, Duration::from_secs_f64(seconds));
        }
        Change::HideStation { hidden } => sim.hide_station(hidden),
        Change::BreakCharger { broken } => sim.set_charging_broken(broken),
        Change::Fault { fault } => begin(fault, sim)?,
        Change::ClearFaults => sim.clear_faults(),
        Change::Pause { paused } => tempo(simulation)?.pause(paused),
        Change::Step => tempo(simulation)?.step(),
        Change::Speed { factor } => {
            let factor = Factor::new(factor).ok_or(AlterError::Speed)?;
            tempo(simulation)?.hurry(factor);
        }
    }
    Ok(())
}

fn tempo(simulation: &Simulation) -> Result<&Tempo, AlterError> {
    simulation.tempo.as_ref().ok_or(AlterError::NoTempo)
}

fn within(is: bool, what: &'static str) -> Result<(), AlterError> {
    is.then_some(()).ok_or(AlterError::Range(what))
}

/// As in the YAML of `spykee sim --faults`, which is JSON too.
fn begin(fault: Map<String, Value>, sim: &Handle) -> Result<(), AlterError> {
    let list = json!({ "faults": [fault] }).to_string();
    let faults = Fault::list_from_yaml(&list, "fault")
        .map_err(|error| AlterError::Fault(error.into_message()))?;
    faults.into_iter().for_each(|fault| sim.begin(fault));
    Ok(())
}

/// Errors echo little of what they are given.
fn short(text: &str) -> String {
    text.chars().take(40).collect()
}
