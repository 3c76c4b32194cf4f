//! Points, poses and lines on the floor, and the robot's dimensions. Metres and radians; x to the
//! right, y up, angles left positive.

pub(crate) mod obstacles;

use std::f64::consts::{PI, TAU};

use kurbo::{Line, ParamCurveNearest, PathSeg};

/// Radius of the robot's body, a circle seen from above, metres.
pub const RADIUS: f64 = 0.15;
/// Distance between the centre lines of the tracks, metres.
pub const TRACK_WIDTH: f64 = 0.24;

/// A place on the floor, metres from the room's bottom left corner.
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

/// Where something stands, and where it looks.
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

    /// Creates a pose at a point, with a heading in radians.
    pub fn at(point: Point, heading: f64) -> Pose {
        Pose::new(point.x, point.y, heading)
    }

    /// Returns its place.
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

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Segment {
    pub(crate) from: Point,
    pub(crate) to: Point,
}

impl Segment {
    fn line(self) -> Line {
        Line::new((self.from.x, self.from.y), (self.to.x, self.to.y))
    }

    /// Returns the distance in metres from a point to the nearest point of the line.
    pub(crate) fn distance(self, point: Point) -> f64 {
        self.distance_squared(point).sqrt()
    }

    /// Returns the squared distance from a point to the nearest point of the line.
    fn distance_squared(self, point: Point) -> f64 {
        let point = kurbo::Point::new(point.x, point.y);
        if self.from == self.to {
            return point.distance_squared(self.line().p0);
        }
        self.line().nearest(point, 0.0).distance_sq
    }

    /// Returns the distance in metres between the two lines; 0 if they cross.
    pub(crate) fn gap(self, other: Segment) -> f64 {
        if self.crosses(other.from, other.to) {
            return 0.0;
        }
        let ends = [
            self.distance_squared(other.from),
            self.distance_squared(other.to),
            other.distance_squared(self.from),
            other.distance_squared(self.to),
        ];
        ends.into_iter().fold(f64::MAX, f64::min).sqrt()
    }

    /// Returns where the straight path from `a` to `b` meets the line, as a share of the path.
    pub(crate) fn met_between(self, a: Point, b: Point) -> Option<f64> {
        let way = Segment { from: a, to: b };
        let met = PathSeg::Line(self.line()).intersect_line(way.line());
        met.first().map(|met| met.line_t)
    }

    /// Whether the straight path from `a` to `b` touches the line.
    pub(crate) fn crosses(self, a: Point, b: Point) -> bool {
        self.met_between(a, b).is_some()
    }
}

/// A rectangle on the floor: `length` along its heading, `width` across it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rectangle {
    pub(crate) centre: Point,
    pub(crate) length: f64,
    pub(crate) width: f64,
    /// Radians.
    pub(crate) heading: f64,
}

impl Rectangle {
    pub(crate) fn new(centre: Point, [length, width]: [f64; 2], heading: f64) -> Rectangle {
        Rectangle {
            centre,
            length,
            width,
            heading,
        }
    }

    /// Returns the corners, counter-clockwise, the first one ahead on the right.
    pub(crate) fn corners(self) -> [Point; 4] {
        [(1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(forward, left)| {
            self.centre
                .ahead(self.heading, forward * self.length / 2.0)
                .ahead(self.heading + PI / 2.0, left * self.width / 2.0)
        })
    }

    /// Returns the four sides, counter-clockwise; the first one is the front.
    pub(crate) fn sides(self) -> [Segment; 4] {
        let corners = self.corners();
        std::array::from_fn(|i| Segment {
            from: corners[i],
            to: corners[(i + 1) % 4],
        })
    }

    pub(crate) fn covers(self, point: Point) -> bool {
        let dx = point.x - self.centre.x;
        let dy = point.y - self.centre.y;
        let (sin, cos) = self.heading.sin_cos();
        let ahead = dx * cos + dy * sin;
        let left = dy * cos - dx * sin;
        ahead.abs() < self.length / 2.0 && left.abs() < self.width / 2.0
    }
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

    #[test]
    fn a_path_meets_only_lines_on_it() {
        let wall = Segment {
            from: Point::new(2.0, -1.0),
            to: Point::new(2.0, 1.0),
        };
        let here = Point::new(0.0, 0.0);
        let there = Point::new(4.0, 0.0);
        assert!((wall.met_between(here, there).unwrap() - 0.5).abs() < 1e-9);
        assert_eq!(wall.met_between(here, Point::new(-4.0, 0.0)), None);
        assert!(wall.crosses(Point::new(1.0, 0.0), Point::new(3.0, 0.0)));
        assert!(!wall.crosses(Point::new(0.0, 0.0), Point::new(1.0, 0.0)));
    }

    #[test]
    fn the_gap_between_two_lines_is_that_of_their_nearest_points() {
        let line = |from: (f64, f64), to: (f64, f64)| Segment {
            from: Point::new(from.0, from.1),
            to: Point::new(to.0, to.1),
        };
        let wall = line((2.0, -1.0), (2.0, 1.0));
        assert!((wall.gap(line((0.0, 0.0), (1.5, 0.5))) - 0.5).abs() < 1e-9);
        assert!((line((0.0, 1.25), (4.0, 1.25)).gap(wall) - 0.25).abs() < 1e-9);
        assert_eq!(wall.gap(line((0.0, 0.0), (4.0, 0.0))), 0.0);
        let point = line((1.0, 0.0), (1.0, 0.0));
        assert!((wall.gap(point) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_sides_of_a_rectangle_have_the_right_places() {
        let rectangle = Rectangle {
            centre: Point::new(1.0, 1.0),
            length: 2.0,
            width: 1.0,
            heading: 0.0,
        };
        let sides = rectangle.sides();
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
