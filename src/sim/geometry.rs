//! Points, poses and the few distances that a flat world needs. Metres and radians; x to the
//! right, y up, angles left positive.

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
    pub(super) fn towards(self, other: Point, share: f64) -> Point {
        Point::new(
            self.x + (other.x - self.x) * share,
            self.y + (other.y - self.y) * share,
        )
    }
}

/// Where something stands and which way it looks.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
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
pub(super) fn wrap(angle: f64) -> f64 {
    let turned = (angle + PI).rem_euclid(TAU) - PI;
    if turned == -PI { PI } else { turned }
}

/// A straight line between two points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Segment {
    pub(super) from: Point,
    pub(super) to: Point,
}

impl Segment {
    /// Metres from a point to the nearest point of the line.
    pub(super) fn distance(self, point: Point) -> f64 {
        let (dx, dy) = (self.to.x - self.from.x, self.to.y - self.from.y);
        let length_squared = dx * dx + dy * dy;
        if length_squared == 0.0 {
            return self.from.distance(point);
        }
        let along = ((point.x - self.from.x) * dx + (point.y - self.from.y) * dy) / length_squared;
        self.from
            .towards(self.to, along.clamp(0.0, 1.0))
            .distance(point)
    }

    /// Where a ray from `origin` along (`dx`, `dy`) meets the line: the ray's parameter (in
    /// lengths of its direction) and the share 0..=1 of the line.
    pub(super) fn meets_ray(self, origin: Point, dx: f64, dy: f64) -> Option<(f64, f64)> {
        let (sx, sy) = (self.to.x - self.from.x, self.to.y - self.from.y);
        let cross = dx * sy - dy * sx;
        if cross.abs() < 1e-12 {
            return None;
        }
        let (ox, oy) = (self.from.x - origin.x, self.from.y - origin.y);
        let ray = (ox * sy - oy * sx) / cross;
        let share = (ox * dy - oy * dx) / cross;
        (ray > 0.0 && (0.0..=1.0).contains(&share)).then_some((ray, share))
    }

    /// Whether the straight way from `a` to `b` touches the line.
    pub(super) fn crosses(self, a: Point, b: Point) -> bool {
        self.meets_ray(a, b.x - a.x, b.y - a.y)
            .is_some_and(|(ray, _)| ray <= 1.0)
    }
}

/// The four sides of a rectangle that stands at `centre`, turned by `heading`, counter-clockwise.
pub(super) fn rectangle(centre: Point, length: f64, width: f64, heading: f64) -> [Segment; 4] {
    let corner = |forward: f64, left: f64| {
        centre
            .ahead(heading, forward * length / 2.0)
            .ahead(heading + PI / 2.0, left * width / 2.0)
    };
    let corners = [
        corner(1.0, -1.0),
        corner(1.0, 1.0),
        corner(-1.0, 1.0),
        corner(-1.0, -1.0),
    ];
    std::array::from_fn(|i| Segment {
        from: corners[i],
        to: corners[(i + 1) % 4],
    })
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

    #[test]
    fn a_ray_meets_only_what_is_before_it() {
        let wall = Segment {
            from: Point::new(2.0, -1.0),
            to: Point::new(2.0, 1.0),
        };
        let (ray, share) = wall.meets_ray(Point::new(0.0, 0.0), 1.0, 0.0).unwrap();
        assert!((ray - 2.0).abs() < 1e-9 && (share - 0.5).abs() < 1e-9);
        assert_eq!(wall.meets_ray(Point::new(0.0, 0.0), -1.0, 0.0), None);
        assert!(wall.crosses(Point::new(1.0, 0.0), Point::new(3.0, 0.0)));
        assert!(!wall.crosses(Point::new(0.0, 0.0), Point::new(1.0, 0.0)));
    }

    #[test]
    fn the_sides_of_a_rectangle_are_where_they_belong() {
        let sides = rectangle(Point::new(1.0, 1.0), 2.0, 1.0, 0.0);
        let near = |point| {
            sides
                .iter()
                .map(|s| s.distance(point))
                .fold(f64::MAX, f64::min)
        };
        assert!((near(Point::new(3.0, 1.0)) - 1.0).abs() < 1e-9);
        assert!((near(Point::new(1.0, 2.0)) - 0.5).abs() < 1e-9);
    }
}
