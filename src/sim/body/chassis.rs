//! The robot's body: two tracks with a speed ramp, unequal motors and slip, and collisions that stop
//! it. Independent of the protocol and of the battery.

use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use crate::geometry::obstacles::{Bump, Obstacles};
use crate::geometry::{Pose, RADIUS, TRACK_WIDTH, wrap};
use crate::world::settings::TrackSettings;

/// A track's speed at [`FULL_POWER`], metres per second.
pub const FULL_SPEED: f64 = 0.45;
/// Full power in the protocol. Some clients send up to 127, which is not faster.
pub const FULL_POWER: i8 = 90;
/// Acceleration of a track, metres per second squared.
const ACCELERATION: f64 = 1.5;

/// One value for each track.
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Tracks<T> {
    /// Of the left track.
    pub left: T,
    /// Of the right track.
    pub right: T,
}

impl<T> Tracks<T> {
    /// Creates the pair.
    pub const fn new(left: T, right: T) -> Tracks<T> {
        Tracks { left, right }
    }
}

impl Tracks<i8> {
    /// Returns the track speeds, in metres per second, for these powers; 0 below `dead_zone`
    /// percent of full power.
    pub(crate) fn speeds(self, dead_zone: f64) -> Tracks<f64> {
        Tracks::new(
            speed_of(self.left, dead_zone),
            speed_of(self.right, dead_zone),
        )
    }
}

impl Tracks<f64> {
    pub(crate) fn scaled(self, by: f64) -> Tracks<f64> {
        Tracks::new(self.left * by, self.right * by)
    }
}

fn speed_of(power: i8, dead_zone: f64) -> f64 {
    let share = (f64::from(power) / f64::from(FULL_POWER)).clamp(-1.0, 1.0);
    if share.abs() < dead_zone / 100.0 {
        return 0.0;
    }
    share * FULL_SPEED
}

#[derive(Debug, Clone, Default)]
pub(crate) struct Chassis {
    pub(crate) pose: Pose,
    wanted: Tracks<f64>,
    /// Metres per second. Against a wall the tracks turn but the body does not move.
    pub(super) speeds: Tracks<f64>,
    pub(super) blocked: bool,
    pub(super) collisions: u64,
}

impl Chassis {
    pub(crate) fn new(pose: Pose) -> Chassis {
        Chassis {
            pose,
            ..Chassis::default()
        }
    }

    /// Sets the target speeds of the tracks, metres per second.
    pub(crate) fn set_target(&mut self, speeds: Tracks<f64>) {
        self.wanted = speeds;
    }

    /// Returns the forward speed, metres per second; negative when driving backwards.
    pub(crate) fn forward_speed(&self) -> f64 {
        (self.speeds.left + self.speeds.right) / 2.0
    }

    /// Returns the turning speed, radians per second, left positive.
    pub(crate) fn turning_speed(&self) -> f64 {
        (self.speeds.right - self.speeds.left) / TRACK_WIDTH
    }

    /// Returns the motors' load, 0..=1.
    pub(crate) fn effort(&self) -> f64 {
        (self.speeds.left.abs() + self.speeds.right.abs()) / (2.0 * FULL_SPEED)
    }

    /// Advances by `dt`, which should be at most a few hundredths of a second: a longer step could
    /// pass through a wall.
    pub(crate) fn step(&mut self, dt: Duration, obstacles: &Obstacles, bumps: &[Bump]) {
        let seconds = dt.as_secs_f64();
        self.speeds.left = ramp(self.speeds.left, self.wanted.left, ACCELERATION * seconds);
        self.speeds.right = ramp(self.speeds.right, self.wanted.right, ACCELERATION * seconds);
        let forward = self.forward_speed() * seconds;
        let turned = self.turning_speed() * seconds;
        let way = self.pose.heading + turned / 2.0;
        self.pose.heading = wrap(self.pose.heading + turned);
        let passed = self.passed(way, forward, bumps);
        if passed == 0.0 {
            self.blocked = true;
        } else {
            self.advance(way, forward * passed, obstacles);
        }
    }

    /// Returns which share of a step the bumps under the body let through.
    fn passed(&self, way: f64, forward: f64, bumps: &[Bump]) -> f64 {
        let here = self.pose.point();
        let next = here.ahead(way, forward);
        let power = (self.wanted.left + self.wanted.right).abs() / (2.0 * FULL_SPEED);
        let shares = bumps
            .iter()
            .map(|bump| bump.passed(here, next, RADIUS, power));
        shares.fold(1.0, f64::min)
    }

    fn advance(&mut self, way: f64, forward: f64, obstacles: &Obstacles) {
        /// Metres per step; a blocked body that moves less stays blocked.
        const CREEP: f64 = 0.0005;
        let here = self.pose.point();
        let free =
            |part: f64| obstacles.is_path_free(here, here.ahead(way, forward * part), RADIUS);
        if forward == 0.0 {
            return;
        }
        let part = if free(1.0) { 1.0 } else { largest(free) };
        self.pose = Pose::at(here.ahead(way, forward * part), self.pose.heading);
        if part < 1.0 {
            self.collisions += u64::from(!self.blocked);
            self.blocked = true;
        } else if forward.abs() > CREEP {
            self.blocked = false;
        }
    }
}

/// Returns the largest possible fraction of a step, found by bisection.
fn largest(possible: impl Fn(f64) -> bool) -> f64 {
    let halves = (1..=6).map(|i| 0.5_f64.powi(i));
    halves.fold(0.0, |part, half| {
        if possible(part + half) {
            part + half
        } else {
            part
        }
    })
}

fn ramp(from: f64, to: f64, most: f64) -> f64 {
    from + (to - from).clamp(-most, most)
}

/// How long a slip value applies until the next one is drawn.
const SLIP_PERIOD: Duration = Duration::from_millis(400);

#[derive(Debug)]
pub(crate) struct TrackSlip {
    settings: TrackSettings,
    random: StdRng,
    motors: Tracks<f64>,
    slip: Tracks<f64>,
    left: Duration,
}

impl TrackSlip {
    /// The seed determines by how much each track is slower, and how it slips.
    pub(crate) fn new(settings: TrackSettings, seed: u64) -> TrackSlip {
        // A separate random sequence, independent of the noise of the frames.
        let mut random = StdRng::seed_from_u64(seed ^ 0x7472_6163_6b73);
        let mut motor = || 1.0 - settings.unequal * random.random_range(0.0..=1.0);
        let motors = Tracks::new(motor(), motor());
        TrackSlip {
            settings,
            random,
            motors,
            slip: Tracks::new(1.0, 1.0),
            left: Duration::ZERO,
        }
    }

    pub(crate) fn step(&mut self, wanted: Tracks<f64>, dt: Duration) -> Tracks<f64> {
        if self.settings.unequal == 0.0 && self.settings.slip == 0.0 {
            return wanted;
        }
        self.left = self.left.saturating_sub(dt);
        if self.left.is_zero() {
            self.left = SLIP_PERIOD;
            let most = self.settings.slip;
            let mut slip = || 1.0 + most * self.random.random_range(-1.0..=1.0);
            self.slip = Tracks::new(slip(), slip());
        }
        Tracks::new(
            wanted.left * self.motors.left * self.slip.left,
            wanted.right * self.motors.right * self.slip.right,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::World;
    use std::f64::consts::PI;

    const TICK: Duration = Duration::from_millis(20);
    const DEAD_ZONE: f64 = 5.5;

    fn obstacles() -> Obstacles {
        let text = "room: {width: 6, depth: 4}\nstation: {at: [0, 2], heading_degrees: 0}\n\
                    balls: [{at: [4, 2], colour: red}]\n";
        World::from_yaml(text, "test").unwrap().obstacles()
    }

    fn driven(from: Pose, left: i8, right: i8, seconds: u32) -> Chassis {
        let mut body = Chassis::new(from);
        let obstacles = obstacles();
        body.set_target(Tracks::new(left, right).speeds(DEAD_ZONE));
        (0..seconds * 50).for_each(|_| body.step(TICK, &obstacles, &[]));
        body
    }

    #[test]
    fn equal_tracks_drive_straight_at_the_calibrated_speed() {
        let body = driven(Pose::new(1.0, 3.0, 0.0), 90, 90, 4);
        let lost_in_the_ramp = FULL_SPEED * FULL_SPEED / ACCELERATION / 2.0;
        assert!((body.pose.x - 1.0 - 4.0 * FULL_SPEED + lost_in_the_ramp).abs() < 0.02);
        assert!((body.pose.y - 3.0).abs() < 1e-9 && body.pose.heading.abs() < 1e-9);
    }

    #[test]
    fn left_back_and_right_forward_turns_left_on_the_spot() {
        let mut body = Chassis::new(Pose::new(2.0, 3.0, 0.0));
        let obstacles = obstacles();
        body.set_target(Tracks::new(-45, 45).speeds(DEAD_ZONE));
        (0..50).for_each(|_| body.step(TICK, &obstacles, &[]));
        assert!((1.0..2.0).contains(&body.pose.heading), "{:?}", body.pose);
        assert!(body.pose.point().distance(Pose::new(2.0, 3.0, 0.0).point()) < 1e-6);
    }

    #[test]
    fn speed_ramps_up_and_down() {
        let mut body = Chassis::new(Pose::new(1.0, 3.0, 0.0));
        let obstacles = obstacles();
        body.set_target(Tracks::new(90, 90).speeds(DEAD_ZONE));
        body.step(TICK, &obstacles, &[]);
        assert!(body.speeds.left > 0.0 && body.speeds.left < FULL_SPEED / 2.0);
        (0..50).for_each(|_| body.step(TICK, &obstacles, &[]));
        assert_eq!(body.speeds, Tracks::new(FULL_SPEED, FULL_SPEED));
        body.set_target(Tracks::default());
        body.step(TICK, &obstacles, &[]);
        assert!(body.speeds.left > FULL_SPEED / 2.0);
        (0..50).for_each(|_| body.step(TICK, &obstacles, &[]));
        assert_eq!(body.speeds, Tracks::default());
    }

    #[test]
    fn a_wall_counts_one_collision_and_reversing_frees_the_robot() {
        let mut body = driven(Pose::new(5.0, 3.0, 0.0), 90, 90, 5);
        assert!(body.blocked && body.collisions == 1);
        assert!((6.0 - RADIUS - body.pose.x).abs() < 0.02, "{:?}", body.pose);
        body.set_target(Tracks::new(-90, -90).speeds(DEAD_ZONE));
        (0..100).for_each(|_| body.step(TICK, &obstacles(), &[]));
        assert!(body.pose.x < 5.5 && !body.blocked && body.collisions == 1);
    }

    #[test]
    fn balls_block_too_and_turning_is_always_possible() {
        let mut body = driven(Pose::new(3.0, 2.0, 0.0), 90, 90, 5);
        assert!(
            (4.0 - 0.1 - RADIUS - body.pose.x).abs() < 0.02,
            "{:?}",
            body.pose
        );
        body.set_target(Tracks::new(-45, 45).speeds(DEAD_ZONE));
        (0..100).for_each(|_| body.step(TICK, &obstacles(), &[]));
        assert!(wrap(body.pose.heading).abs() > 0.5);
    }

    #[test]
    fn power_above_full_is_not_faster_and_tiny_power_does_not_move() {
        assert_eq!(
            Tracks::new(127i8, -128).speeds(DEAD_ZONE),
            Tracks::new(FULL_SPEED, -FULL_SPEED)
        );
        assert_eq!(Tracks::new(4i8, -4).speeds(DEAD_ZONE), Tracks::default());
        let turned = driven(Pose::new(1.0, 3.0, PI), 4, 4, 2);
        assert_eq!(turned.pose, Pose::new(1.0, 3.0, PI));
    }

    fn speeds(settings: TrackSettings, seed: u64) -> Vec<Tracks<f64>> {
        let mut track_slip = TrackSlip::new(settings, seed);
        let wanted = Tracks::new(1.0, 1.0);
        (0..100)
            .map(|_| track_slip.step(wanted, Duration::from_millis(20)))
            .collect()
    }

    #[test]
    fn tracks_differ_by_seed_and_within_their_limits() {
        let settings = TrackSettings {
            unequal: 0.1,
            slip: 0.05,
            ..TrackSettings::default()
        };
        assert_eq!(speeds(settings, 1), speeds(settings, 1));
        assert_ne!(speeds(settings, 1), speeds(settings, 2));
        let seen = speeds(settings, 3);
        assert!(
            seen.iter()
                .all(|s| (0.85..=1.05).contains(&s.left) && (0.85..=1.05).contains(&s.right))
        );
        assert!(seen.iter().any(|s| s.left != seen[0].left), "no slip");
        assert!(seen.iter().all(|s| s.left != s.right));
    }

    #[test]
    fn perfect_tracks_reach_the_wanted_speeds() {
        let perfect = speeds(TrackSettings::default(), 1);
        assert!(perfect.iter().all(|s| *s == Tracks::new(1.0, 1.0)));
    }
}
