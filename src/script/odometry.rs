//! Where the robot is since the script last asked to begin at zero: dead reckoning from the setpoints of
//! the script, with turns as the camera sees them where it does, and how far off that may be.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::Duration;

use tokio::time::Instant;

use super::options::Calibration;
use crate::robot::Setpoint;
use crate::vision::Drive;

/// What tracks slip on an unknown floor: metres for each metre, radians for each radian and for each metre.
const SLIP_OF_WAY: f64 = 0.1;
const SLIP_OF_TURN: f64 = 0.15;
const VEER: f64 = 0.08;
/// The same for a turn that the camera has seen.
const SEEN_TURN: f64 = 0.04;
/// The camera stands this share of the distance to what it sees before the middle of the robot, which makes
/// turns look larger: 0.1 m before it, and 1.25 m to what stands around in a room.
const PARALLAX: f64 = 1.05;
/// Radians per second that something else may turn the robot by.
const OTHERS_TURN: f64 = 2.0;
/// What others do counts from so much after the script's own motion: the news of its end is as late.
const GRACE: Duration = Duration::from_millis(300);
/// Frames whose poses are kept, and for how long.
const MOST_MARKS: usize = 128;
const OLDEST: Duration = Duration::from_secs(4);

/// A place in the plane and how sure it is. It began at zero, looking along x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Pose {
    /// Metres.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Radians to the left, not wrapped.
    pub(super) heading: f64,
    /// Metres that the place may be off.
    pub(super) error: f64,
    /// Radians that the heading may be off, at most half a turn.
    pub(super) heading_error: f64,
}

/// What drives the robot now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Driver {
    Nobody,
    Script(Drive),
    /// Another behaviour, the watchdog, the robot's own search.
    Other,
}

/// The movement that belongs to a setpoint.
pub(super) fn drive_of(setpoint: Setpoint, calibration: Calibration) -> Drive {
    let speed = |power: i8| f64::from(power) / FULL_POWER * calibration.full_speed;
    let (left, right) = (speed(setpoint.left.get()), speed(setpoint.right.get()));
    Drive {
        forward: (left + right) / 2.0,
        turn: (right - left) / calibration.track_width,
    }
}

/// The power that belongs to full speed (`PROTOCOL.md`, MOVE).
const FULL_POWER: f64 = 90.0;

/// See the module.
#[derive(Debug)]
pub(super) struct Odometry {
    pose: Pose,
    at: Instant,
    drove: Option<Instant>,
    /// Metres of all the script's ways so far, backwards ones taken off.
    odometer: f64,
    full_speed: f64,
    /// The poses when frames were taken, the oldest first.
    marks: VecDeque<(Instant, Pose)>,
}

impl Odometry {
    /// At zero.
    pub(super) fn new(now: Instant, calibration: Calibration) -> Odometry {
        Odometry {
            pose: Pose::default(),
            at: now,
            drove: None,
            odometer: 0.0,
            full_speed: calibration.full_speed,
            marks: VecDeque::new(),
        }
    }

    /// Begins anew at zero.
    pub(super) fn reset(&mut self) {
        self.pose = Pose::default();
        self.marks.clear();
    }

    /// Where it is, as of the last [`advance`](Odometry::advance).
    pub(super) fn pose(&self) -> Pose {
        self.pose
    }

    /// Metres that the script's tracks have made, backwards ones taken off.
    pub(super) fn odometer(&self) -> f64 {
        self.odometer
    }

    /// Until `now` this has driven. Whether that was someone else than the script.
    pub(super) fn advance(&mut self, now: Instant, driver: Driver) -> bool {
        let time = now.saturating_duration_since(self.at);
        self.at = self.at.max(now);
        let seconds = time.as_secs_f64();
        match driver {
            Driver::Nobody => {}
            Driver::Script(drive) => {
                self.drove = Some(self.at);
                self.odometer += drive.forward * seconds;
                self.pose = self.pose.after(drive, seconds);
            }
            Driver::Other => {
                let own = self.drove.is_some_and(|drove| self.at - drove < GRACE);
                if !own {
                    self.pose.error += self.full_speed * seconds;
                    self.pose.worsen_heading(OTHERS_TURN * seconds);
                }
                return !own;
            }
        }
        false
    }

    /// Remembers where a frame was taken.
    pub(super) fn mark(&mut self, at: Instant) {
        while self
            .marks
            .front()
            .is_some_and(|(old, _)| *old + OLDEST < at)
            || self.marks.len() >= MOST_MARKS
        {
            self.marks.pop_front();
        }
        self.marks.push_back((at, self.pose));
    }

    /// The turn between the last two frames, as the tracks should have made it.
    pub(super) fn last_turn(&self) -> Option<f64> {
        let mut newest = self.marks.iter().rev();
        let (now, before) = (newest.next()?.1, newest.next()?.1);
        Some(now.heading - before.heading)
    }

    /// The camera has seen another turn between the last two frames, in radians.
    pub(super) fn correct_turn(&mut self, seen: f64) {
        let Some(expected) = self.last_turn() else {
            return;
        };
        let turned = seen / PARALLAX;
        let better = (SLIP_OF_TURN - SEEN_TURN) * expected.abs();
        for pose in self
            .marks
            .back_mut()
            .map(|(_, pose)| pose)
            .into_iter()
            .chain([&mut self.pose])
        {
            pose.heading += turned - expected;
            pose.heading_error = (pose.heading_error - better).max(0.0);
        }
    }

    /// It has stood since then, whatever its tracks did.
    pub(super) fn rewind(&mut self, since: Instant) {
        let before = self.marks.iter().rev().find(|(at, _)| *at <= since);
        if let Some((_, stood)) = before {
            let heading = self.pose.heading;
            self.pose = Pose { heading, ..*stood };
            self.marks.clear();
        }
    }
}

impl Pose {
    /// After a time of an even drive: a line, an arc, or a turn on the spot.
    fn after(mut self, drive: Drive, seconds: f64) -> Pose {
        let (way, turn) = (drive.forward * seconds, drive.turn * seconds);
        // The chord of the arc.
        let chord = if turn.abs() < 1e-6 {
            way
        } else {
            way * (turn / 2.0).sin() / (turn / 2.0)
        };
        let along = self.heading + turn / 2.0;
        self.x += chord * along.cos();
        self.y += chord * along.sin();
        self.heading += turn;
        self.error += way.abs() * (SLIP_OF_WAY + self.heading_error.min(1.0));
        self.worsen_heading(SLIP_OF_TURN * turn.abs() + VEER * way.abs());
        self
    }

    fn worsen_heading(&mut self, by: f64) {
        self.heading_error = (self.heading_error + by).min(PI);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    const AHEAD: Driver = Driver::Script(Drive {
        forward: 0.2,
        turn: 0.0,
    });
    const LEFT: Driver = Driver::Script(Drive {
        forward: 0.0,
        turn: FRAC_PI_2,
    });

    fn odometry() -> (Odometry, Instant) {
        let now = Instant::now();
        (Odometry::new(now, Calibration::default()), now)
    }

    fn near(one: f64, other: f64) -> bool {
        (one - other).abs() < 1e-6
    }

    #[test]
    fn a_line_a_turn_and_an_arc_lead_where_geometry_says() {
        let (mut odometry, mut now) = odometry();
        let arc = Driver::Script(Drive {
            forward: FRAC_PI_2,
            turn: FRAC_PI_2,
        });
        for (driver, x, y) in [
            (AHEAD, 0.2, 0.0),
            (LEFT, 0.2, 0.0),
            (AHEAD, 0.2, 0.2),
            (arc, -0.8, 1.2),
        ] {
            for _ in 0..100 {
                now += Duration::from_millis(10);
                odometry.advance(now, driver);
            }
            let pose = odometry.pose();
            assert!(near(pose.x, x) && near(pose.y, y), "{pose:?}");
        }
        assert!(near(odometry.pose().heading, PI));
        odometry.reset();
        assert_eq!(odometry.pose(), Pose::default());
    }

    #[test]
    fn the_error_grows_with_the_way_and_less_where_the_camera_saw_the_turn() {
        let (mut odometry, start) = odometry();
        odometry.advance(start + Duration::from_secs(1), AHEAD);
        let straight = odometry.pose();
        assert!(straight.error > 0.0 && straight.heading_error > 0.0);
        odometry.mark(start + Duration::from_secs(1));
        odometry.advance(start + Duration::from_secs(2), LEFT);
        odometry.mark(start + Duration::from_secs(2));
        let unseen = odometry.pose();
        odometry.correct_turn(1.4 * PARALLAX);
        let seen = odometry.pose();
        assert!(
            near(seen.heading, 1.4) && seen.heading_error < unseen.heading_error,
            "{seen:?}"
        );
    }

    #[test]
    fn what_others_drive_makes_the_place_unsure_but_not_the_echo_of_its_own_motion() {
        let (mut odometry, start) = odometry();
        odometry.advance(start + Duration::from_secs(1), AHEAD);
        let own = odometry.pose();
        assert!(!odometry.advance(start + Duration::from_millis(1100), Driver::Other));
        assert_eq!(odometry.pose(), own);
        assert!(odometry.advance(start + Duration::from_secs(9), Driver::Other));
        let pose = odometry.pose();
        assert!(pose.error > 1.0 && near(pose.heading_error, PI), "{pose:?}");
        assert!(near(pose.x, own.x));
    }

    #[test]
    fn a_robot_that_was_held_has_not_come_on() {
        let (mut odometry, start) = odometry();
        for second in 1..=3 {
            let now = start + Duration::from_secs(second);
            odometry.advance(now, AHEAD);
            odometry.mark(now);
        }
        odometry.rewind(start + Duration::from_secs(2));
        assert!(near(odometry.pose().x, 0.4));
    }
}
