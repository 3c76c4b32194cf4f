//! The charging station: its place, the pose of a docked robot, and the range of its infrared
//! beacon.

use std::f64::consts::PI;

use serde::Deserialize;

use super::objects::{Spot, usual};
use crate::document::number;
use crate::geometry::obstacles::Obstacles;
use crate::geometry::{Point, Pose, RADIUS, Rectangle, wrap};

/// Depth of the station's body, from back to front, metres.
const DEPTH: f64 = 0.10;
/// Width of the station's body, metres.
const WIDTH: f64 = 0.36;
/// Height of the station's body, metres.
pub(crate) const HEIGHT: f64 = 0.34;
/// Gap between the station and a docked robot, metres.
const GAP: f64 = 0.005;
/// Length of the final, straight approach to the contacts, metres.
const STAGING: f64 = 0.55;
/// Within this distance the beacon is visible from all directions in front of the station, metres.
const GLOW: f64 = 0.8;

/// How far a robot may stand ahead of the contacts and aside of them, metres, and be turned, radians, to
/// touch them; and to keep touching them, because of their springs.
const CONTACT_CLOSES: [f64; 3] = [0.015, 0.04, 0.2];
const CONTACT_OPENS: [f64; 3] = [0.05, 0.07, 0.35];

/// The charging station: a box with a beacon and contacts at its front.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Station {
    /// The centre of its back, usually at a wall.
    pub at: Spot,
    /// The direction into the room, degrees, in which a robot leaves.
    #[serde(deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
    /// Range of the beacon, metres.
    #[serde(default = "usual::beacon_range", deserialize_with = "number::reach")]
    pub beacon_range: f64,
    /// Half the beam width of the beacon, to each side of the heading, degrees.
    #[serde(
        default = "usual::beacon_degrees",
        deserialize_with = "number::degrees"
    )]
    pub beacon_degrees: f64,
    /// How well the robot finds the contacts.
    #[serde(default)]
    pub docking: DockingSettings,
    /// How the robot drives when it leaves.
    #[serde(default)]
    pub leaves: Leaves,
}

/// How the robot drives when it leaves its station.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Leaves {
    /// On its station it faces it.
    #[default]
    Backward,
    /// On its station it has its back to it, and its receivers are at its back: it also searches
    /// and enters backwards.
    Forward,
}

impl Leaves {
    /// Returns the heading of a robot whose front or back, whichever it docks with, points in
    /// this direction; or that direction for a robot with this heading. Radians.
    pub(crate) fn turned(self, angle: f64) -> f64 {
        match self {
            Leaves::Backward => angle,
            Leaves::Forward => wrap(angle + PI),
        }
    }

    /// Returns the speed ahead, metres per second, of a robot that drives with this speed towards
    /// where it docks.
    pub(crate) fn directed(self, speed: f64) -> f64 {
        match self {
            Leaves::Backward => speed,
            Leaves::Forward => -speed,
        }
    }
}

/// How well the robot finds the contacts; by default from everywhere in the beacon's light.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DockingSettings {
    /// Distance within which the robot's receivers hear the beacon, metres.
    #[serde(deserialize_with = "number::reach")]
    pub range: f64,
    /// Share of the entries that make contact; after another one the robot backs off and tries
    /// again, until its time for docking is over.
    #[serde(deserialize_with = "number::chance")]
    pub success: f64,
    /// The robot knows where it is and drives around obstacles. Otherwise it has its receivers
    /// only, drives straight towards the beacon, comes again from nearer to the station's axis if
    /// there was no contact, and pushes against what is in its way.
    pub sees_obstacles: bool,
    /// Share of the time in which the receivers hear nothing, as in sunlight.
    #[serde(deserialize_with = "number::chance")]
    pub dazzled: f64,
}

impl Default for DockingSettings {
    fn default() -> DockingSettings {
        DockingSettings {
            range: 50.0,
            success: 1.0,
            sees_obstacles: true,
            dazzled: 0.0,
        }
    }
}

impl Station {
    /// Returns the direction into the room, radians.
    pub(crate) fn heading(&self) -> f64 {
        self.heading_degrees.to_radians()
    }

    /// Returns the pose of a robot that touches the contacts.
    pub fn dock_pose(&self) -> Pose {
        self.in_front(DEPTH + GAP + RADIUS)
    }

    /// Returns the pose at which the final, straight approach begins.
    pub fn staging_pose(&self) -> Pose {
        self.in_front(DEPTH + GAP + RADIUS + STAGING)
    }

    fn in_front(&self, distance: f64) -> Pose {
        let point = self.at.point().ahead(self.heading(), distance);
        Pose::at(point, self.leaves.turned(self.inwards()))
    }

    /// Returns the direction towards the station, in which robots enter it, radians.
    pub(crate) fn inwards(&self) -> f64 {
        wrap(self.heading() + PI)
    }

    /// Returns the corners of its body.
    pub fn outline(&self) -> [Point; 4] {
        self.footprint().corners()
    }

    /// Returns where its body stands; its front looks into the room.
    pub(crate) fn footprint(&self) -> Rectangle {
        Rectangle::new(
            self.at.point().ahead(self.heading(), DEPTH / 2.0),
            [DEPTH, WIDTH],
            self.heading(),
        )
    }

    pub(crate) fn beacon(&self) -> Point {
        self.at.point().ahead(self.heading(), DEPTH + 0.01)
    }

    /// Returns the distance up to which a robot hears the beacon, metres.
    pub(crate) fn range(&self) -> f64 {
        self.beacon_range.min(self.docking.range)
    }

    /// Returns the angle between the station's axis and the direction from its beacon to `point`,
    /// radians, left positive as seen from the station.
    pub(crate) fn off_axis(&self, point: Point) -> f64 {
        wrap(self.beacon().direction_of(point) - self.heading())
    }

    /// Whether a robot at `point` is in the beam, in range and in the line of sight of the beacon.
    pub(crate) fn beacon_reaches(&self, point: Point, obstacles: &Obstacles) -> bool {
        let beacon = self.beacon();
        let distance = beacon.distance(point);
        let off_axis = self.off_axis(point).abs();
        let in_cone = off_axis <= self.beacon_degrees.abs().to_radians();
        let near = distance <= GLOW && off_axis <= PI / 2.0;
        distance <= self.range() && (in_cone || near) && obstacles.has_line_of_sight(beacon, point)
    }

    /// Returns the robot's distance in front of the contacts along the station's axis, and its
    /// offset to the left of the axis as seen from the station, both in metres.
    pub(crate) fn offset(&self, pose: Pose) -> (f64, f64) {
        let dock = self.dock_pose();
        let dx = pose.x - dock.x;
        let dy = pose.y - dock.y;
        let (sin, cos) = self.heading().sin_cos();
        (dx * cos + dy * sin, dy * cos - dx * sin)
    }

    /// Whether a robot at `pose` touches the contacts; `before` tells whether it did so far.
    pub(crate) fn touched(&self, pose: Pose, before: bool) -> bool {
        let limits = if before {
            CONTACT_OPENS
        } else {
            CONTACT_CLOSES
        };
        let (ahead, aside) = self.offset(pose);
        let turned = wrap(pose.heading - self.dock_pose().heading);
        let off = [ahead, aside.abs(), turned.abs()];
        off.iter().zip(limits).all(|(off, limit)| *off <= limit)
    }
}
