//! Where the robot is since the script last asked to begin at zero: dead reckoning from the setpoints of
//! the script, corrected by the turns that the camera sees, and how far off that may be.
//!
//! The tracks gain speed as `ramp` has it, and a picture shows what they did as long ago as `lateness` has found
//! out. What tracks and camera say then differs by the slip of the tracks and by mistakes of the camera: the
//! heading follows each as far as it can be trusted, which is the gain of a Kalman filter.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::Duration;

use tokio::time::Instant;

use super::lateness::Lateness;
use super::options::Calibration;
use super::ramp::Ramp;
use super::shown::{SEEN_TURN, SLIP_OF_TURN, Shown, VEER};
use super::travel::Travel;
use crate::robot::Setpoint;
use crate::vision::Drive;

/// What tracks slip on an unknown floor: metres for each metre.
const SLIP_OF_WAY: f64 = 0.1;
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

/// No movement.
const STILL: Drive = Drive {
    forward: 0.0,
    turn: 0.0,
};

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
    calibration: Calibration,
    ramp: Ramp,
    travel: Travel,
    lateness: Lateness,
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
            calibration,
            ramp: Ramp::default(),
            travel: Travel::new(now),
            lateness: Lateness::default(),
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
        let end = self.at.max(now);
        let echo = self.drove.is_some_and(|drove| end - drove < GRACE);
        match driver {
            Driver::Nobody => self.drive(STILL, time),
            Driver::Script(drive) => {
                self.drove = Some(end);
                self.odometer += drive.forward * time.as_secs_f64();
                self.drive(drive, time);
            }
            Driver::Other if echo => self.drive(STILL, time),
            Driver::Other => {
                self.ramp = Ramp::default();
                self.travel.add(end, 0.0, 0.0);
                let seconds = time.as_secs_f64();
                self.pose.error += self.calibration.full_speed * seconds;
                self.pose.worsen_heading(OTHERS_TURN * seconds);
            }
        }
        self.at = end;
        matches!(driver, Driver::Other) && !echo
    }

    /// The tracks follow this command for a time.
    fn drive(&mut self, command: Drive, time: Duration) {
        let (whole, mut past) = (time.as_secs_f64(), 0.0);
        loop {
            let width = self.calibration.track_width;
            let (motion, seconds) = self.ramp.step(command, width, whole - past);
            past += seconds;
            self.pose = self.pose.after(motion, seconds);
            let end = self.at + Duration::from_secs_f64(past.min(whole));
            let (turn, way) = (motion.turn * seconds, motion.forward * seconds);
            self.travel.add(end, turn, way);
            if past >= whole {
                break;
            }
        }
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

    /// What the tracks did between the last two frames.
    pub(super) fn last_shown(&self) -> Option<Shown> {
        let mut newest = self.marks.iter().rev();
        let (now, before) = (newest.next()?.0, newest.next()?.0);
        self.shown(before, now)
    }

    /// What the tracks did between the moments that two frames show, which came at these times; `None` if that
    /// is too long ago.
    pub(super) fn shown(&self, before: Instant, now: Instant) -> Option<Shown> {
        Shown::between(&self.travel, &self.lateness, before, now)
    }

    /// The camera has seen this turn between the two frames, in radians.
    pub(super) fn correct_turn(&mut self, shown: &Shown, seen: f64) {
        let correction = shown.correction(seen);
        self.lateness.note(correction.seen, shown.turns());
        self.pose.heading += correction.turn;
        let better = correction.gain * (SLIP_OF_TURN - SEEN_TURN) * shown.turned();
        self.pose.heading_error = (self.pose.heading_error - better).max(0.0);
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

    /// Until `now`, in steps of a hundredth of a second.
    fn drive(odometry: &mut Odometry, now: &mut Instant, driver: Driver, seconds: u32) {
        for _ in 0..seconds * 100 {
            *now += Duration::from_millis(10);
            odometry.advance(*now, driver);
        }
    }

    #[test]
    fn a_line_a_turn_and_an_arc_lead_where_geometry_says() {
        let (mut odometry, mut now) = odometry();
        let arc = Driver::Script(Drive {
            forward: FRAC_PI_2 / 10.0,
            turn: FRAC_PI_2 / 10.0,
        });
        for (driver, seconds, x, y) in [
            (AHEAD, 1, 0.2, 0.0),
            (LEFT, 1, 0.2, 0.0),
            (AHEAD, 1, 0.2, 0.2),
            (arc, 10, -0.8, 1.2),
        ] {
            drive(&mut odometry, &mut now, driver, seconds);
            // It rolls out.
            drive(&mut odometry, &mut now, Driver::Nobody, 1);
            let pose = odometry.pose();
            assert!((pose.x - x).hypot(pose.y - y) < 0.02, "{pose:?}");
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
        let (unseen, shown) = (odometry.pose(), odometry.last_shown().unwrap());
        odometry.correct_turn(&shown, 1.4);
        let seen = odometry.pose();
        assert!(
            seen.heading < unseen.heading && seen.heading_error < unseen.heading_error,
            "{seen:?}"
        );
    }

    #[test]
    fn turns_that_pictures_show_late_are_neither_lost_nor_counted_twice() {
        let (late, width) = (
            Duration::from_millis(200),
            Calibration::default().track_width,
        );
        let (mut odometry, start) = odometry();
        let (mut slipping, mut truth, mut turned) = (Ramp::default(), Travel::new(start), 0.0);
        let mut last = start;
        for tick in 0..800 {
            let now = start + Duration::from_millis(10) * (tick + 1);
            let turn = if tick % 200 < 100 { 1.5 } else { 0.0 };
            let forward = if turn == 0.0 { 0.2 } else { 0.0 };
            odometry.advance(now, Driver::Script(Drive { forward, turn }));
            let slips = Drive {
                forward,
                turn: 0.9 * turn,
            };
            let (motion, seconds) = slipping.step(slips, width, 0.01);
            turned += motion.turn * seconds;
            truth.add(now, motion.turn * seconds, 0.0);
            if tick % 12 == 0 {
                odometry.mark(now);
                let seen = truth.between(last - late, now - late);
                if let (Some(shown), Some(seen)) = (odometry.last_shown(), seen) {
                    odometry.correct_turn(&shown, seen.turn * 1.05);
                }
                last = now;
            }
        }
        let pose = odometry.pose();
        // Four turns of 1.5 radians, less what the tracks slip.
        assert!((turned - 5.5).abs() < 0.1, "{turned}");
        assert!((pose.heading - turned).abs() < 0.25, "{pose:?}");
    }

    #[test]
    fn who_walks_by_is_no_turn() {
        let (mut odometry, mut now) = odometry();
        for _ in 0..2 {
            drive(&mut odometry, &mut now, AHEAD, 1);
            odometry.mark(now);
        }
        let shown = odometry.last_shown().unwrap();
        odometry.correct_turn(&shown, 0.3);
        assert!(near(odometry.pose().heading, 0.0));
    }

    #[test]
    fn what_others_drive_makes_the_place_unsure_but_not_the_echo_of_its_own_motion() {
        let (mut odometry, start) = odometry();
        odometry.advance(start + Duration::from_secs(1), AHEAD);
        let own = odometry.pose();
        assert!(!odometry.advance(start + Duration::from_millis(1200), Driver::Other));
        let echo = odometry.pose();
        assert!(
            near(echo.x, 0.2) && echo.error < own.error + 0.01,
            "{echo:?}"
        );
        assert!(odometry.advance(start + Duration::from_secs(9), Driver::Other));
        let pose = odometry.pose();
        assert!(pose.error > 1.0 && near(pose.heading_error, PI), "{pose:?}");
        assert!(near(pose.x, echo.x));
    }

    #[test]
    fn a_robot_that_was_held_has_not_come_on() {
        let (mut odometry, mut now) = odometry();
        let start = now;
        for _ in 0..3 {
            drive(&mut odometry, &mut now, AHEAD, 1);
            odometry.mark(now);
        }
        odometry.rewind(start + Duration::from_secs(2));
        assert!((odometry.pose().x - 0.4).abs() < 0.02);
    }
}
