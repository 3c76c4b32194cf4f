//! Detects full turns on the spot: when the camera sees the same view again, the turn was a full
//! one, however much the tracks slip and however near the objects in view are.

use std::f64::consts::TAU;

use crate::vision::Skyline;

/// After this distance, in metres, the robot is at another place.
const SAME_PLACE: f64 = 0.04;
/// How far from a full turn two pictures still overlap enough, and how far off the match is
/// searched for; both in radians.
const OVERLAP: f64 = 0.3;
const REACH: f64 = 0.3;
/// Error of the heading that a full turn adds to the error before it, in radians.
const SAME_VIEW: f64 = 0.02;
/// The largest share of the turn that the camera may have missed: a robot that is blocked sees the
/// same view, too.
const UNSEEN: f64 = 0.5;

/// The motion from one picture to the next.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Radians to the left, estimated from tracks and camera.
    pub(super) turn: f64,
    /// Radians to the left that the tracks were commanded to turn.
    pub(super) commanded: f64,
    /// Metres, either way.
    pub(super) way: f64,
    /// Whether the camera saw the turn.
    pub(super) seen: bool,
}

/// One or more full turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CompletedTurn {
    /// Radians to the left: the real turn, and the turn estimated so far.
    pub(super) turned: f64,
    pub(super) estimated: f64,
    /// Radians to the left that the tracks were commanded to turn.
    pub(super) commanded: f64,
    /// Error of the heading after it, in radians.
    pub(super) error: f64,
}

/// See the module documentation.
#[derive(Debug, Default)]
pub(super) struct FullTurn {
    /// The view at the beginning.
    begin: Option<Skyline>,
    /// Error of the heading then, in radians.
    error: f64,
    turn: f64,
    commanded: f64,
    way: f64,
    /// Radians of the turn that the camera has not seen.
    unseen: f64,
}

impl FullTurn {
    /// Forgets the turn in progress: the robot may be anywhere.
    pub(super) fn forget(&mut self) {
        *self = FullTurn::default();
    }

    /// Processes the view after a step; `error` is the error of the heading, in radians. Returns
    /// the turn if it is now a full one.
    pub(super) fn look(
        &mut self,
        skyline: &Skyline,
        step: Step,
        error: f64,
    ) -> Option<CompletedTurn> {
        self.turn += step.turn;
        self.commanded += step.commanded;
        self.way += step.way;
        self.unseen += if step.seen { 0.0 } else { step.turn.abs() };
        let begin = match &self.begin {
            Some(begin) if self.way < SAME_PLACE => begin,
            _ => {
                *self = FullTurn::begin(skyline, error);
                return None;
            }
        };
        let full = TAU * (self.turn / TAU).round();
        let off = self.turn - full;
        if full == 0.0 || off.abs() > OVERLAP || self.unseen > UNSEEN * full.abs() {
            return None;
        }
        let seen = skyline.turned_since(begin, off, REACH)?;
        let completed = CompletedTurn {
            turned: full + seen,
            estimated: self.turn,
            commanded: self.commanded,
            error: self.error + SAME_VIEW,
        };
        *self = FullTurn::begin(skyline, completed.error);
        Some(completed)
    }

    fn begin(skyline: &Skyline, error: f64) -> FullTurn {
        FullTurn {
            begin: Some(skyline.clone()),
            error,
            ..FullTurn::default()
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::vision::{Camera, Image};
    use image::{Rgb, RgbImage};

    /// The view of a camera in a round room that is turned to the left by this many radians.
    pub(in crate::script) fn room(turned: f64) -> Skyline {
        let camera = Camera::default();
        let size = crate::vision::Size {
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
        Skyline::from_image(&Image::from_rgb(&picture), camera)
    }

    /// Turns by `whole` radians in 60 steps, estimates each radian as `estimated` radians, and
    /// drives `way` metres with each step.
    fn completed(whole: f64, estimated: f64, way: f64, seen: bool) -> Option<CompletedTurn> {
        let mut full = FullTurn::default();
        let steps = 60;
        (0..=steps).find_map(|step| {
            let turn = whole / f64::from(steps);
            let done = Step {
                turn: turn * estimated,
                commanded: turn * 1.2,
                way,
                seen,
            };
            full.look(&room(turn * f64::from(step)), done, 0.0)
        })
    }

    #[test]
    fn a_full_turn_is_detected_in_spite_of_a_wrong_estimate() {
        for (whole, estimated) in [(6.4, 1.0), (-6.4, 1.04), (6.5, 0.96)] {
            let Some(found) = completed(whole, estimated, 0.0, true) else {
                panic!("{whole} {estimated}");
            };
            let turned = found.estimated / estimated;
            assert!((found.turned - turned).abs() < 0.01, "{found:?} {turned}");
            assert!((found.commanded - 1.2 * turned).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn a_partial_turn_and_one_elsewhere_or_unseen_are_not_full_turns() {
        assert_eq!(completed(5.0, 1.0, 0.0, true), None);
        assert_eq!(completed(6.4, 1.0, 0.002, true), None);
        assert_eq!(completed(6.4, 1.0, 0.0, false), None);
    }
}
