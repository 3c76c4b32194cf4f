//! The current state of a world: balls, which roll along their paths or when pushed, and people on
//! their paths.

use super::World;
use super::objects::Route;
use crate::sim::geometry::obstacles::{Bump, Circle, Obstacles};
use crate::sim::geometry::{Point, Pose, RADIUS};

pub(crate) struct Environment {
    /// The world in its initial state.
    pub(crate) world: World,
    pub(crate) obstacles: Obstacles,
    pub(crate) bumps: Vec<Bump>,
    dynamics: Dynamics,
}

impl Environment {
    pub(crate) fn new(world: World) -> Environment {
        Environment {
            obstacles: world.obstacles(),
            bumps: world.bumps(),
            dynamics: Dynamics::new(&world),
            world,
        }
    }

    /// Returns the places of balls and people, balls first.
    pub(crate) fn places(&self) -> impl Iterator<Item = Point> {
        self.dynamics.places()
    }

    /// Puts a ball at a place, at rest; `index` is its index in the world's list.
    pub(crate) fn put_ball(&mut self, index: usize, place: Point) {
        if index < self.world.balls.len() && place.x.is_finite() && place.y.is_finite() {
            self.dynamics.put_ball(index, place);
            self.obstacles.move_round(index, place);
        }
    }

    /// Advances everything that moves besides the robot, and pushes balls out of the way of a robot
    /// that drives at this speed, metres per second.
    pub(crate) fn step(&mut self, seconds: f64, robot: Pose, speed: f64) {
        let here = Circle::new(robot.point(), RADIUS);
        self.dynamics.step(seconds, here, &mut self.obstacles);
        if speed != 0.0 {
            // Looks a little farther than the robot gets in this step, so that a ball rolls away
            // before it can block the robot.
            let next = here.middle.ahead(robot.heading, 1.5 * speed * seconds);
            let robot = Circle::new(next, RADIUS);
            self.dynamics.push_balls(robot, speed, &mut self.obstacles);
        }
    }

    pub(crate) fn name_at(&self, point: Point) -> String {
        self.world.name_of(self.obstacles.nearest(point))
    }
}

/// Deceleration of a rolling ball, metres per second squared.
const FRICTION: f64 = 0.35;
/// Distance that people and rolling balls keep from the robot, metres.
const ROBOT_CLEARANCE: f64 = 0.05;
/// Minimum gap between touching things, metres.
const MIN_GAP: f64 = 0.001;

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
    pub(crate) fn new(world: &World) -> Dynamics {
        let balls = world.balls.iter();
        let balls = balls
            .map(|ball| MovingObject::new(ball.at.point(), ball.radius, true, ball.path.as_ref()));
        let people = world.walkers.iter();
        let people = people
            .map(|who| MovingObject::new(who.at.point(), who.radius, false, who.path.as_ref()));
        Dynamics {
            all: balls.chain(people).collect(),
        }
    }

    pub(crate) fn places(&self) -> impl Iterator<Item = Point> {
        self.all.iter().map(|mover| mover.body.middle)
    }

    /// Puts a ball at a place, at rest; a ball on a path leaves it permanently.
    pub(crate) fn put_ball(&mut self, index: usize, place: Point) {
        let mut balls = self.all.iter_mut().filter(|mover| mover.ball);
        if let Some(ball) = balls.nth(index) {
            ball.body.middle = place;
            ball.rolling = Point::default();
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
    fn new(place: Point, radius: f64, ball: bool, path: Option<&Route>) -> MovingObject {
        MovingObject {
            body: Circle::new(place, radius),
            ball,
            trip: path.map(Trip::new),
            rolling: Point::default(),
        }
    }

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
        match &mut self.trip {
            Some(trip) => trip.step(here, seconds),
            None => here,
        }
    }
}

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
        if last == 0 {
            return;
        }
        if self.closed {
            self.next = (self.next + 1) % (last + 1);
            return;
        }
        if self.next == 0 || self.next == last {
            self.back = self.next == last;
        }
        self.next = if self.back {
            self.next - 1
        } else {
            self.next + 1
        };
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
