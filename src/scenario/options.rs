//! What stands in the second argument of `scenario`.

use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::arguments::seconds;

/// How a scenario is set up. The API table has the bounds and the defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// A ready world's name, or a file beside the scenario's; the built-in one if there is none.
    pub world: Option<String>,
    /// The battery's level at the start, 0..=100 percent, if not the world's.
    pub battery: Option<f64>,
    /// It is played with the seeds from 1 to this.
    pub seeds: u64,
    /// So much virtual time it may take.
    pub limit: Duration,
    /// What it counts in a lesson.
    pub points: u32,
    /// Frames a second of the robot's camera, if not the world's.
    pub fps: Option<f64>,
    /// A behaviour that fails does not fail the scenario.
    pub may_fail: bool,
}

impl Options {
    /// Of a table that was held against its row.
    pub(super) fn of(table: &Value) -> Options {
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
