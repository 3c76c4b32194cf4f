//! The options that a script is started with, and the interface of scenario scripts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::declaration::GivenParam;
use super::failure::SourceLocation;
use crate::robot::{Setpoint, Streams};
use crate::vision::{Camera, Colour, Drive};

const MIB: u64 = 1024 * 1024;

/// Everything that a script is started with, apart from its source.
#[derive(Serialize, Deserialize, Clone, Debug, Default)]
pub struct Options {
    /// What the script reads as `script.name`.
    pub name: String,
    /// The file as messages show it, such as `behaviours/patrol.lua`.
    pub chunk: String,
    pub seed: u64,
    /// The resources that it may use.
    pub limits: Limits,
    /// How percent of power is converted to metres per second.
    pub calibration: Calibration,
    /// How columns of a frame are converted to directions.
    pub camera: Camera,
    /// The colours of the config, by name.
    pub colours: BTreeMap<String, Colour>,
    /// When the robot's streams are on.
    pub streams: Streams,
    /// The time zone of `clock.date()`, such as `Europe/Rome`.
    pub time_zone: String,
    /// How far the script's time of day is ahead of the computer's, in milliseconds.
    pub clock: i64,
    /// Values for the parameters that the script declares with `params.declare`, by name.
    pub params: BTreeMap<String, GivenParam>,
    /// The folder where `frame:save` writes. If `None`, it saves nothing and returns `io`.
    pub data_dir: Option<PathBuf>,
    /// Whether the script keeps running when nothing is left to do, because a person types what
    /// comes next.
    pub interactive: bool,
    /// How many bytes of pictures may be saved at once now, if not the whole that the limits permit: an
    /// earlier host has saved some.
    pub bytes_left: Option<u64>,
    /// The folder where the host saves marked copies of the frames that the script examined; `None`
    /// to save none.
    pub annotate_dir: Option<PathBuf>,
    /// Whether people are watching: then detections in frames are reported, at most ten times a
    /// second.
    pub detections: bool,
}

impl Options {
    /// The defaults for a script of this name in this file, seed 0, no data folder.
    pub fn new(name: impl Into<String>, chunk: impl Into<String>) -> Options {
        Options {
            name: name.into(),
            chunk: chunk.into(),
            time_zone: "UTC".to_owned(),
            ..Options::default()
        }
    }

    /// The folders that the script's host writes to; it can open no others.
    pub fn folders(&self) -> Vec<&Path> {
        let folders = [&self.data_dir, &self.annotate_dir];
        folders
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
            .collect()
    }
}

/// The resources that one script may use.
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "ScriptLimits")]
pub struct Limits {
    /// The memory of the VM, and as much again of the JPEG frames that the script keeps, in bytes:
    /// 8 MiB.
    #[serde(deserialize_with = "ranges::memory_bytes")]
    pub memory_bytes: u64,
    /// The longest run without waiting, in milliseconds, at least 10: 100.
    #[serde(deserialize_with = "ranges::callback_budget_ms")]
    pub callback_budget_ms: u64,
    /// The level above which sound causes a `noise` event, in dBFS: -30.
    #[serde(deserialize_with = "ranges::noise_dbfs")]
    pub noise_dbfs: f64,
    /// The largest size of the script's data folder, in bytes; beyond that the oldest pictures are
    /// deleted: 64 MiB.
    #[serde(deserialize_with = "ranges::disk_bytes")]
    pub picture_bytes: u64,
    /// The most bytes of pictures that it may save per day, of which a 24th at once: 256 MiB. Its
    /// store may write as much (beyond that it is written once a minute), a run with `--annotate` as
    /// much for its marked copies, its log a quarter, and the journal a 64th.
    #[serde(deserialize_with = "ranges::disk_bytes")]
    pub bytes_a_day: u64,
    /// The bytes of the disk that must stay free; with less, scripts write nothing.
    #[serde(skip)]
    pub free_bytes: u64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            memory_bytes: 8 * MIB,
            callback_budget_ms: 100,
            noise_dbfs: -30.0,
            picture_bytes: 64 * MIB,
            bytes_a_day: 256 * MIB,
            free_bytes: 64 * MIB,
        }
    }
}

/// The most messages that `notify.send` may send per day, of which a 24th at once.
pub const NOTICES_A_DAY: u64 = 120;

impl Limits {
    /// The most bytes that the script may log per day. Dropped lines are counted.
    pub fn log_bytes_a_day(&self) -> u64 {
        self.bytes_a_day / 4
    }

    /// The most bytes that `journal.add` may add per day, including the names of pictures.
    pub fn journal_bytes_a_day(&self) -> u64 {
        self.bytes_a_day / 64
    }

    /// How long the script may run without waiting.
    pub fn callback_budget(&self) -> Duration {
        Duration::from_millis(self.callback_budget_ms.max(10))
    }
}

/// The values that a config may set; the VM would take a limit of 0 for no limit.
mod ranges {
    use serde::Deserializer;

    use crate::yaml::whole_within;

    type Read<'de, T, D> = Result<T, <D as Deserializer<'de>>::Error>;

    pub(super) fn memory_bytes<'de, D: Deserializer<'de>>(from: D) -> Read<'de, u64, D> {
        whole_within(
            from,
            "a whole number of bytes, 1048576 to 268435456",
            (1 << 20)..=(256 << 20),
        )
    }

    pub(super) fn callback_budget_ms<'de, D: Deserializer<'de>>(from: D) -> Read<'de, u64, D> {
        whole_within(
            from,
            "a whole number of milliseconds, 10 to 10000",
            10..=10_000,
        )
    }

    pub(super) fn disk_bytes<'de, D: Deserializer<'de>>(from: D) -> Read<'de, u64, D> {
        whole_within(from, "a whole number of bytes, 0 to 2^50", 0..=(1 << 50))
    }

    crate::yaml::ranges! {
        noise_dbfs = -100.0..=0.0, "dBFS";
        track_width = 0.02..=2.0, "metres";
        full_speed = 0.01..=5.0, "metres a second";
        least_power = 0.0..=50.0, "percent of full power";
    }
}

/// Converts percent of track power to metres per second. There is no feedback from the tracks, so
/// the real speed depends on the floor.
#[derive(Serialize, Deserialize, Clone, Copy, Debug, PartialEq, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    /// Distance between the centre lines of the tracks, in metres: 0.24.
    #[serde(deserialize_with = "ranges::track_width")]
    pub track_width: f64,
    /// Speed of a track at 100 % of power, in metres per second: 0.45.
    #[serde(deserialize_with = "ranges::full_speed")]
    pub full_speed: f64,
    /// Power below which a track stands, in percent: 20. Speeds that would need less get this power.
    #[serde(deserialize_with = "ranges::least_power")]
    pub least_power: f64,
}

/// The power of a track at full speed, in the units of the robot's MOVE command.
const FULL_POWER: f64 = 90.0;

impl Calibration {
    /// The motion that a setpoint should cause.
    pub(crate) fn drive(self, setpoint: Setpoint) -> Drive {
        let speed = |power: i8| f64::from(power) / FULL_POWER * self.full_speed;
        let left = speed(setpoint.left.get());
        let right = speed(setpoint.right.get());
        Drive {
            forward: (left + right) / 2.0,
            turn: (right - left) / self.track_width,
        }
    }
}

impl Default for Calibration {
    fn default() -> Calibration {
        Calibration {
            track_width: 0.24,
            full_speed: 0.45,
            least_power: 20.0,
        }
    }
}

/// An error in a call, for the script's author.
pub type ScenarioCallError = Box<dyn std::error::Error>;

/// The answer of the scenario API, as plain data.
pub type ScenarioCallResult = Result<Value, ScenarioCallError>;

#[derive(Debug, Clone, Copy)]
pub struct ScenarioCall<'a> {
    /// Its name, such as `sim:location`.
    pub name: &'a str,
    /// As plain data.
    pub arguments: &'a [Value],
    pub location: Option<&'a SourceLocation>,
}

/// What a scenario script calls through `scenario`, `expect` and `sim`.
pub trait ScenarioApi {
    fn answer(&self, call: ScenarioCall<'_>) -> ScenarioCallResult;
}
