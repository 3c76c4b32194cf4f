//! The pose of a robot and whether something holds it, from the commands to its tracks and from its
//! camera. Knows nothing of scripts.
//!
//! The pose is dead reckoning, corrected by the turns that the camera sees. A picture shows what
//! the tracks did earlier, by the delay estimated in `picture_delay`. The heading follows camera or
//! tracks, whichever is more accurate for the motion at hand.

mod approach;
mod blockage;
mod picture_delay;
mod travel;

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::time::Duration;

use tokio::time::Instant;

use self::picture_delay::PictureDelay;
use self::travel::{Totals, Travel};
use crate::vision::{Drive, Skyline};

pub(crate) use self::blockage::{Blockage, TimedMotion};

/// Slip of the tracks on an unknown floor: metres per metre, radians per radian, and radians by
/// which they veer per metre.
const DISTANCE_SLIP: f64 = 0.1;
const TURN_SLIP: f64 = 0.2;
const VEER: f64 = 0.08;
/// Error of the camera: radians per radian of turn; radians per metre driven, since objects that
/// the robot passes move through the picture too; and radians between any two pictures.
const SEEN_TURN: f64 = 0.1;
const PASSING: f64 = 0.3;
const NOISE: f64 = 0.003;
/// A turn that differs by more than this many standard errors from what the tracks did is rejected:
/// somebody may have walked by.
const OUTLIER: f64 = 3.0;
/// Factor by which turns look larger to the camera, because it is 0.1 m in front of the robot's
/// centre; the value holds for objects 2 m away.
const PARALLAX: f64 = 1.05;
/// How far from the expected turn the real one is searched for: at least this many radians, and
/// this share of the expected turn.
const LEAST_REACH: f64 = 0.15;
const REACH: f64 = 0.6;
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
pub(crate) struct Pose {
    /// Metres.
    pub(crate) x: f64,
    pub(crate) y: f64,
    /// Radians to the left, not wrapped.
    pub(crate) heading: f64,
    /// Error of the place, in metres.
    pub(crate) error: f64,
    /// Error of the heading in radians, at most half a turn.
    pub(crate) heading_error: f64,
}

/// The source of the robot's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Driver {
    None,
    Script(Drive),
    /// Another behaviour, the watchdog, or the robot's own search for its station.
    Other,
}

/// See the module documentation.
#[derive(Debug)]
pub(crate) struct Odometry {
    pose: Pose,
    at: Instant,
    last_script_motion: Option<Instant>,
    /// Metres that the tracks have covered for the script so far; backward motion counts as
    /// negative.
    odometer: f64,
    /// Metres per second.
    full_speed: f64,
    travel: Travel,
    picture_delay: PictureDelay,
    /// The skyline of the last frame that was examined while the robot turned, and when that frame
    /// arrived.
    skyline: Option<(Instant, Skyline)>,
    /// The poses at the times when frames arrived, the oldest first.
    marks: VecDeque<(Instant, Pose)>,
}

impl Odometry {
    /// Creates the odometry with the pose at zero.
    pub(crate) fn new(now: Instant, full_speed: f64) -> Odometry {
        Odometry {
            pose: Pose::default(),
            at: now,
            last_script_motion: None,
            odometer: 0.0,
            full_speed,
            travel: Travel::new(now),
            picture_delay: PictureDelay::default(),
            skyline: None,
            marks: VecDeque::new(),
        }
    }

    /// Resets the pose to zero.
    pub(crate) fn reset(&mut self) {
        self.pose = Pose::default();
        self.marks.clear();
    }

    /// The pose as of the last [`advance`](Odometry::advance).
    pub(crate) fn pose(&self) -> Pose {
        self.pose
    }

    /// Metres that the tracks have covered for the script; backward motion counts as negative.
    pub(crate) fn odometer(&self) -> f64 {
        self.odometer
    }

    /// Advances the pose to `now`, driven by `driver` since the last call.
    pub(crate) fn advance(&mut self, now: Instant, driver: Driver) {
        let end = self.at.max(now);
        let seconds = (end - self.at).as_secs_f64();
        self.at = end;
        let mut turn = 0.0;
        let mut way = 0.0;
        match driver {
            Driver::None => {}
            Driver::Script(drive) => {
                self.last_script_motion = Some(end);
                turn = drive.turn * seconds;
                way = drive.forward * seconds;
                self.odometer += way;
                self.pose = self.pose.after(way, turn);
                self.pose
                    .increase_heading_error(TURN_SLIP * turn.abs() + VEER * way.abs());
            }
            Driver::Other => {
                let last = self.last_script_motion;
                if last.is_none_or(|last| end - last >= GRACE) {
                    self.pose.error += self.full_speed * seconds;
                    self.pose
                        .increase_heading_error(FOREIGN_TURN_RATE * seconds);
                }
            }
        }
        self.travel.add(end, turn, way);
    }

    /// Records the pose at the time of a frame.
    pub(crate) fn mark(&mut self, at: Instant) {
        let is_old = |mark: &(Instant, Pose)| mark.0 + OLDEST < at;
        while self.marks.len() >= MAX_MARKS || self.marks.front().is_some_and(is_old) {
            self.marks.pop_front();
        }
        self.marks.push_back((at, self.pose));
    }

    /// The largest turn that the last two frames may show, to either side, in radians.
    pub(crate) fn last_turn(&self) -> f64 {
        let mut newest = self.marks.iter().rev().map(|(at, _)| *at);
        let (Some(now), Some(before)) = (newest.next(), newest.next()) else {
            return 0.0;
        };
        let turns = self.motions(before, now).map(|totals| totals.turn.abs());
        turns.into_iter().fold(0.0, f64::max)
    }

    /// What the tracks did between the moments that two frames show, for each possible delay of the
    /// pictures.
    fn motions(&self, before: Instant, now: Instant) -> [Totals; picture_delay::CANDIDATES] {
        PictureDelay::candidates().map(|delay| {
            let times = before.checked_sub(delay).zip(now.checked_sub(delay));
            let totals = times.and_then(|(from, to)| self.travel.between(from, to));
            totals.unwrap_or_default()
        })
    }

    /// Processes the skyline of a frame that arrived `at`; `None` if the frame was not examined.
    pub(crate) fn look(&mut self, at: Instant, skyline: Option<Skyline>) {
        let before = std::mem::replace(&mut self.skyline, skyline.map(|skyline| (at, skyline)));
        let (Some((then, before)), Some((_, skyline))) = (before, &self.skyline) else {
            return;
        };
        let motions = self.motions(then, at);
        let turns = motions.map(|totals| totals.turn);
        let selected = self.picture_delay.selected();
        let expected = turns[selected];
        let farthest = turns
            .iter()
            .map(|turn| (turn - expected).abs())
            .fold(LEAST_REACH, f64::max);
        let reach = farthest.max(REACH * expected.abs());
        if let Some(seen) = skyline.turned_since(&before, expected, reach) {
            let seen = seen / PARALLAX;
            self.picture_delay.note(seen, &turns);
            let beside = [
                selected.saturating_sub(1),
                (selected + 1).min(turns.len() - 1),
            ];
            let off = beside.map(|index| (turns[index] - expected).abs());
            self.correct_turn(seen, motions[selected], off[0].max(off[1]));
        }
    }

    /// Corrects the heading if the camera has seen another turn than the tracks made, unless that
    /// is implausible; the less the tracks can be trusted, the more. `late` is the error of the
    /// turn due to the uncertain delay, in radians.
    fn correct_turn(&mut self, seen: f64, made: Totals, late: f64) {
        let Totals { turned, way, .. } = made;
        let noise = NOISE * NOISE;
        let tracks = (TURN_SLIP * turned + VEER * way).powi(2) + late * late + noise;
        let camera = (SEEN_TURN * turned + PASSING * way).powi(2) + noise;
        let off = seen - made.turn;
        if off.abs() > OUTLIER * (tracks + camera).sqrt() {
            return;
        }
        let gain = tracks / (tracks + camera);
        self.pose.heading += gain * off;
        let decrease = gain * (TURN_SLIP - SEEN_TURN) * turned;
        self.pose.heading_error = (self.pose.heading_error - decrease).max(0.0);
    }

    /// Takes back the motion since `since`, because the robot has stood since then although its
    /// tracks turned. The heading is kept.
    pub(crate) fn rewind(&mut self, since: Instant) {
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
