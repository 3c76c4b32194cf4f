//! The robot's environment: its world, with the balls and people that move in it.

use super::chassis::Chassis;
use crate::sim::geometry::obstacles::{Circle, Obstacles};
use crate::sim::geometry::{Point, RADIUS};
use crate::sim::world::document::World;
use crate::sim::world::dynamics::Dynamics;

/// The current state of a world.
pub(super) struct Environment {
    /// The world in its initial state.
    pub(super) world: World,
    pub(super) obstacles: Obstacles,
    dynamics: Dynamics,
}

impl Environment {
    /// Creates the environment from the initial state of a world.
    pub(super) fn new(world: World) -> Environment {
        Environment {
            obstacles: world.obstacles(),
            dynamics: Dynamics::new(&world),
            world,
        }
    }

    /// Returns the places of balls and people, balls first.
    pub(super) fn places(&self) -> impl Iterator<Item = Point> {
        self.dynamics.places()
    }

    /// Puts a ball at a place, at rest; `index` is its index in the world's list.
    pub(super) fn put_ball(&mut self, index: usize, place: Point) {
        if index < self.world.balls.len() && place.x.is_finite() && place.y.is_finite() {
            self.dynamics.put_ball(index, place);
            self.obstacles.move_round(index, place);
        }
    }

    /// Advances everything that moves besides the robot, and pushes balls out of the robot's way.
    pub(super) fn step(&mut self, seconds: f64, chassis: &Chassis) {
        let here = Circle::new(chassis.pose.point(), RADIUS);
        self.dynamics.step(seconds, here, &mut self.obstacles);
        let speed = chassis.forward_speed();
        if speed != 0.0 {
            // Looks a little farther than the robot gets in this step, so that a ball rolls away
            // before it can block the robot.
            let next = here
                .middle
                .ahead(chassis.pose.heading, 1.5 * speed * seconds);
            let next = Circle::new(next, RADIUS);
            self.dynamics.push_balls(next, speed, &mut self.obstacles);
        }
    }

    /// Returns the name of the thing nearest to a point.
    pub(super) fn name_at(&self, point: Point) -> String {
        self.world.name_of(self.obstacles.nearest(point))
    }
}
