//! The commands of a person at the page or a program at the API, and their execution: by the run,
//! so that there is one definition of each request, or on the simulated world, with the operations
//! of scenarios.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use super::world::SimulatedRobot;
use crate::control::{self, Run, RunRequest, RunResponse};
use crate::robot::{DockEnd, DockPlan, ParamValue, Percent};
use crate::sim::{Fault, Handle, Point, Pose};
use crate::simulation::{SimClock, TimeScale};
use crate::wire;

/// Default timeout for an undocking.
pub(super) const UNDOCK: Duration = Duration::from_secs(15);
/// Maximum absolute value of a coordinate, in metres.
const FAR: f64 = 1000.0;

/// One command.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "do", rename_all = "snake_case", deny_unknown_fields)]
#[schemars(rename = "Command")]
pub(super) enum PageCommand {
    /// Drive to the station.
    Dock,
    /// Leave the station.
    Undock,
    /// Switch a light.
    Led {
        /// The light.
        light: Light,
        /// On or off.
        on: bool,
    },
    /// Play a sound, such as `laser`; `spykee robot play --help` lists them.
    Play {
        /// The name of the sound.
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
        /// The behaviour.
        name: String,
        /// The change.
        change: BehaviourAction,
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
        /// The change.
        change: Change,
    },
}

/// What to do with a behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum BehaviourAction {
    /// Start it.
    Start,
    /// Stop it.
    Stop,
    /// Stop it if it runs, and start it again from its file.
    Restart,
}

impl From<BehaviourAction> for control::Change {
    fn from(action: BehaviourAction) -> control::Change {
        match action {
            BehaviourAction::Start => control::Change::Start,
            BehaviourAction::Stop => control::Change::Stop,
            BehaviourAction::Restart => control::Change::Restart,
        }
    }
}

/// A light.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(super) enum Light {
    /// The headlight.
    Flash,
    /// The left light.
    Left,
    /// The right light.
    Right,
}

/// A change of the simulated world, as in scenarios (`sim:place` and so on).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "sim", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Change {
    /// Carry the robot somewhere.
    Place {
        /// Metres.
        x: f64,
        /// Metres.
        y: f64,
        /// Radians; unchanged unless given.
        heading: Option<f64>,
    },
    /// Put a ball somewhere, at rest.
    PlaceBall {
        /// The ball's number; 1 is the world's first.
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
    /// Scale the brightness of all light by this factor.
    Light {
        /// 0..=10.
        factor: f64,
    },
    /// Play a tone at the microphone.
    Noise {
        /// Its loudness, -90..=-3 dBFS.
        dbfs: f64,
        /// 0.1..=60.
        seconds: f64,
    },
    /// Hide the station from the robot's search, or show it again.
    HideStation {
        /// Hide it.
        hidden: bool,
    },
    /// Switch the station's charging current off, or on again.
    BreakCharger {
        /// Switch it off.
        broken: bool,
    },
    /// Begin a fault, as in the YAML of `spykee sim --faults`.
    Fault {
        /// `fault` is its name; the other keys are its parameters.
        fault: Map<String, Value>,
    },
    /// End all faults.
    ClearFaults,
    /// Pause the simulation's own clock, or resume it.
    Pause {
        /// Pause it.
        paused: bool,
    },
    /// Advance a paused clock by 0.1 s.
    Step,
    /// Run the clock this many times as fast as real time.
    Speed {
        /// 1..=100.
        factor: f64,
    },
}

/// The result of a command: success, and a text.
pub(super) type Done = (bool, String);

/// Executes a command. Dropping the future cancels it.
pub(super) async fn perform(command: PageCommand, run: &Run, sim: Option<&SimulatedRobot>) -> Done {
    match to_request(command) {
        Ok(request) => to_message(run.perform(request).await),
        Err(command) => match (*command, sim) {
            (PageCommand::Sim { change }, Some(sim)) => to_done(apply(change, sim)),
            (PageCommand::Param { name, param, value }, _) => {
                let turned = run.roster.change_param(&name, &param, value);
                to_done(turned)
            }
            (PageCommand::Play { sound }, _) => {
                (false, format!("there is no sound `{}`", truncated(&sound)))
            }
            _ => (false, "this robot is not simulated".to_owned()),
        },
    }
}

/// Converts a command to a request to the run; returns it unchanged if the run cannot execute it.
pub(super) fn to_request(command: PageCommand) -> Result<RunRequest, Box<PageCommand>> {
    Ok(match command {
        PageCommand::Dock => RunRequest::Dock(DockPlan::DEFAULT),
        PageCommand::Undock => RunRequest::Undock(UNDOCK),
        PageCommand::Led { light, on } => RunRequest::Led {
            led: light.into(),
            on,
        },
        PageCommand::StopSound => RunRequest::StopSound,
        PageCommand::Behaviour { name, change } => RunRequest::Behaviour {
            name,
            change: change.into(),
        },
        PageCommand::Volume { percent } => RunRequest::Volume(percent),
        PageCommand::Play { ref sound } => match wire::Sound::from_name(sound) {
            Some(sound) => RunRequest::Play(sound),
            None => return Err(Box::new(command)),
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

pub(super) fn to_message(answer: RunResponse) -> Done {
    match answer {
        RunResponse::Done
        | RunResponse::Stopped { .. }
        | RunResponse::Overview(_)
        | RunResponse::Picture(_)
        | RunResponse::Behaviours(_) => (true, String::new()),
        RunResponse::Docked { end, .. } => (succeeded(end), end.name().to_owned()),
        RunResponse::Undocked(end) => (succeeded(end), end.name().to_owned()),
        RunResponse::NoPicture => (false, "no picture arrived in time".to_owned()),
        RunResponse::Offline => (false, "the robot is out of reach".to_owned()),
        RunResponse::Refused(why) => (false, why),
    }
}

pub(super) fn succeeded(end: DockEnd) -> bool {
    matches!(
        end,
        DockEnd::Done | DockEnd::AlreadyDocked | DockEnd::NotDocked
    )
}

fn to_done(altered: Result<(), impl std::fmt::Display>) -> Done {
    match altered {
        Ok(()) => (true, String::new()),
        Err(error) => (false, error.to_string()),
    }
}

/// Why the simulation cannot be changed.
#[derive(Debug, thiserror::Error)]
enum ChangeError {
    #[error("{0} is out of range")]
    Range(&'static str),
    #[error("the speed is out of range: 1 to 100")]
    Speed,
    #[error("this simulation runs in real time; start it with --fast to control its clock")]
    NoSimClock,
    #[error("{0}")]
    Fault(String),
}

fn apply(change: Change, simulation: &SimulatedRobot) -> Result<(), ChangeError> {
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
        Change::Pause { paused } => sim_clock(simulation)?.pause(paused),
        Change::Step => sim_clock(simulation)?.step(),
        Change::Speed { factor } => {
            let factor = TimeScale::new(factor).ok_or(ChangeError::Speed)?;
            sim_clock(simulation)?.set_time_scale(factor);
        }
    }
    Ok(())
}

fn sim_clock(simulation: &SimulatedRobot) -> Result<&SimClock, ChangeError> {
    simulation.sim_clock.as_ref().ok_or(ChangeError::NoSimClock)
}

fn within(is: bool, what: &'static str) -> Result<(), ChangeError> {
    if is {
        Ok(())
    } else {
        Err(ChangeError::Range(what))
    }
}

/// Starts a fault, given as in the YAML of `spykee sim --faults`, of which JSON is a subset.
fn begin(fault: Map<String, Value>, sim: &Handle) -> Result<(), ChangeError> {
    let list = json!({ "faults": [fault] }).to_string();
    let faults = Fault::list_from_yaml(&list, "fault")
        .map_err(|error| ChangeError::Fault(error.into_message()))?;
    faults.into_iter().for_each(|fault| sim.begin(fault));
    Ok(())
}

fn truncated(text: &str) -> String {
    text.chars().take(40).collect()
}
