//! Notices that the robot is held although its tracks turn: by the pictures that come while a timed motion
//! of the script is on. It rather says nothing than something wrong.
//!
//! Three things tell: tiles of the picture that should have changed and did not, outlines that did not (paler ones, and
//! of what is close), and, where the picture is all plain, the way that the tracks have made since the foot of what
//! stands ahead left the picture, in curves and towards slanted walls too (`wall_ahead`), or since its last stripes and
//! edges did, which moved apart as they came nearer. A robot that was held and has only turned since is still where it
//! was held (`contact`). They rest on the height of the lens above the floor, on its looking level, on the field of view
//! and on the calibration of the tracks; on nothing of how the simulated camera draws.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use super::contact::Contact;
use super::going::Going;
use super::wall_ahead::WallAhead;
use crate::robot::MotionId;
use crate::vision::{
    Approach, Camera, Drive, Glance, Image, Looming, Outline, Verdict, compare_glances,
    compare_outlines, foot_ahead, looming_distance, nearer_than, swayed,
};

/// The robot gains speed, and its pictures are late: what is older than this after the beginning of a
/// motion is not looked at.
const SETTLING: Duration = Duration::from_millis(300);
/// Pictures are compared that were taken so far apart.
const APART: (Duration, Duration) = (Duration::from_millis(190), Duration::from_millis(450));
/// If those do not tell, farther apart: a slow robot changes little meanwhile.
const FARTHER_APART: Duration = Duration::from_millis(750);
/// It must have stood for so long, in at least so many pictures; in fewer at the beginning of a motion, when it may have
/// been held from the start.
const STOOD: Duration = Duration::from_millis(500);
const PICTURES: u32 = 4;
const PICTURES_AT_FIRST: u32 = 3;
const AT_FIRST: Duration = Duration::from_millis(1200);
/// Pictures that told so longer ago count no more.
const FORGOTTEN: Duration = Duration::from_millis(500);
/// How fast it may turn, in radians a second, so that what it sees ahead is what it will meet.
const STRAIGHT: f64 = 0.06;
/// In so many pictures in a row floor must be seen, until it is believed again.
const FLICKER: u32 = 4;
/// In a curve, what was close ahead is still ahead if the robot would have turned by less than this since, in radians.
const BEND: f64 = 1.2;
/// What is close is taken to be no nearer than this, in metres, however far the tracks have turned since.
const NEAREST: f64 = 0.3;
/// Metres from the lens to what has just left the picture, at least: nearer ones are mistakes.
const LEAST_ROOM: f64 = 0.15;
/// Metres by which what grows may be farther than it seemed.
const MARGIN: f64 = 0.02;
/// If the foot and the growth of what is ahead tell ways that differ by more, in metres, one of them is wrong.
const DISAGREE: f64 = 0.15;
/// Tracks that differ turn the picture by so many half-size pixels between two looks; and a turn that was asked for may
/// come out so much larger, since the lens is before the middle of the robot.
const VEER: f64 = 6.0;
const PARALLAX: f64 = 1.4;
/// Pictures that are kept.
const MOST: usize = 16;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Blockage {
    motion: Option<MotionId>,
    views: VecDeque<View>,
    /// Pictures tell that it stands.
    standing: Option<Standing>,
    /// Close before something plain; see [`Close`].
    close: Option<Close>,
    approach: Approach,
    looming: Looming,
    wall: WallAhead,
    contact: Contact,
    /// A picture's memory, to use again.
    spare: Option<(Glance, Outline)>,
}

/// Since when it has stood, as far as the pictures tell.
#[derive(Debug, Clone, Copy)]
struct Standing {
    since: Instant,
    /// When a picture last told so.
    last: Instant,
    /// How many have.
    pictures: u32,
}

/// A picture that others are compared with.
#[derive(Debug)]
struct View {
    at: Instant,
    odometer: f64,
    glance: Glance,
    outline: Outline,
}

/// The robot has come so close to something plain that the pictures tell nothing any more. Then only the way
/// that its tracks make tells that it must have arrived.
#[derive(Debug, Clone, Copy)]
struct Close {
    /// When, and where the odometer stood, metres.
    at: Instant,
    odometer: f64,
    /// The most that there is to go, metres.
    room: f64,
    /// The same, whatever its foot says.
    farthest: f64,
    /// That is by how its foot came down.
    measured: bool,
    /// Where the odometer stands when it arrives, by how what is ahead grew.
    arrival: Option<f64>,
    /// Pictures in a row that may show floor again.
    floor: u32,
}

impl Blockage {
    /// A picture that was taken `at`, while this motion was on. Since when the robot has been held, if it
    /// is held.
    pub(super) fn look(
        &mut self,
        image: &Image,
        at: Instant,
        camera: Camera,
        going: Going,
    ) -> Option<Instant> {
        if self.motion != Some(going.motion) {
            self.motion = Some(going.motion);
            self.views.clear();
            (self.standing, self.close) = (None, None);
            self.approach = Approach::default();
            self.looming = Looming::default();
            self.wall = WallAhead::default();
            self.contact.begin(at, going);
        }
        self.wall.drive_on(going.odometer, going.drive);
        let (mut glance, mut outline) = self.spare.take().unwrap_or_default();
        glance.take(image);
        outline.take(&glance);
        let settled = at >= going.since + SETTLING;
        match foot_ahead(&glance) {
            Some(rows) if settled => self.approach.note(going.odometer, rows),
            _ => {}
        }
        self.note_close(nearer_than(&glance, camera), at, going);
        if settled && going.drive.forward > 0.0 {
            self.wall.look(&glance, camera, self.close.is_some());
        }
        if !settled {
            self.spare = Some((glance, outline));
            return None;
        }
        let now = View {
            at,
            odometer: going.odometer,
            glance,
            outline,
        };
        self.note_looming(&now, camera, going);
        let (verdict, then) = self.compare(&now, camera, going.drive);
        self.note(verdict, then, at);
        self.keep(now);
        let close = self.close.is_some_and(|close| close.floor == 0);
        let again = self.contact.look(at, verdict, close, going);
        let held = self
            .stood(at, going.since)
            .or_else(|| self.arrived(going))
            .or_else(|| self.in_wall(at, going.drive, verdict))
            .or(again);
        let perhaps = held.is_some() || self.standing.is_some();
        self.contact.note(perhaps, at, going);
        held
    }

    /// Since when the pictures say that it stands, if enough do. The motion began at `began`.
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

    /// The robot may be anywhere now, or what is ahead of it.
    pub(super) fn forget(&mut self) {
        self.contact.forget();
    }

    /// What two pictures say, and when the first was taken.
    fn compare(&self, now: &View, camera: Camera, drive: Drive) -> (Verdict, Option<Instant>) {
        let told = |before: &View| {
            let verdict = self.compare_two(before, now, camera, drive);
            (verdict, Some(before.at))
        };
        let near = self.before(now.at, APART.1).map(&told);
        match near {
            Some((Verdict::Unknown, _)) | None => {}
            Some(near) => return near,
        }
        // It may have driven for the beginning of that time: so this tells nothing of a movement.
        let straight = drive.turn.abs() < STRAIGHT;
        let far = self
            .before(now.at, FARTHER_APART)
            .filter(|_| straight)
            .map(told);
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
        let sway = swayed(&before.outline, &now.outline, least as isize, most as isize);
        match compare_glances(&before.glance, &now.glance, camera, drive, apart, sway) {
            Verdict::Unknown if drive.forward > 0.0 && self.wall.is_away() => Verdict::Unknown,
            Verdict::Unknown => {
                let ahead = self
                    .close
                    .map(|close| (close.odometer + close.room - before.odometer).max(NEAREST));
                compare_outlines(&before.outline, &now.outline, camera, drive, apart, ahead)
            }
            verdict => verdict,
        }
    }

    fn keep(&mut self, now: View) {
        let old = |view: &View| view.at + FARTHER_APART < now.at;
        while self.views.len() >= MOST || self.views.front().is_some_and(old) {
            let oldest = self.views.pop_front();
            self.spare = oldest.map(|view| (view.glance, view.outline));
        }
        self.views.push_back(now);
    }

    /// Where it will arrive at what is close, by how that grows.
    fn note_looming(&mut self, now: &View, camera: Camera, going: Going) {
        let Some(close) = self.close else {
            self.looming = Looming::default();
            return;
        };
        let seen = self.before(now.at, FARTHER_APART).and_then(|before| {
            let way = now.odometer - before.odometer;
            let turned = turned(now, camera, going.drive, now.at - before.at);
            looming_distance(before.outline.horizon(), now.outline.horizon(), way, turned)
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

    fn note_close(&mut self, nearer_than: Option<f64>, at: Instant, going: Going) {
        let measured = self.room(going.odometer);
        self.close = match (nearer_than, self.close) {
            (Some(room), None) if going.drive.forward > 0.0 => Some(Close {
                at,
                odometer: going.odometer,
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

    /// Metres to what it has seen ahead while it came nearer.
    fn room(&self, odometer: f64) -> Option<f64> {
        let room = self.approach.arrival()? - odometer;
        (room > LEAST_ROOM).then_some(room)
    }

    /// When it came to what was close before it, if its tracks have made that way: then the lens would be there, and
    /// it is behind the front of the robot.
    fn arrived(&self, going: Going) -> Option<Instant> {
        let straight = going.drive.turn.abs() < STRAIGHT;
        let close = self.close.filter(|close| close.floor == 0)?;
        let way = going.odometer - close.odometer;
        let seconds = |way: f64| way / going.drive.forward.max(0.01);
        let ahead = if straight {
            Some(close.room)
        } else {
            // No floor was seen ahead all along the curve, and its foot tells nothing there.
            ((seconds(way) * going.drive.turn).abs() < BEND).then_some(close.farthest)
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

    /// Since when it would be in the wall that it saw before it came close, if that is still all that it sees.
    fn in_wall(&self, at: Instant, drive: Drive, verdict: Verdict) -> Option<Instant> {
        self.close.filter(|close| close.floor == 0)?;
        let pushed = self.wall.pushed_for(drive)?;
        (verdict != Verdict::Moves).then(|| at - pushed)
    }

    /// The oldest picture that is neither too old nor too new to be compared.
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

/// By how many half-size pixels to the right such a turn moves what is far.
fn turned(now: &View, camera: Camera, drive: Drive, apart: Duration) -> f64 {
    camera.focal_length(now.outline.width()) * drive.turn * apart.as_secs_f64()
}

#[cfg(test)]
mod tests;
