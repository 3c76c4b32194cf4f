//! The options in the second argument of `scenario`.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::arguments::seconds;

/// Options of a scenario. The API table defines bounds and defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Name of a built-in world, or a file in the scenario's folder; the default world if `None`.
    pub world: Option<String>,
    /// The battery's level at the start, 0..=100 percent; the world's if `None`.
    pub battery: Option<f64>,
    /// Number of seeds: the scenario is run with the seeds from 1 to this.
    pub seeds: u64,
    /// Limit in virtual time.
    pub limit: Duration,
    /// Points in a lesson.
    pub points: u32,
    /// Frames per second of the robot's camera; the world's if `None`.
    pub fps: Option<f64>,
    /// Whether the scenario continues when a behaviour fails.
    pub may_fail: bool,
}

impl Options {
    /// Reads the options from a validated table.
    pub(super) fn parse(table: &Value) -> Options {
        let number = |key: &str| table[key].as_f64();
        Options {
            world: table["world"].as_str().map(str::to_owned),
            battery: number("battery"),
            seeds: number("seeds").unwrap_or_default() as u64,
            limit: seconds(&table["limit"]),
            points: number("points").unwrap_or_default() as u32,
            fps: number("fps"),
            may_fail: table["may_fail"] == true,
        }
    }
}
