//! What the tracks did between the moments that two pictures show, and how far the camera is
//! trusted if it saw a different turn.

use std::time::Duration;

use tokio::time::Instant;

use super::full_turn::Step;
use super::picture_delay::{CANDIDATES, PictureDelay};
use super::travel::{Totals, Travel};
use super::turn_slip::UNKNOWN_FLOOR;

/// Radians by which the tracks veer per metre.
pub(super) const VEER: f64 = 0.08;
/// Error of the camera: radians per radian of turn; radians per metre of way, since objects that
/// the robot passes move through the picture too; and radians between any two pictures.
const SEEN_TURN: f64 = 0.07;
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
/// Least turn, in radians, from which the difference between camera and tracks is measured.
const MIN_MEASURED_TURN: f64 = 0.05;

/// What the tracks did between the moments that two frames show.
#[derive(Debug, Clone, Copy)]
pub(super) struct TrackMotion {
    totals: Totals,
    /// The turn for each possible delay of the pictures, in radians.
    turns: [f64; CANDIDATES],
    /// Error of the turn due to the uncertain delay, in radians.
    delay_error: f64,
    /// Error of the turn due to slip of the tracks, as a share of the turn.
    slip: f64,
}

/// The correction by a turn that the camera has seen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// Radians that the robot has turned more than the tracks say, as far as the camera is trusted.
    pub(super) turn: f64,
    /// Radians by which the error of the heading decreases.
    pub(super) error_decrease: f64,
    /// The share of the turn by which the camera saw more than the tracks made, if the turn was
    /// large enough to measure it.
    pub(super) difference: Option<f64>,
    /// Whether the camera saw a plausible turn.
    pub(super) seen: bool,
}

impl Correction {
    /// No correction: the camera showed no plausible turn.
    pub(super) const NONE: Correction = Correction {
        turn: 0.0,
        error_decrease: 0.0,
        difference: None,
        seen: false,
    };
}

impl TrackMotion {
    /// What the tracks did between two frames that arrived at these times; `None` if that is too
    /// long ago.
    pub(super) fn between(
        travel: &Travel,
        picture_delay: &PictureDelay,
        slip: f64,
        before: Instant,
        now: Instant,
    ) -> Option<TrackMotion> {
        let done = |delay: Duration| {
            let (from, to) = (before.checked_sub(delay)?, now.checked_sub(delay)?);
            travel.between(from, to)
        };
        let all = PictureDelay::candidates().map(|delay| done(delay).unwrap_or_default());
        let selected = picture_delay.selected();
        let totals = done(PictureDelay::candidates()[selected])?;
        let beside = [
            selected.saturating_sub(1),
            (selected + 1).min(CANDIDATES - 1),
        ];
        let off = beside.map(|index| (all[index].turn - totals.turn).abs());
        Some(TrackMotion {
            totals,
            turns: all.map(|totals| totals.turn),
            delay_error: off[0].max(off[1]),
            slip,
        })
    }

    /// The turn that the camera should see, and how far from that the real one is searched for;
    /// radians.
    pub(super) fn expected(&self) -> (f64, f64) {
        let turn = self.totals.turn;
        let late = |reach: f64, other: &f64| reach.max((other - turn).abs());
        let least = self.turns.iter().fold(LEAST_REACH, late);
        (turn, least.max(REACH * turn.abs()))
    }

    /// The largest turn for any delay of the pictures, to either side, in radians.
    pub(super) fn most_turn(&self) -> f64 {
        self.turns
            .iter()
            .fold(0.0, |most, turn| turn.abs().max(most))
    }

    /// The turn for each possible delay, in radians.
    pub(super) fn turns(&self) -> &[f64; CANDIDATES] {
        &self.turns
    }

    /// The motion with the correction applied.
    pub(super) fn step(&self, correction: Correction) -> Step {
        Step {
            turn: self.totals.turn + correction.turn,
            commanded: self.totals.commanded,
            way: self.totals.way,
            seen: correction.seen,
        }
    }

    /// Converts a turn that the camera saw to the turn of the robot; radians.
    pub(super) fn of_camera(seen: f64) -> f64 {
        seen / PARALLAX
    }

    /// The correction if the camera has seen this turn of the robot, in radians: none if that is
    /// implausible, and the larger the less the tracks can be trusted.
    pub(super) fn correction(&self, seen: f64) -> Correction {
        let Totals { turned, way, .. } = self.totals;
        let noise = NOISE * NOISE;
        let tracks = (self.slip * turned + VEER * way).powi(2) + self.delay_error.powi(2) + noise;
        let camera = (SEEN_TURN * turned + PASSING * way).powi(2) + noise;
        let off = seen - self.totals.turn;
        let unknown = tracks.max((UNKNOWN_FLOOR * turned + VEER * way).powi(2));
        if off.abs() > OUTLIER * (unknown + camera).sqrt() {
            return Correction::NONE;
        }
        let gain = tracks / (tracks + camera);
        Correction {
            turn: gain * off,
            error_decrease: gain * (self.slip - SEEN_TURN).max(0.0) * turned,
            difference: (turned > MIN_MEASURED_TURN)
                .then(|| off * self.totals.turn.signum() / turned),
            seen: true,
        }
    }
}
