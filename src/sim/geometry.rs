//! Points, poses and the few distances that a flat world needs. Metres and radians; x to the
//! right, y up, angles left positive.

use std::f64::consts::{PI, TAU};

use kurbo::{Line, ParamCurveNearest, PathSeg};

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
    fn line(self) -> Line {
        Line::new((self.from.x, self.from.y), (self.to.x, self.to.y))
    }

    /// Metres from a point to the nearest point of the line.
    pub(super) fn distance(self, point: Point) -> f64 {
        self.distance_squared(point).sqrt()
    }

    /// The square of the metres from a point to the nearest point of the line.
    fn distance_squared(self, point: Point) -> f64 {
        let point = kurbo::Point::new(point.x, point.y);
        if self.from == self.to {
            return point.distance_squared(self.line().p0);
        }
        self.line().nearest(point, 0.0).distance_sq
    }

    /// Metres between the two lines; 0 if they cross.
    pub(super) fn gap(self, other: Segment) -> f64 {
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

    /// Where on the straight way from `a` to `b` the line is met, as a share of the way.
    pub(super) fn met_between(self, a: Point, b: Point) -> Option<f64> {
        let way = Segment { from: a, to: b };
        let met = PathSeg::Line(self.line()).intersect_line(way.line());
        met.first().map(|met| met.line_t)
    }

    /// Whether the straight way from `a` to `b` touches the line.
    pub(super) fn crosses(self, a: Point, b: Point) -> bool {
        self.met_between(a, b).is_some()
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

/// Whether a point is in such a rectangle.
pub(super) fn in_rectangle(
    point: Point,
    centre: Point,
    length: f64,
    width: f64,
    heading: f64,
) -> bool {
    let (dx, dy) = (point.x - centre.x, point.y - centre.y);
    let (sin, cos) = heading.sin_cos();
    let (ahead, left) = (dx * cos + dy * sin, dy * cos - dx * sin);
    ahead.abs() < length / 2.0 && left.abs() < width / 2.0
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
    fn a_way_meets_only_what_is_on_it() {
        let wall = Segment {
            from: Point::new(2.0, -1.0),
            to: Point::new(2.0, 1.0),
        };
        let (here, there) = (Point::new(0.0, 0.0), Point::new(4.0, 0.0));
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
