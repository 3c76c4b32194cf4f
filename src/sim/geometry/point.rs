//! Points and poses. Metres and radians; x to the right, y up, angles left positive.

use std::f64::consts::{PI, TAU};

/// A place on the floor, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Point {
    /// Along the room's width.
    pub x: f64,
    /// Along the room's depth.
    pub y: f64,
}

impl Point {
    /// Of its coordinates in metres.
    pub const fn new(x: f64, y: f64) -> Point {
        Point { x, y }
    }

    /// The point `distance` metres further on in the direction of `angle`.
    pub fn ahead(self, angle: f64, distance: f64) -> Point {
        Point::new(
            self.x + distance * angle.cos(),
            self.y + distance * angle.sin(),
        )
    }

    /// Metres to another point.
    pub fn distance(self, other: Point) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }

    /// Direction in which another point lies, in radians.
    pub fn direction_of(self, other: Point) -> f64 {
        (other.y - self.y).atan2(other.x - self.x)
    }

    /// The point `share` of the way to another, 0 here and 1 there.
    pub(crate) fn towards(self, other: Point, share: f64) -> Point {
        Point::new(
            self.x + (other.x - self.x) * share,
            self.y + (other.y - self.y) * share,
        )
    }
}

/// Where something stands and which way it looks.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    /// Metres along the room's width.
    pub x: f64,
    /// Metres along the room's depth.
    pub y: f64,
    /// Radians, left positive, 0 looks along x.
    pub heading: f64,
}

impl Pose {
    /// Of coordinates in metres and a heading in radians.
    pub const fn new(x: f64, y: f64, heading: f64) -> Pose {
        Pose { x, y, heading }
    }

    /// At a point, looking along `heading`.
    pub fn at(point: Point, heading: f64) -> Pose {
        Pose::new(point.x, point.y, heading)
    }

    /// Its place without its heading.
    pub fn point(self) -> Point {
        Point::new(self.x, self.y)
    }

    /// How far left (positive) of the own heading another point lies, -pi..=pi radians.
    pub fn bearing_of(self, other: Point) -> f64 {
        wrap(self.point().direction_of(other) - self.heading)
    }
}

/// The same angle within -pi..=pi.
pub(crate) fn wrap(angle: f64) -> f64 {
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    if turned == -PI { PI } else { turned }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bearings_are_left_positive() {
        let pose = Pose::new(1.0, 1.0, PI / 2.0);
        assert!((pose.bearing_of(Point::new(0.0, 1.0)) - PI / 2.0).abs() < 1e-9);
        assert!((pose.bearing_of(Point::new(2.0, 1.0)) + PI / 2.0).abs() < 1e-9);
    }

    #[test]
    fn angles_wrap_to_half_turns() {
        assert!((wrap(1.5 * PI) + PI / 2.0).abs() < 1e-9);
        assert_eq!(wrap(-PI), PI);
        assert!(wrap(0.5) - 0.5 < 1e-9);
    }
}
