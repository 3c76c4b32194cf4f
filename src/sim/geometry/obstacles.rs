//! Obstacles for driving and for the line of sight: a world reduced to lines and circles.
//! `World::obstacles` creates them.

use super::{Point, Segment};

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub(crate) middle: Point,
    pub(crate) radius: f64,
}

impl Circle {
    pub(crate) fn new(middle: Point, radius: f64) -> Circle {
        Circle { middle, radius }
    }

    /// Returns the distance between two circles in metres; negative if they overlap.
    pub(crate) fn gap(self, other: Circle) -> f64 {
        self.middle.distance(other.middle) - self.radius - other.radius
    }
}

/// An edge on the floor over which a robot can drive with enough power.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bump {
    pub(crate) edge: Segment,
    /// Metres.
    pub(crate) height: f64,
}

impl Bump {
    /// What no power climbs, metres. A lower edge needs power in proportion to its height.
    const UNCLIMBABLE: f64 = 0.04;

    /// Returns which share of its way a body of `radius` gets from `a` to `b` at a share of its
    /// full power.
    pub(crate) fn passed(&self, a: Point, b: Point, radius: f64, power: f64) -> f64 {
        let before = self.edge.distance(a);
        if before >= radius {
            return 1.0;
        }
        let needed = self.height / Bump::UNCLIMBABLE;
        if power < needed && self.edge.distance(b) < before {
            return 0.0;
        }
        1.0 - needed
    }
}

/// What robots can run into; each list is in the order of the world's own.
#[derive(Debug, Clone)]
pub struct Obstacles {
    /// Walls and the four sides of each piece of furniture, which are high enough to hide the
    /// station. Walls come first.
    pub(crate) high: Vec<Segment>,
    pub(crate) walls: usize,
    pub(crate) station: [Segment; 4],
    /// Posts, which hide the station.
    pub(crate) posts: Vec<Circle>,
    /// Balls, which do not hide the station, followed by people.
    pub(crate) round: Vec<Circle>,
    pub(crate) balls: usize,
}

impl Obstacles {
    pub(crate) fn without_movers(mut self) -> Obstacles {
        self.round.clear();
        self.balls = 0;
        self
    }

    /// Moves a ball or a person; the indexes of people follow those of all balls.
    pub(crate) fn move_round(&mut self, index: usize, place: Point) {
        self.round[index].middle = place;
    }

    /// Returns the distance to the nearest obstacle, metres; negative inside a round one.
    pub fn clearance(&self, point: Point) -> f64 {
        let lines = self.lines().map(|line| line.distance(point));
        let circles = self
            .circles()
            .map(|circle| circle.gap(Circle::new(point, 0.0)));
        lines.chain(circles).fold(f64::MAX, f64::min)
    }

    /// Whether the ball or person with this index has room at `wanted`.
    pub(crate) fn has_room(&self, wanted: Circle, index: usize) -> bool {
        let others = self
            .round
            .iter()
            .enumerate()
            .filter(|(other, _)| *other != index);
        let mut circles = self.posts.iter().chain(others.map(|(_, circle)| circle));
        self.lines()
            .all(|line| line.distance(wanted.middle) >= wanted.radius)
            && circles.all(|circle| circle.gap(wanted) >= 0.0)
    }

    pub(crate) fn has_line_of_sight(&self, a: Point, b: Point) -> bool {
        let way = Segment { from: a, to: b };
        let people = &self.round[self.balls..];
        !self.high.iter().any(|line| line.crosses(a, b))
            && !self
                .posts
                .iter()
                .chain(people)
                .any(|circle| way.distance(circle.middle) < circle.radius)
    }

    /// Whether a wall, which reaches up to the ceiling, is between `a` and `b`.
    pub(crate) fn is_behind_wall(&self, a: Point, b: Point) -> bool {
        self.high[..self.walls]
            .iter()
            .any(|line| line.crosses(a, b))
    }

    /// Returns where the line from `a` to `b` first meets a wall or a piece of furniture, as a
    /// share of the line.
    pub(crate) fn first_side(&self, a: Point, b: Point) -> Option<f64> {
        let sides = self.high.iter().filter_map(|line| line.met_between(a, b));
        sides.min_by(f64::total_cmp)
    }

    /// Whether a body of `radius` can move from `a` to `b` in a straight line. A body that is
    /// already too near to an obstacle may move away from it.
    pub fn is_path_free(&self, a: Point, b: Point, radius: f64) -> bool {
        // Tolerance for rounding errors in the distance at the start.
        const ROUNDING: f64 = 1e-9;
        let way = Segment { from: a, to: b };
        let here = Circle::new(a, 0.0);
        let free = |gap: f64, before: &dyn Fn() -> f64| gap >= radius || gap >= before() - ROUNDING;
        self.lines()
            .all(|line| free(line.gap(way), &|| line.distance(a)))
            && self.circles().all(|circle| {
                let gap = way.distance(circle.middle) - circle.radius;
                free(gap, &|| circle.gap(here))
            })
    }

    fn lines(&self) -> impl Iterator<Item = &Segment> {
        self.high.iter().chain(&self.station)
    }

    fn circles(&self) -> impl Iterator<Item = &Circle> {
        self.posts.iter().chain(&self.round)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::World;

    fn world() -> World {
        let text = "room: {width: 6, depth: 4}\nstation: {at: [0, 2], heading_degrees: 0}\n\
                    walls: [{from: [3, 0], to: [3, 2.5]}]\nballs: [{at: [2, 3.2], colour: red}]\n";
        World::from_yaml(text, "test").unwrap()
    }

    #[test]
    fn walls_hide_the_station_but_balls_do_not() {
        let obstacles = world().obstacles();
        let beacon = Point::new(0.2, 2.0);
        assert!(!obstacles.has_line_of_sight(beacon, Point::new(5.0, 1.0)));
        assert!(obstacles.has_line_of_sight(beacon, Point::new(2.0, 1.0)));
        assert!(obstacles.has_line_of_sight(Point::new(1.0, 3.2), Point::new(2.8, 3.2)));
    }

    #[test]
    fn a_path_needs_room_for_the_whole_body() {
        let obstacles = world().obstacles();
        let a = Point::new(2.0, 2.8);
        let b = Point::new(4.0, 2.8);
        assert!(!obstacles.is_path_free(a, b, 0.3));
        let a = Point::new(2.6, 3.0);
        let b = Point::new(4.0, 3.0);
        assert!(obstacles.is_path_free(a, b, 0.15));
    }

    #[test]
    fn clearance_is_the_distance_to_the_nearest_obstacle() {
        let obstacles = world().obstacles();
        assert!((obstacles.clearance(Point::new(2.0, 3.5)) - 0.2).abs() < 1e-9);
        assert!((obstacles.clearance(Point::new(4.0, 0.3)) - 0.3).abs() < 1e-9);
    }
}
