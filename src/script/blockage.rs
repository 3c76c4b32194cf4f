//! Detects a blocked robot, whose tracks turn but which does not move, from the pictures that
//! arrive during a timed motion of the script. In doubt it reports nothing: a missed blockage is
//! better than a false one.
//!
//! There are three kinds of evidence: tiles of the picture that should have changed and did not;
//! outlines that did not change (this works for fainter structure and for near objects); and, where
//! the picture shows only a plain surface, the distance that the tracks have covered. That distance
//! counts from when the foot of the object ahead left the picture (also in curves and towards
//! slanted walls, see `wall_ahead`), or from when its last stripes and edges did, whose growth told
//! how near they were. A robot that was blocked and has only turned since is still at the same
//! obstacle (`last_obstacle`). The detection relies on the height of the lens above the floor, on
//! the camera being level, on the field of view and on the calibration of the tracks; it does not
//! rely on how the simulated camera draws.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use super::last_obstacle::LastObstacle;
use super::timed_motion::TimedMotion;
use super::wall_ahead::WallAhead;
use crate::robot::MotionId;
use crate::vision::{
    Approach, Camera, Drive, HalfLuma, Image, Looming, Profiles, Verdict, compare_half_luma,
    compare_profiles, foot_ahead, looming_distance, nearer_than, swayed,
};

/// Pictures from the first part of a motion, of this length, are not used: the robot is still
/// accelerating, and pictures arrive late.
const SETTLING: Duration = Duration::from_millis(300);
/// Least and most time between two pictures that are compared.
const APART: (Duration, Duration) = (Duration::from_millis(190), Duration::from_millis(450));
/// Most time between two pictures if the first comparison is inconclusive: a slow robot changes
/// little in less time.
const FARTHER_APART: Duration = Duration::from_millis(750);
/// The robot must have stood for this long, in at least this many pictures. Fewer pictures are
/// needed within [`AT_FIRST`] of the beginning of a motion, when it may have been blocked from the
/// start.
const STOOD: Duration = Duration::from_millis(500);
const PICTURES: u32 = 4;
const PICTURES_AT_FIRST: u32 = 3;
const AT_FIRST: Duration = Duration::from_millis(1200);
/// The evidence is dropped if the last picture that showed the robot standing is older than this.
const FORGOTTEN: Duration = Duration::from_millis(500);
/// Below this turn rate, in radians a second, the robot will meet what it sees ahead.
const STRAIGHT: f64 = 0.06;
/// A picture that shows floor suspends the state of being close; more than this many of them in a
/// row end it.
const FLICKER: u32 = 4;
/// In a curve, a near object is still ahead if the robot would have turned by less than this since,
/// in radians.
const BEND: f64 = 1.2;
/// Least distance to a near object that is assumed, in metres, however far the tracks have run
/// since.
const NEAREST: f64 = 0.3;
/// Least distance in metres from the lens to an object whose foot has just left the picture;
/// smaller results are mistakes.
const LEAST_ROOM: f64 = 0.15;
/// Metres by which an object may be farther away than its growth says.
const MARGIN: f64 = 0.02;
/// If the distances from the foot and from the growth of the object ahead differ by more than this,
/// in metres, one of them is wrong.
const DISAGREE: f64 = 0.15;
/// Unequal tracks shift the picture by up to `VEER` half-size pixels between two pictures; and a
/// commanded turn may shift it up to `PARALLAX` times as far as computed, since the lens is in
/// front of the robot's centre.
const VEER: f64 = 6.0;
const PARALLAX: f64 = 1.4;
/// Largest number of pictures that are kept.
const MAX_VIEWS: usize = 16;

/// See the module documentation.
#[derive(Debug, Default)]
pub(super) struct Blockage {
    motion: Option<MotionId>,
    views: VecDeque<View>,
    /// Set while the pictures show that the robot stands.
    standing: Option<Standing>,
    /// Set while the robot is close to a plain surface; see [`Close`].
    close: Option<Close>,
    approach: Approach,
    looming: Looming,
    wall: WallAhead,
    last_obstacle: LastObstacle,
    /// Buffers of a dropped picture, for reuse.
    spare: Option<(HalfLuma, Profiles)>,
}

/// The evidence of the pictures that the robot stands.
#[derive(Debug, Clone, Copy)]
struct Standing {
    since: Instant,
    /// When a picture last showed it.
    last: Instant,
    /// Number of pictures that showed it.
    pictures: u32,
}

/// A picture that later ones are compared with.
#[derive(Debug)]
struct View {
    at: Instant,
    odometer: f64,
    half_luma: HalfLuma,
    profiles: Profiles,
}

/// The robot is so close to a plain surface that the pictures no longer show anything. Then only
/// the distance covered by its tracks tells when it must have arrived.
#[derive(Debug, Clone, Copy)]
struct Close {
    /// When it came close, and the odometer then, in metres.
    at: Instant,
    odometer: f64,
    /// Upper bound of the distance to the surface at that time, in metres.
    room: f64,
    /// The same, ignoring the measurement from its foot.
    farthest: f64,
    /// `room` comes from the measurement of how the foot moved down in the picture.
    measured: bool,
    /// Odometer reading at arrival, estimated from how the object ahead grew.
    arrival: Option<f64>,
    /// Number of pictures in a row that may show floor again.
    floor: u32,
}

impl Blockage {
    /// Processes a picture that was taken `at`, during the motion in `timed`. Returns since when
    /// the robot has been blocked, if it is.
    pub(super) fn look(
        &mut self,
        image: &Image,
        at: Instant,
        camera: Camera,
        timed: TimedMotion,
    ) -> Option<Instant> {
        if self.motion != Some(timed.motion) {
            self.motion = Some(timed.motion);
            self.views.clear();
            (self.standing, self.close) = (None, None);
            self.approach = Approach::default();
            self.looming = Looming::default();
            self.wall = WallAhead::default();
            self.last_obstacle.begin(at, timed);
        }
        self.wall.drive_on(timed.odometer, timed.drive);
        let (mut half_luma, mut profiles) = self.spare.take().unwrap_or_default();
        half_luma.take(image);
        profiles.take(&half_luma);
        let settled = at >= timed.since + SETTLING;
        match foot_ahead(&half_luma) {
            Some(rows) if settled => self.approach.note(timed.odometer, rows),
            _ => {}
        }
        self.note_close(nearer_than(&half_luma, camera), at, timed);
        if settled && timed.drive.forward > 0.0 {
            self.wall.look(&half_luma, camera, self.close.is_some());
        }
        if !settled {
            self.spare = Some((half_luma, profiles));
            return None;
        }
        let now = View {
            at,
            odometer: timed.odometer,
            half_luma,
            profiles,
        };
        self.note_looming(&now, camera, timed);
        let (verdict, then) = self.compare(&now, camera, timed.drive);
        self.note(verdict, then, at);
        self.add_view(now);
        let close = self.close.is_some_and(|close| close.floor == 0);
        let again = self.last_obstacle.look(at, verdict, close, timed);
        let blocked_since = self
            .stood(at, timed.since)
            .or_else(|| self.arrived(timed))
            .or_else(|| self.in_wall(at, timed.drive, verdict))
            .or(again);
        let may_be_blocked = blocked_since.is_some() || self.standing.is_some();
        self.last_obstacle.note(may_be_blocked, at, timed);
        blocked_since
    }

    /// Since when the robot has stood, if enough pictures show it. The motion began at `began`.
    fn stood(&self, at: Instant, began: Instant) -> Option<Instant> {
        let fewest = if at < began + AT_FIRST {
            PICTURES_AT_FIRST
        } else {
            PICTURES
        };
        let standing = self.standing?;
        let long = at.saturating_duration_since(standing.since) >= STOOD;
        (long && standing.pictures >= fewest).then_some(standing.since)
    }

    /// Forgets the last obstacle: the robot or the obstacle may have been moved.
    pub(super) fn forget(&mut self) {
        self.last_obstacle.forget();
    }

    /// Compares this picture with an earlier one; returns the verdict and when the earlier one was
    /// taken.
    fn compare(&self, now: &View, camera: Camera, drive: Drive) -> (Verdict, Option<Instant>) {
        let compared = |before: &View| {
            let verdict = self.compare_two(before, now, camera, drive);
            (verdict, Some(before.at))
        };
        let near = self.before(now.at, APART.1).map(&compared);
        match near {
            Some((Verdict::Unknown, _)) | None => {}
            Some(near) => return near,
        }
        // The robot may have driven for only a part of that time, so this comparison cannot prove a
        // movement.
        let straight = drive.turn.abs() < STRAIGHT;
        let far = self
            .before(now.at, FARTHER_APART)
            .filter(|_| straight)
            .map(compared);
        far.filter(|(verdict, _)| *verdict == Verdict::Stands)
            .unwrap_or((Verdict::Unknown, None))
    }

    fn compare_two(&self, before: &View, now: &View, camera: Camera, drive: Drive) -> Verdict {
        let apart = now.at - before.at;
        let turned = turned(now, camera, drive, apart);
        let (least, most) = (
            turned.min(0.0) * PARALLAX - VEER,
            turned.max(0.0) * PARALLAX + VEER,
        );
        let sway = swayed(
            &before.profiles,
            &now.profiles,
            least as isize,
            most as isize,
        );
        match compare_half_luma(
            &before.half_luma,
            &now.half_luma,
            camera,
            drive,
            apart,
            sway,
        ) {
            Verdict::Unknown if drive.forward > 0.0 && self.wall.is_away() => Verdict::Unknown,
            Verdict::Unknown => {
                let ahead = self
                    .close
                    .map(|close| (close.odometer + close.room - before.odometer).max(NEAREST));
                compare_profiles(&before.profiles, &now.profiles, camera, drive, apart, ahead)
            }
            verdict => verdict,
        }
    }

    fn add_view(&mut self, now: View) {
        let old = |view: &View| view.at + FARTHER_APART < now.at;
        while self.views.len() >= MAX_VIEWS || self.views.front().is_some_and(old) {
            let oldest = self.views.pop_front();
            self.spare = oldest.map(|view| (view.half_luma, view.profiles));
        }
        self.views.push_back(now);
    }

    /// Estimates from the growth of the near object where the robot will reach it.
    fn note_looming(&mut self, now: &View, camera: Camera, timed: TimedMotion) {
        let Some(close) = self.close else {
            self.looming = Looming::default();
            return;
        };
        let seen = self.before(now.at, FARTHER_APART).and_then(|before| {
            let way = now.odometer - before.odometer;
            let turned = turned(now, camera, timed.drive, now.at - before.at);
            looming_distance(
                before.profiles.horizon(),
                now.profiles.horizon(),
                way,
                turned,
            )
        });
        if let Some(distance) = seen {
            self.looming.note(now.odometer, distance);
        }
        if let Some(arrival) = self.looming.arrival() {
            self.close = Some(Close {
                arrival: Some(arrival + MARGIN),
                ..close
            });
        }
    }

    fn note_close(&mut self, nearer_than: Option<f64>, at: Instant, timed: TimedMotion) {
        let measured = self.room(timed.odometer);
        self.close = match (nearer_than, self.close) {
            (Some(room), None) if timed.drive.forward > 0.0 => Some(Close {
                at,
                odometer: timed.odometer,
                farthest: room,
                room: measured.map_or(room, |seen| room.min(seen)),
                measured: measured.is_some_and(|seen| seen < room),
                arrival: None,
                floor: 0,
            }),
            (Some(_), Some(close)) => Some(Close { floor: 0, ..close }),
            (None, Some(close)) if close.floor < FLICKER => Some(Close {
                floor: close.floor + 1,
                ..close
            }),
            _ => None,
        };
    }

    /// Metres to the object ahead, measured while the robot approached it.
    fn room(&self, odometer: f64) -> Option<f64> {
        let room = self.approach.arrival()? - odometer;
        (room > LEAST_ROOM).then_some(room)
    }

    /// When the robot reached the near object, if its tracks have covered that distance. The
    /// distance is measured from the lens, which is behind the front of the robot, so by then the
    /// front must have arrived.
    fn arrived(&self, timed: TimedMotion) -> Option<Instant> {
        let straight = timed.drive.turn.abs() < STRAIGHT;
        let close = self.close.filter(|close| close.floor == 0)?;
        let way = timed.odometer - close.odometer;
        let seconds = |way: f64| way / timed.drive.forward.max(0.01);
        let ahead = if straight {
            Some(close.room)
        } else {
            // No floor was seen ahead during the whole curve, and the measurement from the foot
            // does not hold there.
            ((seconds(way) * timed.drive.turn).abs() < BEND).then_some(close.farthest)
        };
        let grown = close.arrival.map(|arrival| arrival - close.odometer);
        let room = match (grown, ahead) {
            (Some(grown), Some(foot)) if close.measured && (grown - foot).abs() > DISAGREE => {
                grown.max(foot)
            }
            (Some(grown), Some(foot)) => grown.min(foot),
            (grown, foot) => grown.or(foot)?,
        };
        let after = || Duration::try_from_secs_f64(seconds(room)).unwrap_or_default();
        (way > room).then(|| close.at + after())
    }

    /// Since when the robot would be inside the wall that it saw before it came close, unless the
    /// pictures show that it moves.
    fn in_wall(&self, at: Instant, drive: Drive, verdict: Verdict) -> Option<Instant> {
        self.close.filter(|close| close.floor == 0)?;
        let pushed = self.wall.pushed_for(drive)?;
        (verdict != Verdict::Moves).then(|| at - pushed)
    }

    /// The oldest picture that is neither too old nor too recent for a comparison.
    fn before(&self, at: Instant, most: Duration) -> Option<&View> {
        let apart = |view: &&View| {
            let apart = at.saturating_duration_since(view.at);
            APART.0 <= apart && apart <= most
        };
        self.views.iter().find(apart)
    }

    fn note(&mut self, verdict: Verdict, then: Option<Instant>, at: Instant) {
        let lately = |standing: &Standing| at.saturating_duration_since(standing.last) < FORGOTTEN;
        let standing = self.standing.filter(lately);
        self.standing = match (verdict, standing, then) {
            (Verdict::Stands, None, Some(then)) => Some(Standing {
                since: then,
                last: at,
                pictures: 1,
            }),
            (Verdict::Stands, Some(standing), _) => Some(Standing {
                last: at,
                pictures: standing.pictures + 1,
                ..standing
            }),
            (Verdict::Unknown, standing, _) => standing,
            _ => None,
        };
    }
}

/// By how many half-size pixels to the right this turn shifts distant objects.
fn turned(now: &View, camera: Camera, drive: Drive, apart: Duration) -> f64 {
    camera.focal_length(now.profiles.width()) * drive.turn * apart.as_secs_f64()
}

#[cfg(test)]
mod tests;
