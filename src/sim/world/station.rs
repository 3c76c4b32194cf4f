//! The charging station: where it stands, where a robot on it stands, and how far its infrared
//! beacon reaches. The robot drives onto it forwards and leaves it backwards.

use std::f64::consts::PI;

use serde::Deserialize;

use super::spot::Spot;
use crate::sim::geometry::RADIUS;
use crate::sim::geometry::obstacles::Obstacles;
use crate::sim::geometry::{Point, Pose, Segment, rectangle, wrap};
use crate::sim::yaml::number;

/// How far the station's body stands out from its back, metres.
const DEPTH: f64 = 0.10;
/// How wide the station's body is, metres.
const WIDTH: f64 = 0.36;
/// How high the station's body is, metres.
pub(crate) const HEIGHT: f64 = 0.34;
/// Between the station and a robot on it, metres.
const GAP: f64 = 0.005;
/// Where the final, straight way onto the station begins: metres before its contacts.
const STAGING: f64 = 0.55;
/// So near to the station its beacon is seen from every side, metres.
const GLOW: f64 = 0.8;

/// How exactly a robot must stand to touch the contacts.
struct Contact {
    ahead: f64,
    aside: f64,
    turned: f64,
}

const MAKES: Contact = Contact {
    ahead: 0.015,
    aside: 0.04,
    turned: 0.2,
};
/// Springs hold a contact a little longer than they let it begin.
const BREAKS: Contact = Contact {
    ahead: 0.05,
    aside: 0.07,
    turned: 0.35,
};

/// The charging station.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// The middle of its back, usually on a wall.
    pub at: Spot,
    /// Into the room, degrees: where a leaving robot goes, backwards.
    #[serde(deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
    /// How far its beacon reaches, metres.
    #[serde(default = "beacon_range", deserialize_with = "number::reach")]
    pub beacon_range: f64,
    /// How far to each side of its heading the beacon shines, degrees.
    #[serde(default = "beacon_degrees", deserialize_with = "number::degrees")]
    pub beacon_degrees: f64,
}

impl Station {
    /// Into the room, radians.
    pub(crate) fn heading(&self) -> f64 {
        self.heading_degrees.to_radians()
    }

    /// Where a robot on the station stands, facing it.
    pub fn dock_pose(&self) -> Pose {
        self.facing(DEPTH + GAP + RADIUS)
    }

    /// Where the final, straight way onto the station begins.
    pub fn staging_pose(&self) -> Pose {
        self.facing(DEPTH + GAP + RADIUS + STAGING)
    }

    fn facing(&self, distance: f64) -> Pose {
        let point = self.at.point().ahead(self.heading(), distance);
        Pose::at(point, wrap(self.heading() + PI))
    }

    /// The corners of its foot.
    pub fn outline(&self) -> [Point; 4] {
        self.sides().map(|side| side.from)
    }

    /// The four sides of its body; the first is the front.
    pub(crate) fn sides(&self) -> [Segment; 4] {
        let middle = self.at.point().ahead(self.heading(), DEPTH / 2.0);
        rectangle(middle, DEPTH, WIDTH, self.heading())
    }

    /// Where its beacon shines from.
    pub(crate) fn beacon(&self) -> Point {
        self.at.point().ahead(self.heading(), DEPTH + 0.01)
    }

    /// Whether a robot at `point` is in the light of the beacon.
    pub(crate) fn beacon_reaches(&self, point: Point, obstacles: &Obstacles) -> bool {
        let beacon = self.beacon();
        let distance = beacon.distance(point);
        let off_axis = wrap(beacon.direction_of(point) - self.heading()).abs();
        let in_cone = off_axis <= self.beacon_degrees.abs().to_radians();
        let near = distance <= GLOW && off_axis <= PI / 2.0;
        distance <= self.beacon_range && (in_cone || near) && obstacles.sight(beacon, point)
    }

    /// How far before the contacts a robot stands (metres, along the station's axis) and how far
    /// to the left of the axis, seen from the station.
    pub(crate) fn offset(&self, pose: Pose) -> (f64, f64) {
        let dock = self.dock_pose();
        let (dx, dy) = (pose.x - dock.x, pose.y - dock.y);
        let (sin, cos) = self.heading().sin_cos();
        (dx * cos + dy * sin, dy * cos - dx * sin)
    }

    /// Whether a robot at `pose` touches the contacts, if it did (`before`) or not.
    pub(crate) fn touched(&self, pose: Pose, before: bool) -> bool {
        let limit = if before { BREAKS } else { MAKES };
        let (ahead, aside) = self.offset(pose);
        let turned = wrap(pose.heading - self.dock_pose().heading);
        ahead <= limit.ahead && aside.abs() <= limit.aside && turned.abs() <= limit.turned
    }
}

fn beacon_range() -> f64 {
    6.0
}

fn beacon_degrees() -> f64 {
    70.0
}
