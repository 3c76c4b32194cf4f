//! Moving things of a world besides the robot: balls, which roll along their paths or when pushed,
//! and people on their paths.

use super::document::World;
use super::route::Trip;
use crate::sim::geometry::Point;
use crate::sim::geometry::obstacles::{Circle, Obstacles};

/// Deceleration of a rolling ball, metres per second squared.
const FRICTION: f64 = 0.35;
/// Distance that people and rolling balls keep from the robot, metres.
const ROBOT_CLEARANCE: f64 = 0.05;
/// Minimum gap between touching things, metres.
const MIN_GAP: f64 = 0.001;

/// Everything that moves.
#[derive(Debug, Clone)]
pub(crate) struct Dynamics {
    /// Balls first, then people, as in [`Obstacles`].
    all: Vec<MovingObject>,
}

#[derive(Debug, Clone)]
struct MovingObject {
    body: Circle,
    ball: bool,
    trip: Option<Trip>,
    /// Velocity of a pushed ball, metres per second.
    rolling: Point,
}

impl Dynamics {
    /// Creates the moving objects of a world, at their initial places.
    pub(crate) fn new(world: &World) -> Dynamics {
        let balls = world.balls.iter().map(|ball| MovingObject {
            body: Circle::new(ball.at.point(), ball.radius),
            ball: true,
            trip: ball.path.as_ref().map(Trip::new),
            rolling: Point::default(),
        });
        let people = world.walkers.iter().map(|walker| MovingObject {
            body: Circle::new(walker.at.point(), walker.radius),
            ball: false,
            trip: walker.path.as_ref().map(Trip::new),
            rolling: Point::default(),
        });
        Dynamics {
            all: balls.chain(people).collect(),
        }
    }

    /// Returns the current places, balls first.
    pub(crate) fn places(&self) -> impl Iterator<Item = Point> {
        self.all.iter().map(|mover| mover.body.middle)
    }

    /// Puts a ball at a place, at rest; a ball on a path leaves it permanently.
    pub(crate) fn put_ball(&mut self, index: usize, place: Point) {
        let balls = self.all.iter_mut().filter(|mover| mover.ball);
        if let Some(ball) = balls.skip(index).take(1).next() {
            (ball.body.middle, ball.rolling) = (place, Point::default());
            ball.trip = None;
        }
    }

    /// Advances by some seconds; nothing moves into the robot.
    pub(crate) fn step(&mut self, seconds: f64, robot: Circle, obstacles: &mut Obstacles) {
        for index in 0..self.all.len() {
            let mover = &mut self.all[index];
            let here = mover.body.middle;
            let next = mover.next(seconds);
            if next == here {
                continue;
            }
            let wanted = Circle::new(next, mover.body.radius);
            let nearer = robot.gap(wanted) < robot.gap(mover.body);
            let in_the_way = nearer && robot.gap(wanted) < ROBOT_CLEARANCE;
            // A rolling ball stops at an obstacle; a mover on a path passes through it.
            let hits = mover.rolling != Point::default() && !obstacles.has_room(wanted, index);
            if in_the_way || hits {
                mover.rolling = Point::default();
                continue;
            }
            mover.body = wanted;
            obstacles.move_round(index, next);
        }
    }

    /// Pushes balls out of the way of a robot that moves to `robot` at this speed; balls without
    /// room stay.
    pub(crate) fn push_balls(&mut self, robot: Circle, speed: f64, obstacles: &mut Obstacles) {
        for index in 0..self.all.len() {
            let mover = &mut self.all[index];
            if !mover.ball || robot.gap(mover.body) >= MIN_GAP {
                continue;
            }
            let away = robot.middle.direction_of(mover.body.middle);
            let place = robot
                .middle
                .ahead(away, robot.radius + mover.body.radius + 2.0 * MIN_GAP);
            let wanted = Circle::new(place, mover.body.radius);
            if obstacles.has_room(wanted, index) {
                mover.body = wanted;
                mover.rolling = Point::default().ahead(away, speed.abs());
                obstacles.move_round(index, place);
            }
        }
    }
}

impl MovingObject {
    /// Returns the mover's place after so many seconds.
    fn next(&mut self, seconds: f64) -> Point {
        let here = self.body.middle;
        let speed = self.rolling.distance(Point::default());
        if speed > 0.0 {
            let slower = (speed - FRICTION * seconds).max(0.0);
            self.rolling = Point::default().towards(self.rolling, slower / speed);
            return Point::new(
                here.x + self.rolling.x * seconds,
                here.y + self.rolling.y * seconds,
            );
        }
        let trip = self.trip.as_mut();
        trip.map_or(here, |trip| trip.step(here, seconds))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn world(things: &str) -> World {
        let text = format!(
            "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0}}\n{things}\n"
        );
        World::from_yaml(&text, "test").unwrap()
    }

    fn after(things: &str, robot: (f64, f64), seconds: u32) -> Point {
        let world = world(things);
        let mut dynamics = Dynamics::new(&world);
        let mut obstacles = world.obstacles();
        let robot = Circle::new(Point::new(robot.0, robot.1), 0.15);
        (0..seconds * 50).for_each(|_| dynamics.step(0.02, robot, &mut obstacles));
        dynamics.places().next().unwrap()
    }

    const WALKER: &str = "walkers: [{at: [1, 3], path: {through: [[1, 3], [5, 3]], speed: 0.5}}]";

    #[test]
    fn people_walk_and_wait_for_a_robot_in_their_way() {
        let place = after(WALKER, (3.0, 1.0), 4);
        assert!(
            (place.x - 3.0).abs() < 0.1 && (place.y - 3.0).abs() < 1e-9,
            "{place:?}"
        );
        let place = after(WALKER, (3.0, 3.0), 20);
        assert!((2.5..2.65).contains(&place.x), "{place:?}");
    }

    #[test]
    fn a_placed_ball_leaves_its_path_and_stays() {
        let ball =
            "balls: [{at: [1, 3], colour: red, path: {through: [[1, 3], [5, 3]], speed: 0.5}}]";
        let world = world(ball);
        let mut dynamics = Dynamics::new(&world);
        let mut obstacles = world.obstacles();
        let robot = Circle::new(Point::new(3.0, 1.0), 0.15);
        let place = Point::new(2.0, 2.0);
        dynamics.put_ball(0, place);
        (0..200).for_each(|_| dynamics.step(0.02, robot, &mut obstacles));
        assert_eq!(dynamics.places().next(), Some(place));
    }

    #[test]
    fn a_pushed_ball_rolls_on_and_comes_to_rest() {
        let world = world("balls: [{at: [3, 2], colour: red}]");
        let mut dynamics = Dynamics::new(&world);
        let mut obstacles = world.obstacles();
        let robot = Circle::new(Point::new(2.76, 2.0), 0.15);
        dynamics.push_balls(robot, 0.4, &mut obstacles);
        for _ in 0..200 {
            dynamics.step(0.02, robot, &mut obstacles);
        }
        let place = dynamics.places().next().unwrap();
        assert!((3.15..3.4).contains(&place.x), "{place:?}");
        assert!((obstacles.clearance(Point::new(place.x, 2.5)) - 0.4).abs() < 1e-6);
    }

    #[test]
    fn a_ball_at_the_wall_is_not_pushed() {
        let world = world("balls: [{at: [5.9, 2], colour: red}]");
        let mut dynamics = Dynamics::new(&world);
        let mut obstacles = world.obstacles();
        let robot = Circle::new(Point::new(5.7, 2.0), 0.15);
        dynamics.push_balls(robot, 0.4, &mut obstacles);
        assert_eq!(dynamics.places().next(), Some(Point::new(5.9, 2.0)));
    }
}
