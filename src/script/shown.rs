//! What the tracks did between the moments that two pictures show, and how far the camera is believed that saw
//! another turn.

use std::time::Duration;

use tokio::time::Instant;

use super::lateness::{Lateness, TRIED};
use super::travel::{Totals, Travel};

/// What tracks slip on an unknown floor: radians for each radian and for each metre.
pub(super) const SLIP_OF_TURN: f64 = 0.12;
pub(super) const VEER: f64 = 0.08;
/// What the camera is off: radians for each radian, and for each metre, since what the robot comes past moves
/// through the picture too, and between any two pictures.
pub(super) const SEEN_TURN: f64 = 0.07;
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

/// What the tracks did between the moments that two frames show.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shown {
    totals: Totals,
    /// The turn for each delay of the pictures that is possible, radians.
    turns: [f64; TRIED],
    /// Radians that it may be off because the delay is not known better.
    unsure: f64,
}

/// What a turn that the camera has seen changes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// The turn of the robot that belongs to the one of the camera, radians.
    pub(super) seen: f64,
    /// How far the camera is believed, 0 to 1.
    pub(super) gain: f64,
    /// Radians that the robot has turned more than the tracks say.
    pub(super) turn: f64,
}

impl Shown {
    /// Of two frames that came at these times; `None` if that is too long ago.
    pub(super) fn between(
        travel: &Travel,
        lateness: &Lateness,
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

    /// Radians that the tracks turned the robot, to either side.
    pub(super) fn turned(&self) -> f64 {
        self.totals.turned
    }

    /// What the camera's turn, in radians, changes.
    pub(super) fn correction(&self, seen: f64) -> Correction {
        let seen = seen / PARALLAX;
        let gain = self.gain(seen);
        Correction {
            seen,
            gain,
            turn: gain * (seen - self.totals.turn),
        }
    }

    /// How much of the difference the heading follows if the camera has seen this turn: nothing if that cannot
    /// be, all if the tracks tell nothing.
    fn gain(&self, seen: f64) -> f64 {
        let Totals { turned, way, .. } = self.totals;
        let noise = NOISE * NOISE;
        let tracks = (SLIP_OF_TURN * turned + VEER * way).powi(2) + self.unsure.powi(2) + noise;
        let camera = (SEEN_TURN * turned + PASSING * way).powi(2) + noise;
        let off = seen - self.totals.turn;
        if off.abs() > OUTLIER * (tracks + camera).sqrt() {
            return 0.0;
        }
        tracks / (tracks + camera)
    }
}
