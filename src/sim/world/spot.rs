//! Places in a world's YAML.

use serde::Deserialize;

use crate::sim::geometry::{Point, Pose};
use crate::sim::yaml::number;

/// The robot's start place and heading.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Start {
    /// The place.
    pub at: Spot,
    /// Heading in degrees, left positive; 0 is along x.
    #[serde(default, deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
}

impl Start {
    /// Returns the start as a pose.
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
    /// Returns the place on the floor.
    pub fn point(self) -> Point {
        Point::new(self.0[0].0, self.0[1].0)
    }
}
