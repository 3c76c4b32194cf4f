//! The current state of a world: balls, which roll along their paths or when pushed, and people on
//! their paths.

use super::objects::{Route, Spot};
use super::{World, name_or};
use crate::geometry::obstacles::{Bump, Circle, Obstacles};
use crate::geometry::{Point, Pose, RADIUS};

/// Deceleration of a rolling ball, metres per second squared.
const FRICTION: f64 = 0.35;
/// Distance that people and rolling balls keep from the robot, metres.
const ROBOT_CLEARANCE: f64 = 0.05;
/// How long people and balls on a path wait for a robot in the way before they turn back, seconds: an
/// assumption.
const PATIENCE: f64 = 3.0;
/// Minimum gap between touching things, metres.
const MIN_GAP: f64 = 0.001;

pub(crate) struct Environment {
    /// The world in its initial state.
    pub(crate) world: World,
    pub(crate) obstacles: Obstacles,
    pub(crate) bumps: Vec<Bump>,
    /// Balls first, then people, as in [`Obstacles`].
    movers: Vec<MovingObject>,
}

struct MovingObject {
    body: Circle,
    trip: Option<Trip>,
    /// Velocity of a pushed ball, metres per second.
    rolling: Point,
}

impl Environment {
    pub(crate) fn new(world: World) -> Environment {
        let balls = world.balls.iter();
        let balls = balls.map(|ball| MovingObject::new(ball.at, ball.radius, ball.path.as_ref()));
        let people = world.walkers.iter();
        let people = people.map(|who| MovingObject::new(who.at, who.radius, who.path.as_ref()));
        Environment {
            obstacles: world.obstacles(),
            bumps: world.bumps(),
            movers: balls.chain(people).collect(),
            world,
        }
    }

    /// Returns the places of balls and people, balls first.
    pub(crate) fn places(&self) -> impl Iterator<Item = Point> {
        self.movers.iter().map(|mover| mover.body.middle)
    }

    /// Puts a ball at a place, at rest; a ball on a path leaves it permanently. `index` is its index
    /// in the world's list.
    pub(crate) fn put_ball(&mut self, index: usize, place: Point) {
        if index < self.world.balls.len() && place.x.is_finite() && place.y.is_finite() {
            let ball = &mut self.movers[index];
            ball.body.middle = place;
            ball.rolling = Point::default();
            ball.trip = None;
            self.obstacles.move_round(index, place);
        }
    }

    /// Advances everything that moves besides the robot, and pushes balls out of the way of a robot
    /// that drives at this speed, metres per second.
    pub(crate) fn step(&mut self, seconds: f64, robot: Pose, speed: f64) {
        let here = Circle::new(robot.point(), RADIUS);
        self.move_things(seconds, here);
        if speed != 0.0 {
            // Looks a little farther than the robot gets in this step, so that a ball rolls away
            // before it can block the robot.
            let next = here.middle.ahead(robot.heading, 1.5 * speed * seconds);
            self.push_balls(Circle::new(next, RADIUS), speed);
        }
    }

    /// Returns the name of the thing that is nearest to a place.
    pub(crate) fn name_at(&self, place: Point) -> String {
        let Environment {
            world, obstacles, ..
        } = self;
        let here = Circle::new(place, 0.0);
        let lines = obstacles.high.iter().enumerate().map(|(index, line)| {
            let name = match index.checked_sub(obstacles.walls) {
                Some(side) => name_or(&world.furniture[side / 4].name, "furniture"),
                None => "wall",
            };
            (line.distance(place), name)
        });
        let station = obstacles.station.iter();
        let station = station.map(|line| (line.distance(place), "station"));
        let posts = obstacles.posts.iter().map(|post| (post.gap(here), "post"));
        let round = obstacles.round.iter().enumerate().map(|(index, circle)| {
            let name = match index.checked_sub(obstacles.balls) {
                Some(walker) => name_or(&world.walkers[walker].name, "walker"),
                None => "ball",
            };
            (circle.gap(here), name)
        });
        let all = lines.chain(station).chain(posts).chain(round);
        let nearest = all.min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map_or("wall", |(_, name)| name).to_owned()
    }

    /// Moves balls and people for some seconds; nothing moves into the robot.
    fn move_things(&mut self, seconds: f64, robot: Circle) {
        for (index, mover) in self.movers.iter_mut().enumerate() {
            let here = mover.body.middle;
            let next = mover.next(seconds);
            if next == here {
                continue;
            }
            let wanted = Circle::new(next, mover.body.radius);
            let nearer = robot.gap(wanted) < robot.gap(mover.body);
            let in_the_way = nearer && robot.gap(wanted) < ROBOT_CLEARANCE;
            // A rolling ball stops at an obstacle; a mover on a path passes through it.
            let is_rolling = mover.rolling != Point::default();
            if in_the_way || (is_rolling && !self.obstacles.has_room(wanted, index)) {
                mover.rolling = Point::default();
                if let Some(trip) = &mut mover.trip {
                    trip.wait(seconds);
                }
                continue;
            }
            mover.body = wanted;
            if let Some(trip) = &mut mover.trip {
                trip.waited = 0.0;
            }
            self.obstacles.move_round(index, next);
        }
    }

    /// Pushes balls out of the way of a robot that moves to `robot` at this speed; balls without
    /// room stay.
    fn push_balls(&mut self, robot: Circle, speed: f64) {
        let balls = self.world.balls.len();
        for (index, ball) in self.movers.iter_mut().take(balls).enumerate() {
            if robot.gap(ball.body) >= MIN_GAP {
                continue;
            }
            let away = robot.middle.direction_of(ball.body.middle);
            let distance = robot.radius + ball.body.radius + 2.0 * MIN_GAP;
            let place = robot.middle.ahead(away, distance);
            let wanted = Circle::new(place, ball.body.radius);
            if self.obstacles.has_room(wanted, index) {
                ball.body = wanted;
                ball.rolling = Point::default().ahead(away, speed.abs());
                self.obstacles.move_round(index, place);
            }
        }
    }
}

impl MovingObject {
    fn new(place: Spot, radius: f64, path: Option<&Route>) -> MovingObject {
        MovingObject {
            body: Circle::new(place.point(), radius),
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

struct Trip {
    route: Route,
    next: usize,
    back: bool,
    rested: f64,
    /// Seconds without a way on.
    waited: f64,
}

impl Trip {
    /// Creates a trip that starts towards the first corner.
    fn new(route: &Route) -> Trip {
        Trip {
            route: route.clone(),
            next: 0,
            back: false,
            rested: 0.0,
            waited: 0.0,
        }
    }

    /// Returns the place, after so many seconds, of something that is at `here`.
    fn step(&mut self, here: Point, seconds: f64) -> Point {
        let Some(corner) = self.route.through.get(self.next) else {
            return here;
        };
        let target = corner.point();
        let left = here.distance(target);
        let stride = self.route.speed * seconds;
        if left > stride {
            return here.towards(target, stride / left);
        }
        self.rested += seconds;
        if self.rested >= self.route.pause {
            self.rested = 0.0;
            self.turn();
        }
        target
    }

    /// Waits for something in its way, and at last goes back to the corner it came from.
    fn wait(&mut self, seconds: f64) {
        self.waited += seconds;
        if self.waited >= PATIENCE {
            self.waited = 0.0;
            self.back = !self.back;
            self.turn();
        }
    }

    fn turn(&mut self) {
        let last = self.route.through.len() - 1;
        if last == 0 {
            return;
        }
        if self.route.closed {
            let step = if self.back { last } else { 1 };
            self.next = (self.next + step) % (last + 1);
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
        let mut environment = Environment::new(world(things));
        let robot = Circle::new(Point::new(robot.0, robot.1), 0.15);
        (0..seconds * 50).for_each(|_| environment.move_things(0.02, robot));
        environment.places().next().unwrap()
    }

    const WALKER: &str = "walkers: [{at: [1, 3], path: {through: [[1, 3], [5, 3]], speed: 0.5}}]";

    #[test]
    fn people_walk_and_wait_a_moment_for_a_robot_in_their_way_then_turn_back() {
        let place = after(WALKER, (3.0, 1.0), 4);
        assert!(
            (place.x - 3.0).abs() < 0.1 && (place.y - 3.0).abs() < 1e-9,
            "{place:?}"
        );
        // After 2 m at 0.5 m/s, less the robot's radius, theirs and the distance that they keep.
        let waits = after(WALKER, (3.0, 3.0), 5);
        assert!((2.5..2.65).contains(&waits.x), "{waits:?}");
        let turned_back = after(WALKER, (3.0, 3.0), 8);
        assert!((1.5..2.4).contains(&turned_back.x), "{turned_back:?}");
    }

    #[test]
    fn the_nearest_thing_has_its_name_or_its_kind() {
        let things = "balls: [{at: [2, 3.2], colour: red}]\nwalkers: [{at: [4, 2], name: Anna}]\n\
                      furniture: [{at: [5, 3], length: 0.5, width: 0.5, height: 1, colour: red}]";
        let environment = Environment::new(world(things));
        for (x, y, name) in [
            (2.0, 3.0, "ball"),
            (4.0, 2.3, "Anna"),
            (5.0, 2.6, "furniture"),
            (5.9, 1.0, "wall"),
            (0.3, 2.0, "station"),
        ] {
            assert_eq!(environment.name_at(Point::new(x, y)), name);
        }
    }

    #[test]
    fn a_robot_between_a_wall_and_the_end_of_a_path_is_not_held_there() {
        let route = "{through: [[5.6, 3], [1, 3], [1, 3.5]], speed: 0.5, pause: 1, closed: CLOSED}";
        for closed in ["false", "true"] {
            let route = route.replace("CLOSED", closed);
            let world = world(&format!("walkers: [{{at: [1, 3], path: {route}}}]"));
            let mut environment = Environment::new(world);
            let robot = Circle::new(Point::new(5.8, 3.0), 0.15);
            let mut far = 0;
            for _ in 0..60 * 50 {
                environment.move_things(0.02, robot);
                let person = environment.places().next().unwrap();
                far += i32::from(person.x < 3.0);
            }
            assert!(far > 10 * 50, "{closed}: {far}");
        }
    }

    #[test]
    fn a_placed_ball_leaves_its_path_and_stays() {
        let ball =
            "balls: [{at: [1, 3], colour: red, path: {through: [[1, 3], [5, 3]], speed: 0.5}}]";
        let mut environment = Environment::new(world(ball));
        let robot = Circle::new(Point::new(3.0, 1.0), 0.15);
        let place = Point::new(2.0, 2.0);
        environment.put_ball(0, place);
        (0..200).for_each(|_| environment.move_things(0.02, robot));
        assert_eq!(environment.places().next(), Some(place));
    }

    #[test]
    fn a_pushed_ball_rolls_on_and_comes_to_rest() {
        let mut environment = Environment::new(world("balls: [{at: [3, 2], colour: red}]"));
        let robot = Circle::new(Point::new(2.76, 2.0), 0.15);
        environment.push_balls(robot, 0.4);
        for _ in 0..200 {
            environment.move_things(0.02, robot);
        }
        let place = environment.places().next().unwrap();
        assert!((3.15..3.4).contains(&place.x), "{place:?}");
        assert!((environment.obstacles.clearance(Point::new(place.x, 2.5)) - 0.4).abs() < 1e-6);
    }

    #[test]
    fn a_ball_at_the_wall_is_not_pushed() {
        let mut environment = Environment::new(world("balls: [{at: [5.9, 2], colour: red}]"));
        let robot = Circle::new(Point::new(5.7, 2.0), 0.15);
        environment.push_balls(robot, 0.4);
        assert_eq!(environment.places().next(), Some(Point::new(5.9, 2.0)));
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
