//! Numbers of the YAML of worlds and faults with their ranges: checked while they are read, so that
//! an error knows line and column. NaN and infinities are in no range.

use std::fmt;

use serde::Deserializer;
use serde::de::{Error, Unexpected, Visitor};

/// A range of numbers and the unit that its error names.
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

/// Declares one reader for each quantity of a world.
macro_rules! ranges {
    ($($(#[$doc:meta])* $name:ident = $min:literal..=$max:literal, $unit:literal;)+) => {$(
        $(#[$doc])*
        pub(crate) fn $name<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
            from.deserialize_f64(Range { min: $min, max: $max, unit: $unit })
        }
    )+};
}

ranges! {
    /// Width or depth of a room.
    room_side = 1.0..=30.0, "metres";
    /// A place along an axis.
    coordinate = 0.0..=30.0, "metres";
    /// How high something is; the camera looks at 0.2 m and never sees a top.
    height = 0.25..=5.0, "metres";
    /// Length or width of furniture.
    side = 0.02..=10.0, "metres";
    /// How thick an inner wall is.
    thickness = 0.02..=0.5, "metres";
    /// Radius of a ball or a post.
    radius = 0.02..=0.5, "metres";
    /// A direction.
    degrees = -360.0..=360.0, "degrees";
    /// What the camera sees from side to side.
    view_degrees = 20.0..=120.0, "degrees";
    /// How much a lens bends the picture.
    distortion = -2.0..=2.0, "0 is not at all";
    /// Brightness.
    share = 0.0..=1.0, "1 is full";
    /// A battery's level.
    percent = 0.0..=100.0, "percent";
    /// How fast a battery empties or fills.
    percent_per_minute = 0.0..=6000.0, "percent a minute";
    /// Frames a second.
    frames = 1.0..=60.0, "frames a second";
    /// How far the station's beacon reaches.
    reach = 0.0..=50.0, "metres";
    /// How wide a line on the floor is.
    tape = 0.005..=0.3, "metres";
    /// Radius of a line's rounded corners.
    rounding = 0.0..=15.0, "metres";
    /// How fast something goes.
    speed = 0.0..=2.0, "metres a second";
    /// How high up a sign's middle is.
    sign_height = 0.05..=4.0, "metres";
    /// Side of a sign.
    sign_side = 0.05..=2.0, "metres";
    /// How far a lamp's light reaches.
    lamp_reach = 0.2..=30.0, "metres";
    /// A tone.
    hertz = 40.0..=7000.0, "hertz";
    /// Quality of a JPEG.
    quality = 1.0..=100.0, "100 is best";
    /// A short time.
    moment = 0.0..=2.0, "seconds";
    /// How much tracks differ or slip.
    slip = 0.0..=0.5, "1 is all";
    /// A time of a fault or of a schedule.
    span = 0.0..=86_400.0, "seconds";
    /// How probable something is.
    chance = 0.0..=1.0, "1 is always";
    /// So many bytes, or so many of them a second.
    bytes = 0.0..=65_535.0, "bytes";
}
