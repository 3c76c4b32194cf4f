//! A world's settings for the robot: its battery, its camera and its tracks.

use serde::de::Error;
use serde::{Deserialize, Deserializer};
use vision::{Camera, Subsampling};

use crate::body::chassis::FULL_POWER;
use crate::document::number;

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
    /// What the robot reports as its level.
    pub power: PowerReading,
}

/// What the robot reports as its level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PowerReading {
    /// The share of the energy that is left.
    #[default]
    Percent,
    /// The voltage of a NiMH battery, as a share of its range: flat in the middle, with a cliff at
    /// the end; it sags while the tracks run and jumps up while it charges. The energy itself
    /// drains as with `percent`.
    Voltage,
}

impl Default for BatterySettings {
    fn default() -> BatterySettings {
        BatterySettings {
            level: 90.0,
            idle_drain_per_minute: 0.4,
            driving_drain_per_minute: 1.2,
            charge_per_minute: 0.8,
            power: PowerReading::Percent,
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
    /// Height of the lens above the floor, metres.
    #[serde(deserialize_with = "number::lens_height")]
    pub height: f64,
    /// Degrees by which the camera looks up; negative down.
    #[serde(deserialize_with = "number::pitch")]
    pub pitch: f64,
    /// Degrees, positive when the horizon falls to the right in the picture.
    #[serde(deserialize_with = "number::roll")]
    pub roll: f64,
    /// Horizontal field of view without distortion, degrees; the robot's own lens if omitted.
    #[serde(deserialize_with = "number::view_degrees")]
    pub hfov_degrees: Option<f64>,
    /// Distortion `[k1, k2]` or `[k1, k2, p1, p2]` after Brown and Conrady. If omitted, that of the
    /// robot's lens if `hfov_degrees` is omitted too, otherwise none.
    #[serde(deserialize_with = "some_distortion")]
    pub distortion: Option<[f64; 4]>,
    /// Strength of the image grain, 0..=1.
    #[serde(deserialize_with = "number::share")]
    pub noise: f64,
    /// Exposure time of the shutter, seconds: turning meanwhile causes motion blur.
    #[serde(deserialize_with = "number::moment")]
    pub shutter: f64,
    /// Time constant of the automatic exposure, seconds; 0 switches it off.
    #[serde(deserialize_with = "number::moment")]
    pub exposure: f64,
    /// Mean brightness of the frame that the automatic exposure aims at, 0..=1.
    #[serde(deserialize_with = "number::share")]
    pub brightness: f64,
    /// The share of its red, green and blue light that the frame lacks in its corners.
    #[serde(deserialize_with = "channels_lost")]
    pub vignette: [f64; 3],
    /// Strength of the colours, 0..=1.
    #[serde(deserialize_with = "number::share")]
    pub saturation: f64,
    /// Standard deviation of the lens's blur, pixels.
    #[serde(deserialize_with = "number::softness")]
    pub softness: f64,
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
            height: 0.29,
            pitch: 0.0,
            roll: 0.0,
            hfov_degrees: None,
            distortion: None,
            noise: 0.25,
            shutter: 0.015,
            exposure: 0.0,
            brightness: 105.0 / 255.0,
            vignette: [0.0; 3],
            saturation: 1.0,
            softness: 0.0,
            latency: 0.0,
            quality: 50.0,
            subsampling: Subsampling::default(),
        }
    }
}

impl CameraSettings {
    /// Returns what an owner who has measured this camera writes into the config.
    pub fn calibrated(&self) -> Camera {
        let usual = match self.hfov_degrees {
            None => Camera::default(),
            Some(degrees) => Camera::pinhole(degrees.to_radians()),
        };
        Camera {
            height: self.height,
            pitch: self.pitch,
            roll: self.roll,
            distortion: self.distortion.unwrap_or(usual.distortion),
            ..usual
        }
    }

    /// Whether the lens folds the image: it would show two directions at one place.
    pub(super) fn folds(&self) -> bool {
        const STEP: f64 = 0.002;
        const LEAST: f64 = 0.1;
        let camera = self.calibrated();
        let [x, y] = camera.centre;
        let [k1, k2, p1, p2] = camera.distortion;
        let focal = camera.focal[0].min(camera.focal[1]);
        let corner = f64::max(x, 319.0 - x).hypot(f64::max(y, 239.0 - y)) / focal;
        let aside = 6.0 * p1.hypot(p2);
        let mut r = 0.0;
        let mut distorted = 0.0;
        while distorted < corner {
            r += STEP;
            let farther = r * (1.0 + r * r * (k1 + k2 * r * r));
            if farther <= distorted + STEP * (LEAST + aside * r) {
                return true;
            }
            distorted = farther;
        }
        false
    }
}

fn some_distortion<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[f64; 4]>, D::Error> {
    #[derive(Deserialize)]
    struct Factor(#[serde(deserialize_with = "number::distortion")] f64);
    let factors = <Vec<Factor>>::deserialize(from)?;
    match factors[..] {
        [Factor(k1), Factor(k2)] => Ok(Some([k1, k2, 0.0, 0.0])),
        [Factor(k1), Factor(k2), Factor(p1), Factor(p2)] => Ok(Some([k1, k2, p1, p2])),
        _ => Err(D::Error::invalid_length(
            factors.len(),
            &"k1, k2 or k1, k2, p1, p2",
        )),
    }
}

fn channels_lost<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
    #[derive(Deserialize)]
    struct Lost(#[serde(deserialize_with = "number::lost")] f64);
    <[Lost; 3]>::deserialize(from).map(|channels| channels.map(|Lost(share)| share))
}

/// How the tracks follow their commands, differ and slip. By default they are perfect.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
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
    /// Percent of full power below which a track stands. The robot's own manoeuvres are not
    /// affected.
    #[serde(deserialize_with = "number::dead_zone")]
    pub dead_zone: f64,
    /// Which share of its speed the robot reaches.
    pub response: TrackResponse,
}

impl Default for TrackSettings {
    fn default() -> TrackSettings {
        TrackSettings {
            unequal: 0.0,
            slip: 0.0,
            dead_zone: 5.5,
            response: TrackResponse::default(),
        }
    }
}

impl TrackSettings {
    /// Returns the least power that moves a track, percent, to one decimal: that of the least command
    /// that does.
    pub fn least_power(&self) -> f64 {
        let full = f64::from(FULL_POWER);
        let least = (self.dead_zone / 100.0 * full).ceil() / full;
        (1000.0 * least).ceil() / 10.0
    }
}

/// Which share of its speed the robot reaches; by default all of it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackResponse {
    /// With an empty battery; more as the level rises, all of it with a full one.
    #[serde(deserialize_with = "number::response")]
    pub empty: f64,
    /// On the room's floor.
    #[serde(deserialize_with = "number::response")]
    pub floor: f64,
    /// On rugs.
    #[serde(deserialize_with = "number::response")]
    pub rug: f64,
}

impl Default for TrackResponse {
    fn default() -> TrackResponse {
        TrackResponse {
            empty: 1.0,
            floor: 1.0,
            rug: 1.0,
        }
    }
}

impl TrackResponse {
    /// Returns the share at a battery level of 0 to 100 percent.
    pub(crate) fn share(self, percent: f64, on_rug: bool) -> f64 {
        let ground = if on_rug { self.rug } else { self.floor };
        ground * (self.empty + (1.0 - self.empty) * percent / 100.0)
    }
}
