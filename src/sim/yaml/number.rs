//! Range checks for numbers in the YAML of worlds, faults and firmware: applied during parsing, so
//! that errors have line and column. NaN and infinities are always rejected.

use std::fmt;

use serde::Deserializer;
use serde::de::{Error, Unexpected, Visitor};

/// A range of numbers, with the unit for its error message.
struct Range {
    min: f64,
    max: f64,
    unit: &'static str,
}

impl Visitor<'_> for Range {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "a number from {} to {} ({})",
            self.min, self.max, self.unit
        )
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<f64, E> {
        if (self.min..=self.max).contains(&value) {
            return Ok(value);
        }
        Err(E::invalid_value(Unexpected::Float(value), &self))
    }

    fn visit_i64<E: Error>(self, value: i64) -> Result<f64, E> {
        self.visit_f64(value as f64)
    }

    fn visit_u64<E: Error>(self, value: u64) -> Result<f64, E> {
        self.visit_f64(value as f64)
    }
}

/// Declares one deserialize function per quantity.
macro_rules! ranges {
    ($($(#[$doc:meta])* $name:ident = $min:literal..=$max:literal, $unit:literal;)+) => {$(
        $(#[$doc])*
        pub(crate) fn $name<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
            from.deserialize_f64(Range { min: $min, max: $max, unit: $unit })
        }
    )+};
}

ranges! {
    room_side = 1.0..=30.0, "metres";
    coordinate = 0.0..=30.0, "metres";
    /// Height of a thing.
    height = 0.25..=5.0, "metres";
    /// Height of a rug's edge or of a sill.
    bump = 0.0..=0.03, "metres";
    /// Length or width of furniture.
    side = 0.02..=10.0, "metres";
    thickness = 0.02..=0.5, "metres";
    /// Radius of a ball or a post.
    radius = 0.02..=0.5, "metres";
    degrees = -360.0..=360.0, "degrees";
    /// Height of the camera: below the station's top; the world is checked for lower things.
    lens_height = 0.05..=0.33, "metres";
    pitch = -45.0..=30.0, "degrees, up is positive";
    roll = -30.0..=30.0, "degrees, positive when the horizon falls to the right";
    /// Horizontal field of view of the camera.
    view_degrees = 20.0..=120.0, "degrees";
    /// Distortion coefficient of a lens.
    distortion = -2.0..=2.0, "0 is no distortion";
    /// Brightness.
    share = 0.0..=1.0, "1 is full";
    percent = 0.0..=100.0, "percent";
    percent_per_minute = 0.0..=6000.0, "percent a minute";
    frames = 1.0..=60.0, "frames a second";
    /// Range of the station's beacon, or of the Wi-Fi.
    reach = 0.0..=50.0, "metres";
    /// Width of a line on the floor.
    tape = 0.005..=0.3, "metres";
    /// Radius of a line's rounded corners.
    rounding = 0.0..=15.0, "metres";
    speed = 0.0..=2.0, "metres a second";
    sign_height = 0.05..=4.0, "metres";
    sign_side = 0.05..=2.0, "metres";
    lamp_reach = 0.2..=30.0, "metres";
    hertz = 40.0..=7000.0, "hertz";
    quality = 1.0..=100.0, "100 is best";
    moment = 0.0..=2.0, "seconds";
    /// Standard deviation of a blur.
    softness = 0.0..=2.0, "pixels";
    /// Share of the light that is lost.
    lost = 0.0..=0.95, "0 is none";
    /// Share by which tracks differ or slip.
    slip = 0.0..=0.5, "1 is all";
    /// Least power that moves a track.
    dead_zone = 0.0..=90.0, "percent of full power";
    /// Share of its speed that a robot reaches.
    response = 0.1..=1.0, "1 is all";
    /// A time or duration of a fault, of a schedule or of the firmware.
    span = 0.0..=86_400.0, "seconds";
    hours = 0.01..=100.0, "hours";
    chance = 0.0..=1.0, "1 is always";
    bytes = 0.0..=65_535.0, "bytes";
    commands = 1.0..=4096.0, "commands";
    commands_per_second = 0.1..=1000.0, "commands a second";
}
