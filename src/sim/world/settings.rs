//! A world's settings of the robot: its battery, its camera, its tracks.

use serde::{Deserialize, Deserializer};

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
    /// What it would see from side to side without distortion, degrees; left out, what the robot's
    /// lens does.
    #[serde(deserialize_with = "some_view")]
    pub hfov_degrees: Option<f64>,
    /// How the lens bends the picture, `[k1, k2]`: seen from the middle, in focal lengths, what is at
    /// r appears at r (1 + k1 r² + k2 r⁴). Left out, as the robot's lens if the view is its own too,
    /// else not at all.
    #[serde(deserialize_with = "some_distortion")]
    pub distortion: Option<[f64; 2]>,
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
            hfov_degrees: None,
            distortion: None,
            noise: 0.25,
            shutter: 0.015,
            exposure: 0.0,
            latency: 0.0,
            quality: 50.0,
            subsampling: Subsampling::default(),
        }
    }
}

/// A focal length of 381 pixels was measured.
const HFOV_DEGREES: f64 = 45.6;
/// Usual for such lenses: that of the robot's is not known.
const DISTORTION: [f64; 2] = [-0.25, 0.08];

impl CameraSettings {
    /// What the camera would see from side to side without distortion, degrees.
    pub fn hfov_degrees(&self) -> f64 {
        self.hfov_degrees.unwrap_or(HFOV_DEGREES)
    }

    /// How the lens bends the picture: k1 and k2.
    pub fn distortion(&self) -> [f64; 2] {
        let usual = match self.hfov_degrees {
            None => DISTORTION,
            Some(_) => [0.0, 0.0],
        };
        self.distortion.unwrap_or(usual)
    }

    /// Whether the lens shows two directions in one place of the picture.
    pub(super) fn folds(&self) -> bool {
        const STEP: f64 = 0.002;
        let [k1, k2] = self.distortion();
        let corner = (self.hfov_degrees().to_radians() / 2.0).tan() * 1.25;
        let (mut r, mut bent) = (0.0, 0.0);
        while bent < corner {
            r += STEP;
            let farther = r * (1.0 + r * r * (k1 + k2 * r * r));
            if farther <= bent {
                return true;
            }
            bent = farther;
        }
        false
    }
}

fn some_view<'de, D: Deserializer<'de>>(from: D) -> Result<Option<f64>, D::Error> {
    number::view_degrees(from).map(Some)
}

fn some_distortion<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f64; 2]>, D::Error> {
    #[derive(Deserialize)]
    struct Factor(#[serde(deserialize_with = "number::distortion")] f64);
    let [Factor(k1), Factor(k2)] = <[Factor; 2]>::deserialize(from)?;
    Ok(Some([k1, k2]))
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
