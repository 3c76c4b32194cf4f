//! A world's settings of the robot: its battery, its camera, its tracks.

use serde::Deserialize;

use crate::sim::yaml::number;
use crate::vision::Subsampling;

/// How the battery drains and charges. The defaults are like a real robot's: hours.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BatterySettings {
    /// Level at the start, percent.
    #[serde(deserialize_with = "number::percent")]
    pub level: f64,
    /// Percent a minute while standing.
    #[serde(deserialize_with = "number::percent_per_minute")]
    pub idle_drain_per_minute: f64,
    /// Percent a minute while both tracks run at full speed.
    #[serde(deserialize_with = "number::percent_per_minute")]
    pub driving_drain_per_minute: f64,
    /// Percent a minute on the station.
    #[serde(deserialize_with = "number::percent_per_minute")]
    pub charge_per_minute: f64,
}

impl Default for BatterySettings {
    fn default() -> BatterySettings {
        BatterySettings {
            level: 90.0,
            idle_drain_per_minute: 0.4,
            driving_drain_per_minute: 1.2,
            charge_per_minute: 0.8,
        }
    }
}

/// How the robot sees.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Frames a second while the video stream is on.
    #[serde(deserialize_with = "number::frames")]
    pub fps: f64,
    /// What it sees from side to side, degrees.
    #[serde(deserialize_with = "number::view_degrees")]
    pub hfov_degrees: f64,
    /// Grain of the picture, 0..=1.
    #[serde(deserialize_with = "number::share")]
    pub noise: f64,
    /// How long the shutter is open, seconds: what turns meanwhile is smeared.
    #[serde(deserialize_with = "number::moment")]
    pub shutter: f64,
    /// Time constant of the automatic exposure, seconds; 0 switches it off.
    #[serde(deserialize_with = "number::moment")]
    pub exposure: f64,
    /// From the moment that a frame shows to its sending, seconds.
    #[serde(deserialize_with = "number::moment")]
    pub latency: f64,
    /// Quality of the JPEG, 1..=100.
    #[serde(deserialize_with = "number::quality")]
    pub quality: f64,
    /// How much of the colour is left out in the JPEG.
    pub subsampling: Subsampling,
}

impl Default for CameraSettings {
    fn default() -> CameraSettings {
        CameraSettings {
            fps: 15.0,
            hfov_degrees: 60.0,
            noise: 0.25,
            shutter: 0.015,
            exposure: 0.0,
            latency: 0.0,
            quality: 75.0,
            subsampling: Subsampling::default(),
        }
    }
}

/// How unlike each other the tracks are, and how they slip. Left out, they are perfect.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackSettings {
    /// How much slower than asked for each track may be, as a share; the seed says how much it is.
    #[serde(deserialize_with = "number::slip")]
    pub unequal: f64,
    /// How much of its way a track may lose or win by slipping, as a share, another again and
    /// again.
    #[serde(deserialize_with = "number::slip")]
    pub slip: f64,
}
