//! Detects a blocked robot, whose tracks turn but which does not move, from what should have
//! changed in the pictures of a timed motion and did not. In doubt it reports nothing. Close to
//! something plain nothing could change: then the tracks tell, once they have covered more than the
//! distance that was left when the last floor left the picture ([`Approach`]).

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::MotionId;
use crate::vision::{Camera, Drive, Image, Profiles, Verdict, compare_profiles};

/// Pictures from the first part of a motion, of this length, are not used: the robot is still
/// accelerating, and pictures arrive late.
const SETTLING: Duration = Duration::from_millis(300);
/// Least and most time between two pictures that are compared.
const APART: (Duration, Duration) = (Duration::from_millis(190), Duration::from_millis(450));
/// Most time between two pictures if the first comparison is inconclusive: a slow robot changes
/// little in less time.
const FARTHER_APART: Duration = Duration::from_millis(750);
/// The robot must have stood for this long, in at least this many pictures; the evidence is dropped
/// if none has shown it for as long.
const STOOD: Duration = Duration::from_millis(500);
const PICTURES: u32 = 4;
/// Below this turn rate, in radians a second, the robot will meet what it sees ahead.
const STRAIGHT: f64 = 0.06;
/// In a curve, a near object is still ahead if the robot would have turned by less than this since,
/// in radians.
const BEND: f64 = 1.2;
/// A picture that shows floor suspends the state of being close; more than this many of them in a
/// row end it.
const FLICKER: u32 = 4;
/// Least distance to a near object that is assumed, in metres, however far the tracks have run
/// since.
const NEAREST: f64 = 0.3;
/// Least distance in metres from the lens to an object whose foot has just left the picture;
/// smaller results are mistakes.
const LEAST_ROOM: f64 = 0.15;
const MAX_VIEWS: usize = 16;

/// Most pictures of an approach that are kept, and the least number and least distance driven (in
/// metres) for a result.
const MAX_SEEN: usize = 24;
const FEWEST_SEEN: usize = 5;
const SHORTEST: f64 = 0.08;
/// From one picture to the next, the inverse of a foot's rows falls by less than this share and
/// does not rise by more than that; otherwise it is another foot.
const SAME_FOOT: std::ops::RangeInclusive<f64> = 0.7..=1.05;
/// The square of the correlation with the distance driven must be greater than this.
const FITS: f64 = 0.95;

#[derive(Debug, Clone, Copy)]
pub(crate) struct TimedMotion {
    pub(crate) motion: MotionId,
    pub(crate) since: Instant,
    pub(crate) drive: Drive,
    /// Metres that the script's tracks have covered so far; backward motion counts as negative.
    pub(crate) odometer: f64,
}

#[derive(Debug, Default)]
pub(crate) struct Blockage {
    motion: Option<MotionId>,
    views: VecDeque<View>,
    standing: Option<Standing>,
    close: Option<Close>,
    approach: Approach,
    /// Buffers of a dropped picture, for reuse.
    spare: Option<Profiles>,
}

#[derive(Debug, Clone, Copy)]
struct Standing {
    since: Instant,
    last: Instant,
    pictures: u32,
}

#[derive(Debug)]
struct View {
    at: Instant,
    odometer: f64,
    profiles: Profiles,
}

#[derive(Debug, Clone, Copy)]
struct Close {
    /// When it began to, and the odometer then, in metres.
    at: Instant,
    odometer: f64,
    /// The distance to the surface at that time, in metres, and its upper bound.
    room: f64,
    farthest: f64,
    /// Number of pictures in a row that may show floor again.
    floor: u32,
}

impl Blockage {
    /// Processes a picture that was taken `at`, during the motion in `timed`. Returns since when
    /// the robot has been blocked, if it is.
    pub(crate) fn look(
        &mut self,
        image: &Image,
        at: Instant,
        camera: Camera,
        timed: TimedMotion,
    ) -> Option<Instant> {
        if self.motion != Some(timed.motion) {
            self.motion = Some(timed.motion);
            self.views.clear();
            self.standing = None;
            self.close = None;
            self.approach = Approach::default();
        }
        let mut profiles = self.spare.take().unwrap_or_default();
        profiles.take(image, camera);
        let is_settled = at >= timed.since + SETTLING;
        if is_settled && let Some(rows) = profiles.foot_ahead() {
            self.approach.note(timed.odometer, rows);
        }
        self.note_close(profiles.nearer_than(camera), at, camera, timed);
        if !is_settled {
            self.spare = Some(profiles);
            return None;
        }
        let now = View {
            at,
            odometer: timed.odometer,
            profiles,
        };
        let (verdict, before) = self.compare(&now, camera, timed.drive);
        self.note(verdict, before, at);
        self.add_view(now);
        self.stood(at).or_else(|| self.arrived(timed))
    }

    fn stood(&self, at: Instant) -> Option<Instant> {
        let standing = self.standing?;
        let is_long = at.saturating_duration_since(standing.since) >= STOOD;
        (is_long && standing.pictures >= PICTURES).then_some(standing.since)
    }

    /// Compares this picture with an earlier one; returns the verdict and when the earlier one was
    /// taken.
    fn compare(&self, now: &View, camera: Camera, drive: Drive) -> (Verdict, Instant) {
        let near = self.compare_with(self.before(now.at, APART.1), now, camera, drive);
        if near.0 != Verdict::Unknown || drive.forward == 0.0 {
            return near;
        }
        // The robot may have driven for only a part of that time, so this comparison cannot prove a
        // movement.
        let far = self.compare_with(self.before(now.at, FARTHER_APART), now, camera, drive);
        if far.0 == Verdict::Stands { far } else { near }
    }

    fn compare_with(
        &self,
        before: Option<&View>,
        now: &View,
        camera: Camera,
        drive: Drive,
    ) -> (Verdict, Instant) {
        let Some(before) = before else {
            return (Verdict::Unknown, now.at);
        };
        let ahead = self
            .close
            .map(|close| (close.odometer + close.room - before.odometer).max(NEAREST));
        let verdict = compare_profiles(
            &before.profiles,
            &now.profiles,
            camera,
            drive,
            now.at - before.at,
            ahead,
        );
        (verdict, before.at)
    }

    /// The oldest picture that is neither too old nor too recent for a comparison.
    fn before(&self, at: Instant, most: Duration) -> Option<&View> {
        self.views.iter().find(|view| {
            let apart = at.saturating_duration_since(view.at);
            APART.0 <= apart && apart <= most
        })
    }

    fn add_view(&mut self, now: View) {
        let is_old = |view: &View| view.at + FARTHER_APART < now.at;
        while self.views.len() >= MAX_VIEWS || self.views.front().is_some_and(is_old) {
            self.spare = self.views.pop_front().map(|view| view.profiles);
        }
        self.views.push_back(now);
    }

    fn note(&mut self, verdict: Verdict, before: Instant, at: Instant) {
        let is_recent = |standing: &Standing| at.saturating_duration_since(standing.last) < STOOD;
        let standing = self.standing.filter(is_recent);
        self.standing = match verdict {
            Verdict::Unknown => standing,
            Verdict::Moves => None,
            Verdict::Stands => Some(Standing {
                since: standing.map_or(before, |standing| standing.since),
                last: at,
                pictures: standing.map_or(0, |standing| standing.pictures) + 1,
            }),
        };
    }

    fn note_close(
        &mut self,
        nearer_than: Option<f64>,
        at: Instant,
        camera: Camera,
        timed: TimedMotion,
    ) {
        let arrival = self.approach.arrival();
        // A foot whose rows are infinite is in the plane of the lens, which a pitch leans.
        let lean = camera.height * camera.pitch.to_radians().tan();
        let room = arrival.map(|arrival| arrival - timed.odometer + lean);
        let room = room.filter(|room| *room > LEAST_ROOM);
        self.close = match (nearer_than, self.close) {
            (Some(farthest), None) if timed.drive.forward > 0.0 => Some(Close {
                at,
                odometer: timed.odometer,
                room: room.map_or(farthest, |room| room.min(farthest)),
                farthest,
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

    /// When the robot reached the near surface, if its tracks have covered that distance. The
    /// distance is measured from the lens, which is behind the front of the robot, so by then the
    /// front must have arrived.
    fn arrived(&self, timed: TimedMotion) -> Option<Instant> {
        let close = self.close.filter(|close| close.floor == 0)?;
        let way = timed.odometer - close.odometer;
        let seconds = |way: f64| way / timed.drive.forward.max(0.01);
        let is_straight = timed.drive.turn.abs() < STRAIGHT;
        let is_ahead = is_straight || (seconds(way) * timed.drive.turn).abs() < BEND;
        // The measurement does not hold in a curve.
        let room = if is_straight {
            close.room
        } else {
            close.farthest
        };
        if way <= room || !is_ahead {
            return None;
        }
        let after = Duration::try_from_secs_f64(seconds(room)).unwrap_or_default();
        Some(close.at + after)
    }
}

/// Measures the distance to what is ahead from how fast its foot moves down in the picture while the robot drives towards it. Depends neither on the height of the lens nor on whether the foot is that of the wall or the edge of a skirting board.
#[derive(Debug, Clone, Default)]
pub(super) struct Approach {
    /// Odometer readings in metres, each with the inverse of the rows below the horizon.
    seen: VecDeque<(f64, f64)>,
}

impl Approach {
    /// Adds a foot seen this many rows below the horizon at this odometer reading.
    pub(super) fn note(&mut self, odometer: f64, rows: f64) {
        let inverse = 1.0 / rows.max(1.0);
        let last = self.seen.back().map(|(_, last)| *last);
        if last.is_none_or(|last| !SAME_FOOT.contains(&(inverse / last))) {
            self.seen.clear();
        }
        if self.seen.len() == MAX_SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back((odometer, inverse));
    }

    /// The odometer reading at which the lens is at the foot, metres; `None` while it is uncertain.
    pub(super) fn arrival(&self) -> Option<f64> {
        let first = self.seen.front()?;
        let last = self.seen.back()?;
        if self.seen.len() < FEWEST_SEEN || last.0 - first.0 < SHORTEST {
            return None;
        }
        let count = self.seen.len() as f64;
        let x = self.seen.iter().map(|(x, _)| x).sum::<f64>() / count;
        let y = self.seen.iter().map(|(_, y)| y).sum::<f64>() / count;
        let mut xx = 0.0;
        let mut xy = 0.0;
        let mut yy = 0.0;
        for (one, other) in &self.seen {
            xx += (one - x).powi(2);
            xy += (one - x) * (other - y);
            yy += (other - y).powi(2);
        }
        // The line falls and fits well; where it reaches zero, the foot is below the lens.
        (xy < 0.0 && xy * xy > FITS * xx * yy).then(|| x - y * xx / xy)
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    const AHEAD: Drive = Drive {
        forward: 0.2,
        turn: 0.0,
    };
    const GENTLE: Drive = Drive {
        forward: 0.2,
        turn: 0.2,
    };
    const SHARP: Drive = Drive {
        forward: 0.2,
        turn: 1.0,
    };

    /// The view of a wall this many metres ahead, with a stripe every `every` metres.
    fn wall(far: f64, every: f64, noise: u32) -> Image {
        let focal = Camera::default().focal_length(320);
        let picture = RgbImage::from_fn(320, 240, |column, row| {
            let x = (f64::from(column) - 159.5) * far / focal;
            let is_dark = (x / every + 100.5).rem_euclid(2.0) < 1.0;
            let mixed = (column * 37 + row * 101 + noise * 7919).wrapping_mul(0x2C1B_3C6D) >> 24;
            Rgb([(if is_dark { 140 } else { 148 } + mixed % 5) as u8; 3])
        });
        Image::from_rgb(&picture)
    }

    /// Drives at `drive` for five seconds; `far` is the distance of the wall, in metres, after so
    /// many metres of the tracks. Returns after how many seconds the blockage is reported.
    fn reported(drive: Drive, every: f64, far: impl Fn(f64) -> f64) -> Option<f64> {
        let mut blockage = Blockage::default();
        let start = Instant::now();
        (0..50).find_map(|number| {
            let passed = Duration::from_millis(100) * number;
            let odometer = drive.forward * passed.as_secs_f64();
            let timed = TimedMotion {
                motion: MotionId(1),
                since: start,
                drive,
                odometer,
            };
            let image = wall(far(odometer), every, number);
            blockage.look(&image, start + passed, Camera::default(), timed)?;
            Some(passed.as_secs_f64())
        })
    }

    #[test]
    fn a_held_robot_that_sees_stripes_is_blocked_within_a_second_and_one_that_moves_is_not() {
        let held = reported(AHEAD, 0.1, |_| 0.5).unwrap();
        assert!((0.5..1.01).contains(&held), "{held}");
        let moved = reported(AHEAD, 0.1, |way| (0.6 - way).max(0.05));
        assert!(moved.is_none_or(|seconds| seconds > 2.5), "{moved:?}");
    }

    #[test]
    fn close_to_something_plain_the_distance_driven_tells_also_in_gentle_curves() {
        for (drive, is_told) in [(AHEAD, true), (GENTLE, true), (SHARP, false)] {
            let told = reported(drive, 1000.0, |_| 0.3);
            assert_eq!(told.is_some(), is_told, "{drive:?}");
            assert!(
                told.is_none_or(|seconds| seconds > 2.5),
                "{drive:?}: {told:?}"
            );
        }
    }

    #[test]
    fn a_robot_that_drives_backwards_to_something_plain_is_not_reported() {
        let back = Drive {
            forward: -0.2,
            turn: 0.0,
        };
        assert_eq!(reported(back, 1000.0, |_| 0.3), None);
    }

    #[test]
    fn the_foot_of_a_wall_that_comes_down_tells_where_the_wall_is() {
        let mut approach = Approach::default();
        for step in 0..20 {
            let odometer = 3.0 + 0.02 * f64::from(step);
            assert!(approach.arrival().is_none() || step > 4, "{step}");
            approach.note(odometer, 190.0 * 0.2 / (4.2 - odometer));
        }
        assert!((approach.arrival().unwrap() - 4.2).abs() < 0.01);
        approach.note(3.5, 12.0);
        assert_eq!(approach.arrival(), None, "another foot");
    }

    #[test]
    fn a_foot_that_stays_where_it_is_tells_nothing() {
        let mut approach = Approach::default();
        for step in 0..20 {
            approach.note(0.02 * f64::from(step), 40.0);
        }
        assert_eq!(approach.arrival(), None);
    }
}
