//! What surrounds the robot: its world with all that moves there.

use super::chassis::Chassis;
use crate::sim::geometry::obstacles::{Circle, Obstacles};
use crate::sim::geometry::{Point, RADIUS};
use crate::sim::world::document::World;
use crate::sim::world::movers::Movers;

/// A world at a moment.
pub(super) struct Surroundings {
    /// As it was at first.
    pub(super) world: World,
    pub(super) obstacles: Obstacles,
    movers: Movers,
}

impl Surroundings {
    /// As a world is at first.
    pub(super) fn of(world: World) -> Surroundings {
        Surroundings {
            obstacles: world.obstacles(),
            movers: Movers::of(&world),
            world,
        }
    }

    /// Where balls and people are, balls first.
    pub(super) fn places(&self) -> impl Iterator<Item = Point> {
        self.movers.places()
    }

    /// Puts a ball somewhere, at rest; the number is its place in the world's list.
    pub(super) fn put_ball(&mut self, index: usize, place: Point) {
        if index < self.world.balls.len() && place.x.is_finite() && place.y.is_finite() {
            self.movers.put_ball(index, place);
            self.obstacles.move_round(index, place);
        }
    }

    /// Lets time pass for all that moves besides the robot, and lets balls roll out of its way.
    pub(super) fn step(&mut self, seconds: f64, chassis: &Chassis) {
        let here = Circle::new(chassis.pose.point(), RADIUS);
        self.movers.step(seconds, here, &mut self.obstacles);
        let speed = chassis.forward_speed();
        if speed != 0.0 {
            // A little farther than it gets: what is touched makes way first.
            let next = here
                .middle
                .ahead(chassis.pose.heading, 1.5 * speed * seconds);
            let next = Circle::new(next, RADIUS);
            self.movers.make_way(next, speed, &mut self.obstacles);
        }
    }

    /// The name of what is nearest to a point.
    pub(super) fn name_at(&self, point: Point) -> String {
        self.world.name_of(self.obstacles.nearest(point))
    }
}
