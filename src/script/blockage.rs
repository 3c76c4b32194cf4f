//! Notices that the robot is held although its tracks turn: by the pictures that come while a timed motion
//! of the script is on. It rather says nothing than something wrong.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::MotionId;
use crate::vision::{
    Approach, Camera, Drive, Glance, Image, Verdict, compare_glances, foot_ahead, nearer_than,
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
/// Pictures that are kept.
const MOST: usize = 16;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Blockage {
    motion: Option<MotionId>,
    glances: VecDeque<(Instant, Glance)>,
    /// Since when, and in how many pictures, it has stood.
    standing: Option<(Instant, u32)>,
    /// Close before something plain; see [`Close`].
    close: Option<Close>,
    approach: Approach,
    /// A picture's memory, to use again.
    spare: Glance,
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
            self.motion = Some(going.motion);
            self.glances.clear();
            (self.standing, self.close) = (None, None);
            self.approach = Approach::default();
        }
        let mut now = std::mem::take(&mut self.spare);
        now.take(image);
        match foot_ahead(&now) {
            Some(rows) if at >= going.since + SETTLING => self.approach.note(going.odometer, rows),
            _ => {}
        }
        self.note_close(nearer_than(&now, camera), at, going);
        if at < going.since + SETTLING {
            self.spare = now;
            return None;
        }
        let verdict = self.before(at).map_or(Verdict::Unknown, |(then, before)| {
            compare_glances(before, &now, camera, going.drive, at - *then)
        });
        self.note(verdict, at);
        while self.glances.len() >= MOST
            || self
                .glances
                .front()
                .is_some_and(|(old, _)| *old + APART.1 < at)
        {
            let oldest = self.glances.pop_front();
            self.spare = oldest.map(|(_, glance)| glance).unwrap_or_default();
        }
        self.glances.push_back((at, now));
        let stood = self.standing.filter(|(since, pictures)| {
            *pictures >= PICTURES && at.saturating_duration_since(*since) >= STOOD
        });
        stood
            .map(|(since, _)| since)
            .or_else(|| self.arrived(going))
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

    /// When it came close, if it has driven further since than there was room.
    fn arrived(&self, going: Going) -> Option<Instant> {
        let driven = |close: &Close| going.odometer - close.odometer;
        let close = self
            .close
            .filter(|close| driven(close) > close.room + PUSHED)?;
        let seconds = close.room / going.drive.forward.max(0.01);
        Some(close.at + Duration::try_from_secs_f64(seconds).unwrap_or_default())
    }

    /// The oldest picture that is neither too old nor too new to be compared.
    fn before(&self, at: Instant) -> Option<&(Instant, Glance)> {
        let apart = |(then, _): &&(Instant, Glance)| {
            let apart = at.saturating_duration_since(*then);
            APART.0 <= apart && apart <= APART.1
        };
        self.glances.iter().find(apart)
    }

    fn note(&mut self, verdict: Verdict, at: Instant) {
        let then = self.before(at).map(|(then, _)| *then);
        self.standing = match (verdict, self.standing, then) {
            (Verdict::Stands, None, Some(then)) => Some((then, 1)),
            (Verdict::Stands, Some((since, pictures)), _) => Some((since, pictures + 1)),
            (Verdict::Unknown, standing, _) => standing,
            _ => None,
        };
    }
}
