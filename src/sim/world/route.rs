//! Routes of balls and people: from corner to corner at a constant speed.

use serde::Deserialize;

use super::paint::Paint;
use super::spot::Spot;
use crate::sim::geometry::Point;
use crate::sim::yaml::number;

/// A route through the room.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Route {
    /// Its corners, in order.
    pub through: Vec<Spot>,
    /// Speed, metres per second.
    #[serde(deserialize_with = "number::speed")]
    pub speed: f64,
    /// Pause at each corner, seconds.
    #[serde(default, deserialize_with = "number::span")]
    pub pause: f64,
    /// Whether to continue from the last corner to the first; otherwise the route is reversed.
    #[serde(default)]
    pub closed: bool,
}

/// A person who stands or walks: a visible obstacle.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walker {
    /// Their name.
    #[serde(default)]
    pub name: String,
    /// Their place without a `path`, or their start with one.
    pub at: Spot,
    /// Radius in metres.
    #[serde(default = "walker_radius", deserialize_with = "number::radius")]
    pub radius: f64,
    /// Height in metres.
    #[serde(default = "walker_height", deserialize_with = "number::height")]
    pub height: f64,
    /// Colour of the clothes.
    #[serde(default = "clothes")]
    pub colour: Paint,
    /// Their route.
    #[serde(default)]
    pub path: Option<Route>,
}

/// Progress along a route.
#[derive(Debug, Clone)]
pub(crate) struct Trip {
    corners: Vec<Point>,
    speed: f64,
    pause: f64,
    closed: bool,
    next: usize,
    back: bool,
    rested: f64,
}

impl Trip {
    /// Creates a trip that starts towards the first corner.
    pub(crate) fn new(route: &Route) -> Trip {
        Trip {
            corners: route.through.iter().map(|spot| spot.point()).collect(),
            speed: route.speed,
            pause: route.pause,
            closed: route.closed,
            next: 0,
            back: false,
            rested: 0.0,
        }
    }

    /// Returns the place, after so many seconds, of something that is at `here`.
    pub(crate) fn step(&mut self, here: Point, seconds: f64) -> Point {
        let Some(&target) = self.corners.get(self.next) else {
            return here;
        };
        let left = here.distance(target);
        let stride = self.speed * seconds;
        if left > stride {
            return here.towards(target, stride / left);
        }
        self.rested += seconds;
        if self.rested >= self.pause {
            self.rested = 0.0;
            self.turn();
        }
        target
    }

    fn turn(&mut self) {
        let last = self.corners.len() - 1;
        match (self.next, self.back) {
            _ if last == 0 => {}
            (next, _) if self.closed => self.next = (next + 1) % (last + 1),
            (0, true) => (self.next, self.back) = (1, false),
            (next, true) => self.next = next - 1,
            (next, false) if next == last => (self.next, self.back) = (last - 1, true),
            (next, false) => self.next = next + 1,
        }
    }
}

fn walker_radius() -> f64 {
    0.2
}

fn walker_height() -> f64 {
    1.7
}

fn clothes() -> Paint {
    Paint([92, 96, 112])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn visited(closed: bool) -> Vec<(i32, i32)> {
        let yaml = format!("{{through: [[1, 1], [2, 1], [2, 2]], speed: 1, closed: {closed}}}");
        let mut trip = Trip::new(&serde_yaml::from_str(&yaml).unwrap());
        let mut here = Point::new(1.0, 1.0);
        let mut seen = Vec::new();
        for _ in 0..110 {
            here = trip.step(here, 0.05);
            let corner = (here.x * 10.0).round() as i32 % 10 == 0
                && (here.y * 10.0).round() as i32 % 10 == 0;
            let at = (here.x.round() as i32, here.y.round() as i32);
            if corner && seen.last() != Some(&at) {
                seen.push(at);
            }
        }
        seen
    }

    #[test]
    fn a_route_goes_back_and_forth_or_around() {
        assert_eq!(
            visited(false),
            [(1, 1), (2, 1), (2, 2), (2, 1), (1, 1), (2, 1)]
        );
        assert_eq!(
            visited(true),
            [(1, 1), (2, 1), (2, 2), (1, 1), (2, 1), (2, 2)]
        );
    }

    #[test]
    fn a_route_with_one_corner_ends_there() {
        let mut trip = Trip::new(&serde_yaml::from_str("{through: [[1, 1]], speed: 1}").unwrap());
        let mut here = Point::new(1.5, 1.0);
        (0..100).for_each(|_| here = trip.step(here, 0.05));
        assert_eq!(here, Point::new(1.0, 1.0));
    }
}
