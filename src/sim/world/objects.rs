//! The things in a world as defined in YAML, with their shapes.

use serde::Deserialize;

use super::paint::Paint;
use super::route::Route;
use super::spot::Spot;
use crate::sim::geometry::{Point, Segment, in_rectangle, rectangle};
use crate::sim::yaml::number;

/// The outer walls, from (0, 0) to (`width`, `depth`), and the floor between them.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Room {
    /// Size along x, metres.
    #[serde(deserialize_with = "number::room_side")]
    pub width: f64,
    /// Size along y, metres.
    #[serde(deserialize_with = "number::room_side")]
    pub depth: f64,
    /// Height of all walls, metres.
    #[serde(default = "room_height", deserialize_with = "number::height")]
    pub height: f64,
    /// Kind of floor.
    #[serde(default)]
    pub floor: Floor,
    /// Colour of the walls.
    #[serde(default = "wall_paint")]
    pub walls: Paint,
}

/// Kinds of floors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Floor {
    /// Planks.
    #[default]
    Wood,
    /// Light and dark squares.
    Tiles,
    /// A uniform colour with a fine grain.
    Concrete,
}

/// An inner wall.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Start of its centre line.
    pub from: Spot,
    /// End of its centre line.
    pub to: Spot,
    /// Thickness in metres.
    #[serde(default = "wall_thickness", deserialize_with = "number::thickness")]
    pub thickness: f64,
}

/// A box that stands on the floor.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Furniture {
    /// Its centre.
    pub at: Spot,
    /// Size along its heading, metres.
    #[serde(deserialize_with = "number::side")]
    pub length: f64,
    /// Size across its heading, metres.
    #[serde(deserialize_with = "number::side")]
    pub width: f64,
    /// Height in metres; higher than the camera.
    #[serde(deserialize_with = "number::height")]
    pub height: f64,
    /// Its heading, degrees.
    #[serde(default, deserialize_with = "number::degrees")]
    pub heading_degrees: f64,
    /// Its colour.
    pub colour: Paint,
    /// Its name.
    #[serde(default)]
    pub name: String,
}

/// A carpet.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rug {
    /// Its centre.
    pub at: Spot,
    /// Size along x, metres.
    #[serde(deserialize_with = "number::side")]
    pub width: f64,
    /// Size along y, metres.
    #[serde(deserialize_with = "number::side")]
    pub depth: f64,
    /// Its colour.
    pub colour: Paint,
}

/// A ball on the floor.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Ball {
    /// The place where it touches the floor.
    pub at: Spot,
    /// Radius in metres.
    #[serde(default = "ball_radius", deserialize_with = "number::radius")]
    pub radius: f64,
    /// Its colour.
    pub colour: Paint,
    /// The route along which it rolls.
    #[serde(default)]
    pub path: Option<Route>,
}

/// A round post.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Post {
    /// Its centre.
    pub at: Spot,
    /// Radius in metres.
    #[serde(default = "post_radius", deserialize_with = "number::radius")]
    pub radius: f64,
    /// Height in metres.
    #[serde(default = "post_height", deserialize_with = "number::height")]
    pub height: f64,
    /// Its colour.
    pub colour: Paint,
}

impl Room {
    /// Returns the four outer walls, counter-clockwise.
    pub(crate) fn sides(&self) -> [Segment; 4] {
        let middle = Point::new(self.width / 2.0, self.depth / 2.0);
        rectangle(middle, self.width, self.depth, 0.0)
    }

    /// Whether a place is within the outer walls.
    pub(crate) fn holds(&self, point: Point) -> bool {
        (0.0..=self.width).contains(&point.x) && (0.0..=self.depth).contains(&point.y)
    }
}

impl Wall {
    /// Whether a place is inside the wall.
    pub(crate) fn covers(&self, place: Point) -> bool {
        let from = self.from.point();
        let to = self.to.point();
        let length = from.distance(to) + self.thickness;
        let middle = from.towards(to, 0.5);
        let heading = from.direction_of(to);
        in_rectangle(place, middle, length, self.thickness, heading)
    }

    /// Returns its four sides as seen from above.
    pub(crate) fn sides(&self) -> [Segment; 4] {
        let from = self.from.point();
        let to = self.to.point();
        let length = from.distance(to) + self.thickness;
        rectangle(
            from.towards(to, 0.5),
            length,
            self.thickness,
            from.direction_of(to),
        )
    }
}

impl Furniture {
    /// Whether a place is inside the piece of furniture.
    pub(crate) fn covers(&self, place: Point) -> bool {
        let middle = self.at.point();
        let heading = self.heading_degrees.to_radians();
        in_rectangle(place, middle, self.length, self.width, heading)
    }

    /// Returns its four sides as seen from above.
    pub(crate) fn sides(&self) -> [Segment; 4] {
        rectangle(
            self.at.point(),
            self.length,
            self.width,
            self.heading_degrees.to_radians(),
        )
    }
}

fn room_height() -> f64 {
    2.4
}

fn wall_paint() -> Paint {
    Paint([214, 206, 190])
}

fn wall_thickness() -> f64 {
    0.1
}

fn ball_radius() -> f64 {
    0.1
}

fn post_radius() -> f64 {
    0.05
}

fn post_height() -> f64 {
    0.6
}
