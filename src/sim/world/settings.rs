//! A world's settings for the robot: its battery, its camera and its tracks.

use serde::{Deserialize, Deserializer};

use crate::sim::yaml::number;
use crate::vision::Subsampling;

/// How the battery drains and charges. With the defaults it lasts hours, as on a real robot.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BatterySettings {
    /// Level at the start, percent.
    #[serde(deserialize_with = "number::percent")]
    pub level: f64,
    /// Drain at rest, percent per minute.
    #[serde(deserialize_with = "number::percent_per_minute")]
    pub idle_drain_per_minute: f64,
    /// Drain while both tracks run at full speed, percent per minute.
    #[serde(deserialize_with = "number::percent_per_minute")]
    pub driving_drain_per_minute: f64,
    /// Charge on the station, percent per minute.
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

/// Properties of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Frames per second while the video stream is on.
    #[serde(deserialize_with = "number::frames")]
    pub fps: f64,
    /// Horizontal field of view without distortion, degrees; that of the robot's lens if omitted.
    #[serde(deserialize_with = "some_view")]
    pub hfov_degrees: Option<f64>,
    /// Radial distortion `[k1, k2]`: a point at distance r from the image centre, in focal lengths,
    /// appears at r (1 + k1 r² + k2 r⁴). If omitted, that of the robot's lens if `hfov_degrees` is
    /// omitted too, otherwise none.
    #[serde(deserialize_with = "some_distortion")]
    pub distortion: Option<[f64; 2]>,
    /// Strength of the image grain, 0..=1.
    #[serde(deserialize_with = "number::share")]
    pub noise: f64,
    /// Exposure time of the shutter, seconds: turning meanwhile causes motion blur.
    #[serde(deserialize_with = "number::moment")]
    pub shutter: f64,
    /// Time constant of the automatic exposure, seconds; 0 switches it off.
    #[serde(deserialize_with = "number::moment")]
    pub exposure: f64,
    /// Delay from capturing a frame to sending it, seconds.
    #[serde(deserialize_with = "number::moment")]
    pub latency: f64,
    /// JPEG quality, 1..=100.
    #[serde(deserialize_with = "number::quality")]
    pub quality: f64,
    /// Chroma subsampling of the JPEG.
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

/// Field of view of the robot's lens, from a measured focal length of 381 pixels.
const HFOV_DEGREES: f64 = 45.6;
/// Typical for such lenses; the distortion of the robot's lens is not known.
const DISTORTION: [f64; 2] = [-0.25, 0.08];

impl CameraSettings {
    /// Returns the horizontal field of view without distortion, degrees.
    pub fn hfov_degrees(&self) -> f64 {
        self.hfov_degrees.unwrap_or(HFOV_DEGREES)
    }

    /// Returns the radial distortion, k1 and k2.
    pub fn distortion(&self) -> [f64; 2] {
        let usual = match self.hfov_degrees {
            None => DISTORTION,
            Some(_) => [0.0, 0.0],
        };
        self.distortion.unwrap_or(usual)
    }

    /// Whether the lens folds the image: it would show two directions at one place.
    pub(super) fn folds(&self) -> bool {
        const STEP: f64 = 0.002;
        let [k1, k2] = self.distortion();
        let corner = (self.hfov_degrees().to_radians() / 2.0).tan() * 1.25;
        let mut r = 0.0;
        let mut distorted = 0.0;
        while distorted < corner {
            r += STEP;
            let farther = r * (1.0 + r * r * (k1 + k2 * r * r));
            if farther <= distorted {
                return true;
            }
            distorted = farther;
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

/// How much the tracks differ and slip. By default they are perfect.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackSettings {
    /// Maximum share by which each track is slower than commanded; the seed determines the actual
    /// share.
    #[serde(deserialize_with = "number::slip")]
    pub unequal: f64,
    /// Maximum share of its speed that a track loses or gains by slipping; a new value is drawn
    /// regularly.
    #[serde(deserialize_with = "number::slip")]
    pub slip: f64,
}
