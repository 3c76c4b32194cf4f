//! What stops the robot and what hides the station from it: the world, reduced to lines and circles.

use super::geometry::{Point, Segment};
use super::world::World;

/// Everything that a robot can run into.
#[derive(Debug, Clone)]
pub(super) struct Obstacles {
    /// Walls and furniture: high, so they also hide the station.
    high: Vec<Segment>,
    /// The station's body.
    station: [Segment; 4],
    /// Middle and radius of posts, which hide the station.
    posts: Vec<(Point, f64)>,
    /// Middle and radius of balls, which do not.
    balls: Vec<(Point, f64)>,
}

impl Obstacles {
    /// Those of a world.
    pub(super) fn of(world: &World) -> Obstacles {
        let mut high = world.room.sides().to_vec();
        high.extend(world.walls.iter().flat_map(|wall| wall.sides()));
        high.extend(world.furniture.iter().flat_map(|item| item.sides()));
        Obstacles {
            high,
            station: world.station.sides(),
            posts: world
                .posts
                .iter()
                .map(|post| (post.at.point(), post.radius))
                .collect(),
            balls: world
                .balls
                .iter()
                .map(|ball| (ball.at.point(), ball.radius))
                .collect(),
        }
    }

    /// Metres from a point to the nearest obstacle; below 0 inside a round one.
    pub(super) fn clearance(&self, point: Point) -> f64 {
        let lines = self
            .high
            .iter()
            .chain(&self.station)
            .map(|line| line.distance(point));
        let round = self.posts.iter().chain(&self.balls);
        let circles = round.map(|(middle, radius)| middle.distance(point) - radius);
        lines.chain(circles).fold(f64::MAX, f64::min)
    }

    /// Whether light gets from `a` to `b`.
    pub(super) fn sight(&self, a: Point, b: Point) -> bool {
        let way = Segment { from: a, to: b };
        !self.high.iter().any(|line| line.crosses(a, b))
            && !self
                .posts
                .iter()
                .any(|(middle, radius)| way.distance(*middle) < *radius)
    }

    /// Whether a body of `radius` gets from `a` to `b` in a straight line. A body that already
    /// stands too near to something may leave it.
    pub(super) fn way_free(&self, a: Point, b: Point, radius: f64) -> bool {
        const STRIDE: f64 = 0.06;
        // The first step must not lead nearer to what is touched, not even round its corner.
        const FIRST: f64 = 0.01;
        let length = a.distance(b);
        let enough = radius.min(self.clearance(a));
        let steps = (length / STRIDE).ceil().max(1.0);
        let strides = (1..=steps as usize).map(|i| i as f64 / steps);
        let first = (FIRST < length).then(|| FIRST / length);
        first
            .into_iter()
            .chain(strides)
            .all(|share| self.clearance(a.towards(b, share)) >= enough)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world() -> World {
        let text = "room: {width: 6, depth: 4}\nstation: {at: [0, 2], heading_degrees: 0}\n\
                    walls: [{from: [3, 0], to: [3, 2.5]}]\nballs: [{at: [2, 3.2], colour: red}]\n";
        World::from_yaml(text, "test").unwrap()
    }

    #[test]
    fn walls_hide_the_station_and_balls_do_not() {
        let obstacles = Obstacles::of(&world());
        let beacon = Point::new(0.2, 2.0);
        assert!(!obstacles.sight(beacon, Point::new(5.0, 1.0)));
        assert!(obstacles.sight(beacon, Point::new(2.0, 1.0)));
        assert!(obstacles.sight(Point::new(1.0, 3.2), Point::new(2.8, 3.2)));
    }

    #[test]
    fn a_way_needs_room_for_the_whole_body() {
        let obstacles = Obstacles::of(&world());
        let (a, b) = (Point::new(2.0, 2.8), Point::new(4.0, 2.8));
        assert!(!obstacles.way_free(a, b, 0.3));
        let (a, b) = (Point::new(2.6, 3.0), Point::new(4.0, 3.0));
        assert!(obstacles.way_free(a, b, 0.15));
    }

    #[test]
    fn clearance_counts_what_is_nearest() {
        let obstacles = Obstacles::of(&world());
        assert!((obstacles.clearance(Point::new(2.0, 3.5)) - 0.2).abs() < 1e-9);
        assert!((obstacles.clearance(Point::new(4.0, 0.3)) - 0.3).abs() < 1e-9);
    }
}
