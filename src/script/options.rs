//! What a script is started with.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::vision::{Camera, Colour};

/// One mebibyte.
const MIB: u64 = 1024 * 1024;

/// Everything that a script is started with, apart from its source.
#[derive(Serialize, Deserialize, Clone, Debug)]
pub struct Options {
    /// What the script reads as `script.name`.
    pub name: String,
    /// The file as messages show it, such as `behaviours/patrol.lua`.
    pub chunk: String,
    /// Seeds `math.random`.
    pub seed: u64,
    /// What it may use.
    pub limits: Limits,
    /// How percent of power become metres per second.
    pub calibration: Calibration,
    /// How columns of a frame become directions.
    pub camera: Camera,
    /// Colours of the config, by name.
    pub colours: BTreeMap<String, Colour>,
    /// Where `frame:save` writes; `None`: nowhere, it answers `io`.
    pub data_dir: Option<PathBuf>,
    /// The most that the data folder may hold, in bytes.
    pub data_quota: u64,
}

impl Options {
    /// The defaults for a script of this name in this file, seed 0, no data folder.
    pub fn new(name: impl Into<String>, chunk: impl Into<String>) -> Options {
        Options {
            name: name.into(),
            chunk: chunk.into(),
            seed: 0,
            limits: Limits::default(),
            calibration: Calibration::default(),
            camera: Camera::default(),
            colours: BTreeMap::new(),
            data_dir: None,
            data_quota: 64 * MIB,
        }
    }
}

/// What one script may use.
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// The VM's own memory, in bytes: 8 MiB.
    pub memory_bytes: u64,
    /// How long it may run without waiting, in milliseconds, at least 10: 100.
    pub callback_budget_ms: u64,
    /// JPEG bytes of frames that the script holds on to, in bytes: 8 MiB.
    pub frame_bytes: u64,
    /// Sound above this level is a `noise`, in dBFS: -30.
    pub noise_dbfs: f64,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            memory_bytes: 8 * MIB,
            callback_budget_ms: 100,
            frame_bytes: 8 * MIB,
            noise_dbfs: -30.0,
        }
    }
}

impl Limits {
    /// How long the script may run without waiting.
    pub fn callback_budget(&self) -> Duration {
        Duration::from_millis(self.callback_budget_ms.max(10))
    }
}

/// How percent of track power become metres per second: open loop, so a matter of the floor too.
#[derive(Serialize, Deserialize, Clone, Copy, Debug, PartialEq)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    /// Distance between the middles of the tracks, in metres: 0.24.
    pub track_width: f64,
    /// Speed of a track at 100 % of power, in metres per second: 0.45.
    pub full_speed: f64,
}

impl Default for Calibration {
    fn default() -> Calibration {
        Calibration {
            track_width: 0.24,
            full_speed: 0.45,
        }
    }
}
