//! Notices that the robot is held although its tracks turn: by the pictures that come while a timed motion
//! of the script is on. It rather says nothing than something wrong.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::MotionId;
use crate::vision::{
    Approach, Breadth, Camera, Drive, Glance, Growth, Image, Verdict, compare_glances, foot_ahead,
    nearer_than,
};

/// The robot gains speed, and its pictures are late: what is older than this after the beginning of a
/// motion is not looked at.
const SETTLING: Duration = Duration::from_millis(300);
/// Pictures are compared that were taken so far apart.
const APART: (Duration, Duration) = (Duration::from_millis(190), Duration::from_millis(450));
/// It must have stood for so long, in at least so many pictures.
const STOOD: Duration = Duration::from_millis(500);
const PICTURES: u32 = 3;
/// A robot that has driven so much further, in metres, than to what it saw close before it, is held there: the
/// lens is behind the front of the robot by more than that.
const PUSHED: f64 = 0.02;
/// Metres from the lens to what has just left the picture, at least: nearer ones are mistakes.
const LEAST_ROOM: f64 = 0.15;
/// What fills the picture is compared over so long a way, in metres, at least; shorter ones make it no larger.
const LEAST_WAY: f64 = 0.02;
/// ... and while the robot turns no more than this, radians.
const STRAIGHT: f64 = 0.03;
/// So many measures of how far that is are kept, and fewer tell nothing. The robot has arrived when its lens
/// would be beyond by so much, in metres.
const MEASURES: (usize, usize) = (3, 9);
const BEYOND: f64 = 0.04;
/// Pictures that are kept.
const MOST: usize = 16;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Blockage {
    motion: Option<MotionId>,
    seen: VecDeque<Seen>,
    /// Since when, and in how many pictures, it has stood.
    standing: Option<(Instant, u32)>,
    /// Close before something plain; see [`Close`].
    close: Option<Close>,
    approach: Approach,
    /// Where the odometer will stand when the lens is at what fills the picture, by how fast that grows.
    arrivals: VecDeque<f64>,
    /// A picture's memory, to use again.
    spare: Glance,
}

/// A picture that others are compared with.
#[derive(Debug)]
struct Seen {
    at: Instant,
    odometer: f64,
    glance: Glance,
    /// Of what is so close that it hides the floor.
    breadth: Option<Breadth>,
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
}

/// A timed motion that is on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Going {
    pub(super) motion: MotionId,
    pub(super) since: Instant,
    pub(super) drive: Drive,
    /// Metres that the script's tracks have made so far, backwards ones taken off.
    pub(super) odometer: f64,
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
            *self = Blockage {
                motion: Some(going.motion),
                spare: std::mem::take(&mut self.spare),
                ..Blockage::default()
            };
        }
        let mut now = std::mem::take(&mut self.spare);
        now.take(image);
        let settled = at >= going.since + SETTLING;
        if let (Some(rows), true) = (foot_ahead(&now), settled) {
            self.approach.note(going.odometer, rows);
        }
        let near = nearer_than(&now, camera);
        self.note_close(near, at, going);
        if !settled {
            self.spare = now;
            return None;
        }
        let now = Seen {
            at,
            odometer: going.odometer,
            breadth: near.and_then(|_| Breadth::of(&now)),
            glance: now,
        };
        let verdict = self.compare(&now, near, camera, going);
        self.note(verdict, at);
        self.keep(now);
        let stood = self.standing.filter(|(since, pictures)| {
            *pictures >= PICTURES && at.saturating_duration_since(*since) >= STOOD
        });
        stood
            .map(|(since, _)| since)
            .or_else(|| self.arrived(at, verdict, going))
    }

    fn compare(&mut self, now: &Seen, near: Option<f64>, camera: Camera, going: Going) -> Verdict {
        let Some(before) = self.before(now.at) else {
            return Verdict::Unknown;
        };
        let apart = now.at - before.at;
        let floor = compare_glances(&before.glance, &now.glance, camera, going.drive, apart);
        let way = now.odometer - before.odometer;
        let straight = (going.drive.turn * apart.as_secs_f64()).abs() < STRAIGHT;
        let (Some(room), Some(then), Some(this)) = (near, &before.breadth, &now.breadth) else {
            return floor;
        };
        if !(LEAST_WAY..room / 2.0).contains(&way) || !straight {
            return floor;
        }
        match this.since(then, room / (room - way)) {
            Growth::Same => Verdict::Stands,
            Growth::Grown(scale) => {
                let arrival = before.odometer + way * scale / (scale - 1.0);
                if self.arrivals.len() == MEASURES.1 {
                    self.arrivals.pop_front();
                }
                self.arrivals.push_back(arrival);
                Verdict::Moves
            }
            Growth::Unknown => floor,
        }
    }

    fn keep(&mut self, now: Seen) {
        let old = |seen: &Seen| seen.at + APART.1 < now.at;
        while self.seen.len() >= MOST || self.seen.front().is_some_and(old) {
            let oldest = self.seen.pop_front();
            self.spare = oldest.map(|seen| seen.glance).unwrap_or_default();
        }
        self.seen.push_back(now);
    }

    fn note_close(&mut self, nearer_than: Option<f64>, at: Instant, going: Going) {
        self.close = match (nearer_than, self.close) {
            (Some(room), None) if going.drive.forward > 0.0 => Some(Close {
                at,
                odometer: going.odometer,
                room: self
                    .room(going.odometer)
                    .map_or(room, |seen| room.min(seen)),
            }),
            (Some(_), close) => close,
            (None, _) => None,
        };
    }

    /// Metres to what it has seen ahead while it came nearer.
    fn room(&self, odometer: f64) -> Option<f64> {
        let room = self.approach.arrival()? - odometer;
        (room > LEAST_ROOM).then_some(room)
    }

    /// When it came to what is close, if it has driven further since than there was room.
    fn arrived(&self, at: Instant, verdict: Verdict, going: Going) -> Option<Instant> {
        let close = self.close.filter(|_| verdict != Verdict::Moves)?;
        let by_growth = self.arrival().map(|arrival| arrival + BEYOND);
        let arrival = by_growth.unwrap_or(close.odometer + close.room + PUSHED);
        let beyond = going.odometer - arrival;
        let seconds = beyond / going.drive.forward.max(0.01);
        let since = at.checked_sub(Duration::try_from_secs_f64(seconds).ok()?)?;
        Some(since.max(close.at))
    }

    /// The middle one of the measures of how far that is.
    fn arrival(&self) -> Option<f64> {
        let mut arrivals: Vec<f64> = self.arrivals.iter().copied().collect();
        arrivals.sort_by(f64::total_cmp);
        let enough = arrivals.len() >= MEASURES.0;
        enough.then(|| arrivals[arrivals.len() / 2])
    }

    /// The oldest picture that is neither too old nor too new to be compared.
    fn before(&self, at: Instant) -> Option<&Seen> {
        let apart = |seen: &&Seen| {
            let apart = at.saturating_duration_since(seen.at);
            APART.0 <= apart && apart <= APART.1
        };
        self.seen.iter().find(apart)
    }

    fn note(&mut self, verdict: Verdict, at: Instant) {
        let then = self.before(at).map(|seen| seen.at);
        self.standing = match (verdict, self.standing, then) {
            (Verdict::Stands, None, Some(then)) => Some((then, 1)),
            (Verdict::Stands, Some((since, pictures)), _) => Some((since, pictures + 1)),
            (Verdict::Unknown, standing, _) => standing,
            _ => None,
        };
    }
}
