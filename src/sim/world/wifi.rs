//! The Wi-Fi of a world: how well the robot hears it at a place.

use serde::Deserialize;

use super::World;
use super::objects::Spot;
use crate::sim::geometry::Point;
use crate::sim::yaml::number;

/// By how much each wall between the robot and the access point shortens the range, metres.
const WALL: f64 = 3.0;
/// From this share of the range on, what is sent arrives late.
const WEAK: f64 = 0.8;

/// The access point.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wifi {
    /// Its place.
    pub at: Spot,
    /// Distance up to which it reaches the robot, metres, in a straight line without walls.
    #[serde(deserialize_with = "number::reach")]
    pub range: f64,
}

/// What the network does with what is sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Radio {
    Good,
    /// Packets are lost and repeated, which delays what is sent; 0..=1, 1 at the edge of the range.
    Weak(f64),
    OutOfRange,
}

impl World {
    /// Returns the state of the network for a robot at `place`.
    pub(crate) fn radio(&self, place: Point) -> Radio {
        let Some(wifi) = self.wifi else {
            return Radio::Good;
        };
        let from = wifi.at.point();
        let walls = self.walls.iter();
        let walls = walls
            .filter(|wall| wall.stands_between(from, place))
            .count();
        let distance = from.distance(place) + WALL * walls as f64;
        if distance > wifi.range {
            Radio::OutOfRange
        } else if distance > WEAK * wifi.range {
            Radio::Weak((distance / wifi.range - WEAK) / (1.0 - WEAK))
        } else {
            Radio::Good
        }
    }
}
