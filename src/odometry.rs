//! The pose of a robot and whether something holds it, from the commands to its tracks and from its
//! camera: dead reckoning, corrected by the turns that the camera sees. Knows nothing of scripts.

mod blockage;
mod tracks;

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::ops::Sub;
use std::time::Duration;

use tokio::time::Instant;

use crate::vision::{Drive, Skyline};

pub(crate) use blockage::{Blockage, TimedMotion};
pub(crate) use tracks::ACCELERATION;

use tracks::Tracks;

/// Slip of the tracks on an unknown floor: metres per metre, radians per radian, and radians by
/// which they veer per metre.
const DISTANCE_SLIP: f64 = 0.1;
const TURN_SLIP: f64 = 0.2;
const VEER: f64 = 0.08;
/// Slip of the tracks in a turn when pictures have long shown how the robot responds: radians per radian.
const KNOWN_TURN_SLIP: f64 = 0.1;
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
/// A turn is steady, and tells the response, if its uncertain delay makes less than this share of it: a weak
/// robot starts to turn later than its tracks are told, and stops earlier.
const STEADY: f64 = 0.1;
/// Bounds of the share of the commanded motion that the robot makes.
const LEAST_RESPONSE: f64 = 0.4;
const MOST_RESPONSE: f64 = 1.2;
/// The weight of the assumption that it makes all of it, and the greatest weight of earlier pictures: the
/// sum of the squares of the turns between pictures, radians squared.
const ASSUMED_WEIGHT: f64 = 0.05;
const MAX_WEIGHT: f64 = 1.0;
/// Motion that is not the script's counts only from this long after the script's own motion,
/// because the report that its own motion has ended arrives as late as this.
const GRACE: Duration = Duration::from_millis(300);
/// Largest number of frames whose poses are kept, and for how long.
const MAX_MARKS: usize = 128;
const OLDEST: Duration = Duration::from_secs(4);

/// The number of delays that are compared, and the step between them: from 0 to 0.4 seconds.
pub(super) const CANDIDATES: usize = 9;
const STEP: Duration = Duration::from_millis(50);
/// A picture is used if the turns that the delays predict differ by at least this, in radians.
const MIN_SPREAD: f64 = 0.01;
/// Largest squared error of one picture that counts, in radians squared, so that an outlier does
/// not dominate for long.
const MAX_SQUARED_ERROR: f64 = 0.05;
/// The weight of earlier pictures is multiplied by this with each picture that is used.
const FADING: f64 = 0.995;
/// Another delay replaces the current one only if its misfit is less than this share of the current
/// misfit.
const BETTER: f64 = 0.9;
const KEPT: Duration = Duration::from_secs(3);
/// Least time between an entry and the next but one, which bounds the number of entries.
const APART: Duration = Duration::from_millis(10);

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

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Driver {
    None,
    Script(Drive),
    /// Another behaviour, the watchdog, or the robot's own search for its station.
    Other,
}

#[derive(Debug)]
pub(crate) struct Odometry {
    pose: Pose,
    at: Instant,
    last_script_motion: Option<Instant>,
    tracks: Tracks,
    response: Response,
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
    marks: VecDeque<(Instant, Pose)>,
}

impl Odometry {
    pub(crate) fn new(now: Instant, full_speed: f64, track_width: f64) -> Odometry {
        Odometry {
            pose: Pose::default(),
            at: now,
            last_script_motion: None,
            tracks: Tracks::new(track_width),
            response: Response::default(),
            odometer: 0.0,
            full_speed,
            travel: Travel::new(now),
            picture_delay: PictureDelay::default(),
            skyline: None,
            marks: VecDeque::new(),
        }
    }

    pub(crate) fn reset(&mut self) {
        self.pose = Pose::default();
        self.marks.clear();
    }

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
        let began = std::mem::replace(&mut self.at, end);
        let wanted = match driver {
            Driver::Script(drive) => {
                self.last_script_motion = Some(end);
                drive
            }
            Driver::None | Driver::Other => Drive::STILL,
        };
        self.run_tracks(wanted, began, end);
        let is_own = |last: Instant| end - last < GRACE;
        if driver == Driver::Other && !self.last_script_motion.is_some_and(is_own) {
            let seconds = (end - began).as_secs_f64();
            self.pose.error += self.full_speed * seconds;
            self.pose
                .increase_heading_error(FOREIGN_TURN_RATE * seconds);
        }
    }

    fn run_tracks(&mut self, wanted: Drive, began: Instant, end: Instant) {
        let mut passed = 0.0;
        let parts = self.tracks.run(wanted, (end - began).as_secs_f64());
        let response = self.response.share();
        for part in parts.into_iter().filter(|part| part.seconds > 0.0) {
            let (way, turn) = (response * part.way, response * part.turn);
            self.odometer += way;
            self.pose = self.pose.after(way, turn);
            self.pose
                .increase_heading_error(TURN_SLIP * turn.abs() + VEER * way.abs());
            passed += part.seconds;
            let at = began + Duration::try_from_secs_f64(passed).unwrap_or_default();
            self.travel.add(at.min(end), turn, way);
        }
    }

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
    fn motions(&self, before: Instant, now: Instant) -> [Totals; CANDIDATES] {
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
        let tracks = |slip: f64| (slip * turned + VEER * way).powi(2) + late * late + noise;
        let camera = (SEEN_TURN * turned + PASSING * way).powi(2) + noise;
        let off = seen - made.turn;
        let at_most = tracks(TURN_SLIP);
        if off.abs() > OUTLIER * (at_most + camera).sqrt() {
            return;
        }
        if late < STEADY * turned {
            let only_turned = (SEEN_TURN * turned).powi(2) / camera;
            self.response.note(seen, made.turn, only_turned);
        }
        let likely = tracks(self.response.slip());
        self.pose.heading += likely / (likely + camera) * off;
        let decrease = at_most / (at_most + camera) * (TURN_SLIP - SEEN_TURN) * turned;
        self.pose.heading_error = (self.pose.heading_error - decrease).max(0.0);
    }

    /// Takes back the motion since `since`, because the robot has stood since then although its
    /// tracks turned. The heading is kept.
    pub(crate) fn rewind(&mut self, since: Instant) {
        let before = self.marks.iter().rev().find(|(at, _)| *at <= since);
        if let Some((_, stood)) = before {
            let heading = self.pose.heading;
            self.pose = Pose { heading, ..*stood };
            self.tracks.stop();
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

/// Which share of the commanded motion the robot makes, from the turns that the camera has seen: a low battery
/// and a soft floor slow down turns and ways alike.
#[derive(Debug, Clone, Copy)]
struct Response {
    /// Sums over the pictures, in radians squared, the newest with the full weight: of the turns seen times
    /// the turns commanded, and of the squares of the turns commanded.
    seen: f64,
    commanded: f64,
}

impl Default for Response {
    fn default() -> Response {
        Response {
            seen: ASSUMED_WEIGHT,
            commanded: ASSUMED_WEIGHT,
        }
    }
}

impl Response {
    fn share(self) -> f64 {
        (self.seen / self.commanded).clamp(LEAST_RESPONSE, MOST_RESPONSE)
    }

    /// Slip of the tracks in a turn, radians per radian: the less, the more pictures have shown the response.
    fn slip(self) -> f64 {
        KNOWN_TURN_SLIP + (TURN_SLIP - KNOWN_TURN_SLIP) * ASSUMED_WEIGHT / self.commanded
    }

    /// Records the turn that two frames show and the turn that was expected with the present response, in
    /// radians; `weight` is from 0 to 1.
    fn note(&mut self, seen: f64, expected: f64, weight: f64) {
        let commanded = expected / self.share();
        let square = weight * commanded * commanded;
        let kept = 1.0 - (square / MAX_WEIGHT).min(1.0);
        self.seen = kept * self.seen + weight * seen * commanded;
        self.commanded = kept * self.commanded + square;
    }
}

/// How well each delay fits the pictures so far.
#[derive(Debug, Default)]
pub(super) struct PictureDelay {
    misfits: [f64; CANDIDATES],
    selected: usize,
}

impl PictureDelay {
    pub(super) fn candidates() -> [Duration; CANDIDATES] {
        std::array::from_fn(|step| STEP * step as u32)
    }

    pub(super) fn selected(&self) -> usize {
        self.selected
    }

    /// Records the turn that two frames show and the turn that each delay predicts; all in radians.
    pub(super) fn note(&mut self, seen: f64, expected: &[f64; CANDIDATES]) {
        let largest = expected.iter().copied().fold(f64::MIN, f64::max);
        let smallest = expected.iter().copied().fold(f64::MAX, f64::min);
        if largest - smallest < MIN_SPREAD {
            return;
        }
        for (misfit, turn) in self.misfits.iter_mut().zip(expected) {
            *misfit = *misfit * FADING + (seen - turn).powi(2).min(MAX_SQUARED_ERROR);
        }
        let best = (0..CANDIDATES).min_by(|one, other| {
            let misfit = |index: usize| self.misfits[index];
            misfit(*one).total_cmp(&misfit(*other))
        });
        self.selected = best
            .filter(|best| self.misfits[*best] < BETTER * self.misfits[self.selected])
            .unwrap_or(self.selected);
    }
}

#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Totals {
    /// Radians to the left; turns to the right count as negative.
    pub(super) turn: f64,
    /// Radians to either side.
    pub(super) turned: f64,
    /// Metres, forwards or backwards.
    pub(super) way: f64,
}

#[derive(Debug)]
pub(super) struct Travel {
    /// The oldest first; never empty.
    totals: VecDeque<(Instant, Totals)>,
}

impl Travel {
    pub(super) fn new(now: Instant) -> Travel {
        Travel {
            totals: VecDeque::from([(now, Totals::default())]),
        }
    }

    /// Adds the motion since the last entry, at a constant rate until `now`: the turn in radians and
    /// the distance in metres.
    pub(super) fn add(&mut self, now: Instant, turn: f64, way: f64) {
        let last = self.totals.back().map(|(_, totals)| *totals);
        let last = last.unwrap_or_default();
        let sum = Totals {
            turn: last.turn + turn,
            turned: last.turned + turn.abs(),
            way: last.way + way.abs(),
        };
        let count = self.totals.len();
        let close = |(at, _): &(Instant, Totals)| *at + APART > now;
        if count >= 2 && self.totals.get(count - 2).is_some_and(close) {
            self.totals.pop_back();
        }
        self.totals.push_back((now, sum));
        while self.totals.get(1).is_some_and(|(at, _)| *at + KEPT < now) {
            self.totals.pop_front();
        }
    }

    /// The motion between two times; `None` if the first is too long ago.
    pub(super) fn between(&self, from: Instant, to: Instant) -> Option<Totals> {
        Some(self.until(to)? - self.until(from)?)
    }

    fn until(&self, time: Instant) -> Option<Totals> {
        let later = self.totals.partition_point(|(at, _)| *at < time);
        let Some((end, after)) = self.totals.get(later) else {
            return self.totals.back().map(|(_, totals)| *totals);
        };
        if *end == time {
            return Some(*after);
        }
        let (begin, before) = self.totals.get(later.checked_sub(1)?)?;
        let part = (time - *begin).as_secs_f64() / (*end - *begin).as_secs_f64();
        let between = |before: f64, after: f64| before + (after - before) * part;
        Some(Totals {
            turn: between(before.turn, after.turn),
            turned: between(before.turned, after.turned),
            way: between(before.way, after.way),
        })
    }
}

impl Sub for Totals {
    type Output = Totals;

    fn sub(self, before: Totals) -> Totals {
        Totals {
            turn: self.turn - before.turn,
            turned: self.turned - before.turned,
            way: self.way - before.way,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, TAU};

    use image::{Rgb, RgbImage};

    use super::*;
    use crate::vision::{Camera, Image, Size, SkylineReader};

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
        (Odometry::new(now, 0.45, 0.24), now)
    }

    fn near(one: f64, other: f64) -> bool {
        (one - other).abs() < 1e-6
    }

    fn drive(odometry: &mut Odometry, now: &mut Instant, driver: Driver, seconds: u32) {
        for _ in 0..seconds * 100 {
            *now += Duration::from_millis(10);
            odometry.advance(*now, driver);
        }
    }

    #[test]
    fn a_line_a_turn_and_an_arc_end_where_geometry_says() {
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
            drive(&mut odometry, &mut now, Driver::None, 1);
            let pose = odometry.pose();
            assert!((pose.x - x).hypot(pose.y - y) < 0.02, "{pose:?}");
        }
        assert!(near(odometry.pose().heading, PI));
        odometry.reset();
        assert_eq!(odometry.pose(), Pose::default());
    }

    #[test]
    fn the_error_grows_with_the_distance_and_less_if_the_camera_saw_the_turn() {
        let (mut odometry, start) = odometry();
        odometry.advance(start + Duration::from_secs(1), AHEAD);
        let straight = odometry.pose();
        assert!(straight.error > 0.0 && straight.heading_error > 0.0);
        odometry.advance(start + Duration::from_secs(2), LEFT);
        let unseen = odometry.pose();
        odometry.correct_turn(1.4 / PARALLAX, turn(FRAC_PI_2), 0.0);
        let seen = odometry.pose();
        assert!(
            seen.heading < unseen.heading && seen.heading_error < unseen.heading_error,
            "{seen:?}"
        );
    }

    #[test]
    fn what_near_things_seem_to_turn_counts_no_more_than_what_the_tracks_do() {
        let (mut odometry, start) = odometry();
        odometry.advance(start + Duration::from_secs(1), LEFT);
        let mut correct = |seen: f64| {
            let before = odometry.pose().heading;
            odometry.correct_turn(seen * FRAC_PI_2, turn(FRAC_PI_2), 0.0);
            (odometry.pose().heading - before) / FRAC_PI_2
        };
        assert_eq!(correct(1.0), 0.0);
        let correction = correct(1.3);
        assert!((0.1..0.17).contains(&correction), "{correction}");
    }

    fn turn(radians: f64) -> Totals {
        Totals {
            turn: radians,
            turned: radians.abs(),
            way: 0.0,
        }
    }

    /// The view of a camera in a round room that is turned to the left by this many radians.
    fn room(turned: f64) -> Skyline {
        let camera = Camera::default();
        let size = Size {
            width: 160,
            height: 120,
        };
        let picture = RgbImage::from_fn(160, 120, |x, _| {
            let angle = turned + camera.bearing(f64::from(x), 52.0, size);
            let value = 120.0
                + 50.0 * (angle * 3.0).sin()
                + 40.0 * (angle * 7.0).sin()
                + 20.0 * (angle * 17.0).cos();
            Rgb([value as u8; 3])
        });
        SkylineReader::new(camera).read(&Image::from_rgb(&picture))
    }

    #[test]
    fn turns_that_pictures_show_late_are_neither_lost_nor_counted_twice() {
        let (mut odometry, start) = odometry();
        let mut turned = 0.0;
        let mut shown = VecDeque::from([0.0; 20]);
        for tick in 0..800 {
            let now = start + Duration::from_millis(10) * (tick + 1);
            let turn = if tick % 200 < 100 { 1.5 } else { 0.0 };
            let forward = if turn == 0.0 { 0.2 } else { 0.0 };
            odometry.advance(now, Driver::Script(Drive { forward, turn }));
            // The tracks slip by a tenth, and pictures are 0.2 s late.
            turned += 0.9 * turn * 0.01;
            shown.push_back(turned);
            let seen = shown.pop_front().unwrap_or_default();
            if tick % 12 == 0 {
                odometry.mark(now);
                odometry.look(now, Some(room(seen * PARALLAX)));
            }
        }
        let pose = odometry.pose();
        // The tracks alone say four turns of 1.5 radians.
        assert!((turned - 5.4).abs() < 1e-6, "{turned}");
        assert!((pose.heading - turned).abs() < 0.25, "{pose:?}");
    }

    /// Turns a robot by the commanded angle in small steps, of which it makes this share.
    fn turn_with_response(odometry: &mut Odometry, share: f64, radians: f64) {
        let steps = (radians / 0.1) as u32;
        for _ in 0..steps {
            let expected = 0.1 * odometry.response.share();
            odometry.correct_turn(0.1 * share, turn(expected), 0.0);
        }
    }

    #[test]
    fn a_robot_that_makes_a_share_of_its_turns_makes_that_share_of_its_ways() {
        let (mut odometry, mut now) = odometry();
        turn_with_response(&mut odometry, 0.7, TAU);
        odometry.reset();
        drive(&mut odometry, &mut now, AHEAD, 5);
        drive(&mut odometry, &mut now, Driver::None, 1);
        let way = odometry.pose().x;
        assert!((way - 0.7).abs() < 0.02, "{way}");
        turn_with_response(&mut odometry, 1.0, 6.0 * TAU); // charged
        let share = odometry.response.share();
        assert!((share - 1.0).abs() < 0.02, "{share}");
    }

    #[test]
    fn held_tracks_and_straight_ways_do_not_tell_the_response() {
        let (mut odometry, _) = odometry();
        turn_with_response(&mut odometry, 0.7, TAU);
        let learned = odometry.response.share();
        turn_with_response(&mut odometry, 0.0, TAU);
        for picture in 0..1000 {
            let way = Totals {
                turn: 0.005,
                turned: 0.005,
                way: 0.02,
            };
            let passing = if picture % 2 == 0 { 0.01 } else { 0.0 };
            odometry.correct_turn(passing, way, 0.0);
        }
        let share = odometry.response.share();
        assert!((share - learned).abs() < 0.01, "{learned} {share}");
    }

    /// Pictures that show no turn yet lowered the response to its least; pictures of a whole turn were rejected as
    /// outliers from then on.
    #[test]
    fn how_late_a_turn_begins_does_not_tell_the_response() {
        let (mut odometry, _) = odometry();
        for _ in 0..20 {
            odometry.correct_turn(0.0, turn(0.15), 0.1);
        }
        turn_with_response(&mut odometry, 0.8, TAU);
        let share = odometry.response.share();
        assert!((share - 0.8).abs() < 0.02, "{share}");
    }

    #[test]
    fn a_person_walking_by_is_not_taken_for_a_turn() {
        let (mut odometry, mut now) = odometry();
        drive(&mut odometry, &mut now, AHEAD, 1);
        let straight = Totals {
            turn: 0.0,
            turned: 0.0,
            way: 0.2,
        };
        odometry.correct_turn(0.3, straight, 0.0);
        assert!(near(odometry.pose().heading, 0.0));
    }

    #[test]
    fn motion_by_others_makes_the_place_uncertain_but_late_reports_of_own_motion_do_not() {
        let (mut odometry, start) = odometry();
        odometry.advance(start + Duration::from_secs(1), AHEAD);
        let own = odometry.pose();
        odometry.advance(start + Duration::from_millis(1200), Driver::Other);
        let echo = odometry.pose();
        assert!(
            near(echo.x, 0.2) && echo.error < own.error + 0.01,
            "{echo:?}"
        );
        odometry.advance(start + Duration::from_secs(9), Driver::Other);
        let pose = odometry.pose();
        assert!(pose.error > 1.0 && near(pose.heading_error, PI), "{pose:?}");
        assert!(near(pose.x, echo.x));
    }

    #[test]
    fn a_blocked_robot_has_not_advanced() {
        let (mut odometry, mut now) = odometry();
        let start = now;
        for _ in 0..3 {
            drive(&mut odometry, &mut now, AHEAD, 1);
            odometry.mark(now);
        }
        odometry.rewind(start + Duration::from_secs(2));
        assert!((odometry.pose().x - 0.4).abs() < 0.02);
    }

    /// Radians that a robot has turned by `time` if it alternately turns for a second and stands
    /// for a second.
    fn turned(time: f64) -> f64 {
        let time = time.max(0.0);
        (time / 2.0).floor() + (time % 2.0).min(1.0)
    }

    #[test]
    fn the_delay_of_pictures_is_found_in_two_turns() {
        for (late, found) in [(0.0, 0), (0.1, 2), (0.22, 4), (0.4, 8)] {
            let mut delay = PictureDelay::default();
            for frame in 1..=30 {
                let now = f64::from(frame) / 8.0;
                let turn = |late: f64| turned(now - late) - turned(now - 0.125 - late);
                let expected = PictureDelay::candidates().map(|delay| turn(delay.as_secs_f64()));
                delay.note(0.9 * turn(late), &expected);
            }
            assert_eq!(delay.selected(), found, "{late} s");
        }
    }

    #[test]
    fn constant_predictions_are_not_used() {
        let mut delay = PictureDelay::default();
        for seen in [0.3, -0.2, 0.0] {
            delay.note(seen, &[0.1; CANDIDATES]);
        }
        assert_eq!(delay.misfits, [0.0; CANDIDATES]);
    }

    #[test]
    fn the_motion_between_two_times_is_known_for_a_while_in_little_memory() {
        let start = Instant::now();
        let mut travel = Travel::new(start);
        for millis in 1..=10_000 {
            travel.add(start + Duration::from_millis(millis), 0.001, -0.002);
        }
        let at = |millis| start + Duration::from_millis(millis);
        let Some(done) = travel.between(at(9_205), at(9_709)) else {
            panic!("too long ago");
        };
        assert!((done.turn - 0.504).abs() < 1e-6 && (done.way - 1.008).abs() < 1e-6);
        assert_eq!(travel.between(at(5_000), at(9_000)), None);
        assert!(travel.totals.len() < 700, "{}", travel.totals.len());
    }
}
