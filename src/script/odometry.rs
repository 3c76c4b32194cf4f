//! The pose of the robot since the script last reset it, and its error: dead reckoning from the
//! setpoints of the script, corrected by the turns that the camera sees.
//!
//! The tracks accelerate as modelled in `ramp`, and a picture shows what they did earlier, by the
//! delay estimated in `picture_delay`. The remaining difference between tracks and camera comes
//! from slip of the tracks and from errors of the camera: the heading follows each as far as it can
//! be trusted, with the gain of a Kalman filter. A full turn on the spot corrects the heading, and
//! measures how far the tracks can be trusted.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::Duration;

use tokio::time::Instant;

use super::full_turn::FullTurn;
use super::options::Calibration;
use super::picture_delay::PictureDelay;
use super::ramp::Ramp;
use super::track_motion::{Correction, TrackMotion, VEER};
use super::travel::Travel;
use super::turn_slip::TurnSlip;
use crate::robot::Setpoint;
use crate::vision::{Drive, Skyline};

/// Slip of the tracks on an unknown floor, in metres per metre.
const DISTANCE_SLIP: f64 = 0.1;
/// Turn rate in radians per second that is assumed while something else drives the robot.
const FOREIGN_TURN_RATE: f64 = 2.0;
/// Motion that is not the script's counts only from this long after the script's own motion,
/// because the report that its own motion has ended arrives as late as this.
const GRACE: Duration = Duration::from_millis(300);
/// Largest number of frames whose poses are kept, and for how long.
const MAX_MARKS: usize = 128;
const OLDEST: Duration = Duration::from_secs(4);

/// A place in the plane and its uncertainty. It starts at zero, facing along x.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Pose {
    /// Metres.
    pub(super) x: f64,
    pub(super) y: f64,
    /// Radians to the left, not wrapped.
    pub(super) heading: f64,
    /// Error of the place, in metres.
    pub(super) error: f64,
    /// Error of the heading in radians, at most half a turn.
    pub(super) heading_error: f64,
}

/// The source of the robot's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Driver {
    None,
    Script(Drive),
    /// Another behaviour, the watchdog, or the robot's own search for its station.
    Other,
}

/// Standing still.
const STILL: Drive = Drive {
    forward: 0.0,
    turn: 0.0,
};

/// Converts a setpoint to the motion that it should cause.
pub(super) fn drive_of(setpoint: Setpoint, calibration: Calibration) -> Drive {
    let speed = |power: i8| f64::from(power) / FULL_POWER * calibration.full_speed;
    let (left, right) = (speed(setpoint.left.get()), speed(setpoint.right.get()));
    Drive {
        forward: (left + right) / 2.0,
        turn: (right - left) / calibration.track_width,
    }
}

/// The power of a track at full speed, in the units of the robot's MOVE command.
const FULL_POWER: f64 = 90.0;

/// See the module documentation.
#[derive(Debug)]
pub(super) struct Odometry {
    pose: Pose,
    at: Instant,
    last_script_motion: Option<Instant>,
    /// Metres that the tracks have covered for the script so far; backward motion counts as
    /// negative.
    odometer: f64,
    calibration: Calibration,
    ramp: Ramp,
    travel: Travel,
    picture_delay: PictureDelay,
    turn_slip: TurnSlip,
    /// The skyline of the last frame that was examined while the robot turned, and when that frame
    /// arrived.
    skyline: Option<(Instant, Skyline)>,
    full_turn: FullTurn,
    /// The poses at the times when frames arrived, the oldest first.
    marks: VecDeque<(Instant, Pose)>,
}

impl Odometry {
    /// Creates the odometry with the pose at zero.
    pub(super) fn new(now: Instant, calibration: Calibration) -> Odometry {
        Odometry {
            pose: Pose::default(),
            at: now,
            last_script_motion: None,
            odometer: 0.0,
            calibration,
            ramp: Ramp::default(),
            travel: Travel::new(now),
            picture_delay: PictureDelay::default(),
            turn_slip: TurnSlip::default(),
            skyline: None,
            full_turn: FullTurn::default(),
            marks: VecDeque::new(),
        }
    }

    /// Resets the pose to zero.
    pub(super) fn reset(&mut self) {
        self.pose = Pose::default();
        self.marks.clear();
        self.full_turn.forget();
    }

    /// The pose as of the last [`advance`](Odometry::advance).
    pub(super) fn pose(&self) -> Pose {
        self.pose
    }

    /// Metres that the tracks have covered for the script; backward motion counts as negative.
    pub(super) fn odometer(&self) -> f64 {
        self.odometer
    }

    /// Advances the pose to `now`, driven by `driver` since the last call. Returns whether
    /// something other than the script has driven the robot.
    pub(super) fn advance(&mut self, now: Instant, driver: Driver) -> bool {
        let time = now.saturating_duration_since(self.at);
        let end = self.at.max(now);
        let echo = self
            .last_script_motion
            .is_some_and(|last| end - last < GRACE);
        match driver {
            Driver::None => self.drive(STILL, time),
            Driver::Script(drive) => {
                self.last_script_motion = Some(end);
                self.odometer += drive.forward * time.as_secs_f64();
                self.drive(drive, time);
            }
            Driver::Other if echo => self.drive(STILL, time),
            Driver::Other => {
                self.ramp = Ramp::default();
                self.travel.add(end, 0.0, 0.0, 0.0);
                self.full_turn.forget();
                let seconds = time.as_secs_f64();
                self.pose.error += self.calibration.full_speed * seconds;
                self.pose
                    .increase_heading_error(FOREIGN_TURN_RATE * seconds);
            }
        }
        self.at = end;
        matches!(driver, Driver::Other) && !echo
    }

    /// Lets the tracks follow this command for `time`.
    fn drive(&mut self, command: Drive, time: Duration) {
        let (whole, mut past) = (time.as_secs_f64(), 0.0);
        loop {
            let width = self.calibration.track_width;
            let (motion, seconds) = self.ramp.step(command, width, whole - past);
            past += seconds;
            let (commanded, way) = (motion.turn * seconds, motion.forward * seconds);
            let turn = self.turn_slip.share() * commanded;
            self.pose = self.pose.after(way, turn);
            self.pose
                .increase_heading_error(self.turn_slip.deviation() * turn.abs() + VEER * way.abs());
            self.turn_slip.increase_uncertainty(turn.abs());
            let end = self.at + Duration::from_secs_f64(past.min(whole));
            self.travel.add(end, commanded, turn, way);
            if past >= whole {
                break;
            }
        }
    }

    /// Records the pose at the time of a frame.
    pub(super) fn mark(&mut self, at: Instant) {
        while self
            .marks
            .front()
            .is_some_and(|(old, _)| *old + OLDEST < at)
            || self.marks.len() >= MAX_MARKS
        {
            self.marks.pop_front();
        }
        self.marks.push_back((at, self.pose));
    }

    /// What the tracks did between the last two frames.
    pub(super) fn last_track_motion(&self) -> Option<TrackMotion> {
        let mut newest = self.marks.iter().rev();
        let (now, before) = (newest.next()?.0, newest.next()?.0);
        self.track_motion(before, now)
    }

    /// What the tracks did between the moments that two frames show, for frames that arrived at
    /// these times; `None` if that is too long ago.
    fn track_motion(&self, before: Instant, now: Instant) -> Option<TrackMotion> {
        let slip = self.turn_slip.deviation();
        TrackMotion::between(&self.travel, &self.picture_delay, slip, before, now)
    }

    /// Processes the skyline of a frame that arrived `at`; `None` if the frame was not examined.
    pub(super) fn look(&mut self, at: Instant, skyline: Option<Skyline>) {
        let before = std::mem::replace(&mut self.skyline, skyline.map(|skyline| (at, skyline)));
        let (Some((then, before)), Some((_, skyline))) = (before, &self.skyline) else {
            return self.full_turn.forget();
        };
        let Some(motion) = self.track_motion(then, at) else {
            return self.full_turn.forget();
        };
        let (expected, reach) = motion.expected();
        let mut correction = Correction::NONE;
        if let Some(seen) = skyline.turned_since(&before, expected, reach) {
            let seen = TrackMotion::of_camera(seen);
            correction = motion.correction(seen);
            self.picture_delay.note(seen, motion.turns());
        }
        let error = self.pose.heading_error;
        let completed = self.full_turn.look(skyline, motion.step(correction), error);
        self.correct_turn(correction);
        if let Some(completed) = completed {
            self.pose.heading += completed.turned - completed.estimated;
            self.pose.heading_error = self.pose.heading_error.min(completed.error);
            self.turn_slip.learn(completed.commanded, completed.turned);
        }
    }

    /// Corrects the heading if the camera has seen more or less of a turn than the tracks made.
    fn correct_turn(&mut self, correction: Correction) {
        self.pose.heading += correction.turn;
        self.pose.heading_error = (self.pose.heading_error - correction.error_decrease).max(0.0);
        if let Some(part) = correction.difference {
            self.turn_slip.record_difference(part);
        }
    }

    /// Takes back the motion since `since`, because the robot has stood since then although its
    /// tracks turned. The heading is kept.
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
    /// The pose after a line, an arc, or a turn on the spot.
    fn after(mut self, way: f64, turn: f64) -> Pose {
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
        self.error += way.abs() * (DISTANCE_SLIP + self.heading_error.min(1.0));
        self
    }

    fn increase_heading_error(&mut self, by: f64) {
        self.heading_error = (self.heading_error + by).min(PI);
    }
}

#[cfg(test)]
mod tests;
