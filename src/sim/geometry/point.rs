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
    /// Creates a point from its coordinates in metres.
    pub const fn new(x: f64, y: f64) -> Point {
        Point { x, y }
    }

    /// Returns the point `distance` metres away in the direction of `angle`.
    pub fn ahead(self, angle: f64, distance: f64) -> Point {
        Point::new(
            self.x + distance * angle.cos(),
            self.y + distance * angle.sin(),
        )
    }

    /// Returns the distance to another point in metres.
    pub fn distance(self, other: Point) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }

    /// Returns the direction to another point, in radians.
    pub fn direction_of(self, other: Point) -> f64 {
        (other.y - self.y).atan2(other.x - self.x)
    }

    /// Interpolates between this point (`share` 0) and another one (1).
    pub(crate) fn towards(self, other: Point, share: f64) -> Point {
        Point::new(
            self.x + (other.x - self.x) * share,
            self.y + (other.y - self.y) * share,
        )
    }
}

/// A position and a heading.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize, serde::Deserialize)]
pub struct Pose {
    /// Metres along the room's width.
    pub x: f64,
    /// Metres along the room's depth.
    pub y: f64,
    /// Heading in radians, left positive; 0 is along x.
    pub heading: f64,
}

impl Pose {
    /// Creates a pose from coordinates in metres and a heading in radians.
    pub const fn new(x: f64, y: f64, heading: f64) -> Pose {
        Pose { x, y, heading }
    }

    /// Creates a pose at a point with a heading.
    pub fn at(point: Point, heading: f64) -> Pose {
        Pose::new(point.x, point.y, heading)
    }

    /// Returns the position without the heading.
    pub fn point(self) -> Point {
        Point::new(self.x, self.y)
    }

    /// Returns the bearing of another point relative to the heading, left positive, -pi..=pi
    /// radians.
    pub fn bearing_of(self, other: Point) -> f64 {
        wrap(self.point().direction_of(other) - self.heading)
    }
}

/// Normalizes an angle to -pi..=pi.
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
    fn angles_wrap_to_plus_minus_pi() {
        assert!((wrap(1.5 * PI) + PI / 2.0).abs() < 1e-9);
        assert_eq!(wrap(-PI), PI);
        assert!(wrap(0.5) - 0.5 < 1e-9);
    }
}
