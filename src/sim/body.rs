//! The robot's body: two tracks with a speed ramp, and walls that stop it. Knows neither the
//! protocol nor the battery.

use std::time::Duration;

use super::geometry::{Pose, wrap};
use super::obstacles::Obstacles;

/// The body seen from above is a circle of this radius, metres.
pub const RADIUS: f64 = 0.15;
/// Between the middles of the tracks, metres.
pub const TRACK_WIDTH: f64 = 0.24;
/// A track's speed at [`FULL_POWER`], metres a second.
pub const FULL_SPEED: f64 = 0.45;
/// The power that the protocol calls full; clients in the wild send up to 127, which is no faster.
pub const FULL_POWER: i8 = 90;
/// Below this power the tracks do not overcome their own friction.
const DEAD_POWER: i8 = 5;
/// How fast a track changes its speed, metres a second squared.
const ACCELERATION: f64 = 1.5;

/// One number for each track.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Tracks<T> {
    /// The left track.
    pub left: T,
    /// The right track.
    pub right: T,
}

impl<T> Tracks<T> {
    /// Of a left and a right.
    pub const fn new(left: T, right: T) -> Tracks<T> {
        Tracks { left, right }
    }
}

impl Tracks<i8> {
    /// The speeds, metres a second, that these powers are worth.
    pub(super) fn speeds(self) -> Tracks<f64> {
        Tracks::new(speed_of(self.left), speed_of(self.right))
    }
}

fn speed_of(power: i8) -> f64 {
    if power.unsigned_abs() < DEAD_POWER.unsigned_abs() {
        return 0.0;
    }
    let share = f64::from(power) / f64::from(FULL_POWER);
    share.clamp(-1.0, 1.0) * FULL_SPEED
}

/// The body, somewhere in a world.
#[derive(Debug, Clone)]
pub(super) struct Body {
    pub(super) pose: Pose,
    wanted: Tracks<f64>,
    speeds: Tracks<f64>,
    blocked: bool,
    collisions: u64,
}

impl Body {
    /// At rest.
    pub(super) fn new(pose: Pose) -> Body {
        Body {
            pose,
            wanted: Tracks::default(),
            speeds: Tracks::default(),
            blocked: false,
            collisions: 0,
        }
    }

    /// The speeds, metres a second, that the tracks now try to reach.
    pub(super) fn want(&mut self, speeds: Tracks<f64>) {
        self.wanted = speeds;
    }

    /// The tracks' speeds, metres a second. Against a wall they turn and the body does not move.
    pub(super) fn speeds(&self) -> Tracks<f64> {
        self.speeds
    }

    /// Whether something is in the way.
    pub(super) fn blocked(&self) -> bool {
        self.blocked
    }

    /// How often it ran into something.
    pub(super) fn collisions(&self) -> u64 {
        self.collisions
    }

    /// How hard the motors work, 0..=1.
    pub(super) fn effort(&self) -> f64 {
        (self.speeds.left.abs() + self.speeds.right.abs()) / (2.0 * FULL_SPEED)
    }

    /// Lets `dt` pass; a few hundredths of a second at most, or walls become thin.
    pub(super) fn step(&mut self, dt: Duration, obstacles: &Obstacles) {
        let seconds = dt.as_secs_f64();
        self.speeds.left = ramp(self.speeds.left, self.wanted.left, ACCELERATION * seconds);
        self.speeds.right = ramp(self.speeds.right, self.wanted.right, ACCELERATION * seconds);
        let forward = (self.speeds.left + self.speeds.right) / 2.0 * seconds;
        let turned = (self.speeds.right - self.speeds.left) / TRACK_WIDTH * seconds;
        let ahead = self
            .pose
            .point()
            .ahead(self.pose.heading + turned / 2.0, forward);
        self.pose.heading = wrap(self.pose.heading + turned);
        let free = forward == 0.0 || obstacles.way_free(self.pose.point(), ahead, RADIUS);
        if free {
            self.pose = Pose::at(ahead, self.pose.heading);
        } else if !self.blocked {
            self.collisions += 1;
        }
        self.blocked = !free;
    }
}

fn ramp(from: f64, to: f64, most: f64) -> f64 {
    from + (to - from).clamp(-most, most)
}
