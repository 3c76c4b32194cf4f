//! What the tracks did between the moments that two pictures show, and how far the camera is believed that saw
//! another turn.

use std::time::Duration;

use tokio::time::Instant;

use super::full_turn::Step;
use super::grip::UNKNOWN;
use super::lateness::{Lateness, TRIED};
use super::travel::{Totals, Travel};

/// Radians that tracks veer with each metre.
pub(super) const VEER: f64 = 0.08;
/// What the camera is off: radians for each radian, and for each metre, since what the robot comes past moves
/// through the picture too, and between any two pictures.
const SEEN_TURN: f64 = 0.07;
const PASSING: f64 = 0.3;
const NOISE: f64 = 0.003;
/// A turn that differs by more than so many standard errors from what the tracks did is none: somebody walks by.
const OUTLIER: f64 = 3.0;
/// The camera stands this share of the distance to what it sees before the middle of the robot, which makes
/// turns look larger: 0.1 m before it, and 1.25 m to what stands around in a room.
const PARALLAX: f64 = 1.05;
/// A turn is looked for so far from what is expected, at least; radians, and as a share of it.
const LEAST_REACH: f64 = 0.15;
const REACH: f64 = 0.6;
/// Radians of a turn from which on it tells how far camera and tracks differ.
const TELLS: f64 = 0.05;

/// What the tracks did between the moments that two frames show.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    totals: Totals,
    /// The turn for each delay of the pictures that is possible, radians.
    turns: [f64; TRIED],
    /// Radians that it may be off because the delay is not known better.
    unsure: f64,
    /// As a share of the turn, what the tracks may have made more or less of it.
    slip: f64,
}

/// What a turn that the camera has seen changes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// Radians that the robot has turned more than the tracks say, as far as the camera is believed.
    pub(super) turn: f64,
    /// Radians that the heading is less unsure.
    pub(super) better: f64,
    /// The share of the turn by which the camera saw more, if it saw one that tells.
    pub(super) differs: Option<f64>,
    /// The camera saw a turn that can be.
    pub(super) seen: bool,
}

impl Correction {
    /// Of a camera that tells nothing.
    pub(super) const NONE: Correction = Correction {
        turn: 0.0,
        better: 0.0,
        differs: None,
        seen: false,
    };
}

impl Shown {
    /// Of two frames that came at these times; `None` if that is too long ago.
    pub(super) fn between(
        travel: &Travel,
        lateness: &Lateness,
        slip: f64,
        before: Instant,
        now: Instant,
    ) -> Option<Shown> {
        let done = |delay: Duration| {
            let (from, to) = (before.checked_sub(delay)?, now.checked_sub(delay)?);
            travel.between(from, to)
        };
        let all = Lateness::tried().map(|delay| done(delay).unwrap_or_default());
        let believed = lateness.believed();
        let totals = done(Lateness::tried()[believed])?;
        let beside = [believed.saturating_sub(1), (believed + 1).min(TRIED - 1)];
        let off = beside.map(|index| (all[index].turn - totals.turn).abs());
        Some(Shown {
            totals,
            turns: all.map(|totals| totals.turn),
            unsure: off[0].max(off[1]),
            slip,
        })
    }

    /// The turn that the camera should see, and how far from that it is looked for; radians.
    pub(super) fn expected(&self) -> (f64, f64) {
        let turn = self.totals.turn;
        let late = |reach: f64, other: &f64| reach.max((other - turn).abs());
        let least = self.turns.iter().fold(LEAST_REACH, late);
        (turn, least.max(REACH * turn.abs()))
    }

    /// Radians that it has turned at most, to either side, however late the pictures are.
    pub(super) fn most_turn(&self) -> f64 {
        self.turns
            .iter()
            .fold(0.0, |most, turn| turn.abs().max(most))
    }

    /// The turn for each delay that is possible, radians.
    pub(super) fn turns(&self) -> &[f64; TRIED] {
        &self.turns
    }

    /// What was done, with the correction.
    pub(super) fn step(&self, correction: Correction) -> Step {
        Step {
            turn: self.totals.turn + correction.turn,
            told: self.totals.told,
            way: self.totals.way,
            seen: correction.seen,
        }
    }

    /// The turn of the robot that belongs to one of the camera; radians.
    pub(super) fn of_camera(seen: f64) -> f64 {
        seen / PARALLAX
    }

    /// What it changes that the camera has seen this turn of the robot, in radians: nothing if that cannot be, all if
    /// the tracks tell nothing.
    pub(super) fn correction(&self, seen: f64) -> Correction {
        let Totals { turned, way, .. } = self.totals;
        let noise = NOISE * NOISE;
        let tracks = (self.slip * turned + VEER * way).powi(2) + self.unsure.powi(2) + noise;
        let camera = (SEEN_TURN * turned + PASSING * way).powi(2) + noise;
        let off = seen - self.totals.turn;
        let unknown = tracks.max((UNKNOWN * turned + VEER * way).powi(2));
        if off.abs() > OUTLIER * (unknown + camera).sqrt() {
            return Correction::NONE;
        }
        let gain = tracks / (tracks + camera);
        Correction {
            turn: gain * off,
            better: gain * (self.slip - SEEN_TURN).max(0.0) * turned,
            differs: (turned > TELLS).then(|| off * self.totals.turn.signum() / turned),
            seen: true,
        }
    }
}
