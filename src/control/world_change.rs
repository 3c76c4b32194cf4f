//! Changes of the simulated world, by the page or a program, with the operations of scenarios.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};

use crate::sim::{Fault, Handle, Point, Pose};
use crate::simulation::{SimClock, TimeScale};

/// Maximum absolute value of a coordinate, in metres.
const FAR: f64 = 1000.0;

#[derive(Clone)]
pub struct SimulatedRobot {
    pub robot: Handle,
    pub sim_clock: Option<SimClock>,
}

impl From<Handle> for SimulatedRobot {
    fn from(robot: Handle) -> SimulatedRobot {
        SimulatedRobot {
            robot,
            sim_clock: None,
        }
    }
}

impl std::fmt::Debug for SimulatedRobot {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("SimulatedRobot").finish_non_exhaustive()
    }
}

/// A change of the simulated world, as in scenarios (`sim:place` and so on).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "sim", rename_all = "snake_case", deny_unknown_fields)]
pub enum WorldChange {
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
        /// 0.1..=100; below 1 is slow motion.
        factor: f64,
    },
}

impl WorldChange {
    /// Makes the change.
    /// Fails if a value is out of range, or the clock cannot be controlled.
    pub(super) fn apply(self, simulation: &SimulatedRobot) -> Result<(), String> {
        let sim = &simulation.robot;
        match self {
            WorldChange::Place { x, y, heading } => {
                let heading = heading.unwrap_or_else(|| sim.state().pose.heading);
                let far = [x, y, heading].iter().all(|number| number.abs() <= FAR);
                within(far, "a place")?;
                sim.place(Pose::new(x, y, heading));
            }
            WorldChange::PlaceBall { number, x, y } => {
                within(x.abs() <= FAR && y.abs() <= FAR, "a place")?;
                within(
                    (1..=sim.world().balls.len()).contains(&number),
                    "the ball's number",
                )?;
                sim.put_ball(number - 1, Point::new(x, y));
            }
            WorldChange::Battery { percent } => {
                within((0.0..=100.0).contains(&percent), "percent")?;
                sim.set_battery(percent);
            }
            WorldChange::Light { factor } => {
                within((0.0..=10.0).contains(&factor), "the factor of light")?;
                sim.set_light(factor);
            }
            WorldChange::Noise { dbfs, seconds } => {
                within((-90.0..=-3.0).contains(&dbfs), "the loudness")?;
                within((0.1..=60.0).contains(&seconds), "seconds")?;
                sim.disturb(dbfs, Duration::from_secs_f64(seconds));
            }
            WorldChange::HideStation { hidden } => sim.hide_station(hidden),
            WorldChange::BreakCharger { broken } => sim.set_charging_broken(broken),
            WorldChange::Fault { fault } => begin(fault, sim)?,
            WorldChange::ClearFaults => sim.clear_faults(),
            WorldChange::Pause { paused } => sim_clock(simulation)?.pause(paused),
            WorldChange::Step => sim_clock(simulation)?.step(),
            WorldChange::Speed { factor } => {
                let factor =
                    TimeScale::new(factor).ok_or("the speed is out of range: 0.1 to 100")?;
                sim_clock(simulation)?.set_time_scale(factor);
            }
        }
        Ok(())
    }
}

fn sim_clock(simulation: &SimulatedRobot) -> Result<&SimClock, String> {
    let real = "this simulation runs in real time; start it with --fast to control its clock";
    simulation.sim_clock.as_ref().ok_or(real.to_owned())
}

fn within(is: bool, what: &str) -> Result<(), String> {
    if is {
        Ok(())
    } else {
        Err(format!("{what} is out of range"))
    }
}

/// Starts a fault, given as in the YAML of `spykee sim --faults`, of which JSON is a subset.
fn begin(fault: Map<String, Value>, sim: &Handle) -> Result<(), String> {
    let list = json!({ "faults": [fault] }).to_string();
    let faults = Fault::list_from_yaml(&list, "fault").map_err(|error| error.into_message())?;
    faults.into_iter().for_each(|fault| sim.begin(fault));
    Ok(())
}
