//! Places in a world's YAML.

use serde::Deserialize;

use crate::sim::geometry::{Point, Pose};
use crate::sim::yaml::number;

/// Where the robot stands at first and which way it looks.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// Where.
    pub at: Spot,
    /// Degrees, left positive, 0 looks along x.
    #[serde(default, deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
}

impl Start {
    /// The same in radians.
    pub fn pose(&self) -> Pose {
        Pose::at(self.at.point(), self.heading_degrees.to_radians())
    }
}

/// `[x, y]` in metres.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Spot([Coordinate; 2]);

#[derive(Debug, Clone, Copy, Deserialize)]
struct Coordinate(#[serde(deserialize_with = "number::coordinate")] f64);

impl Spot {
    /// The place on the floor.
    pub fn point(self) -> Point {
        Point::new(self.0[0].0, self.0[1].0)
    }
}
