//! A turn on the spot until the camera sees the same again: then it was a full one, whatever tracks slip and
//! however near what the camera sees is.

use std::f64::consts::TAU;

use crate::vision::Skyline;

/// Metres of way after which it is another place.
const SAME_PLACE: f64 = 0.04;
/// How far from a full turn two pictures still share enough, radians; and how far off it is looked for.
const OVERLAP: f64 = 0.3;
const REACH: f64 = 0.3;
/// Radians that the heading may be off after a full turn, beside what it was off before.
const SAME_VIEW: f64 = 0.02;
/// The share of the turn, at most, that the camera may have missed: one that is held sees the same, too.
const UNSEEN: f64 = 0.5;

/// What was done from one picture to the next.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step {
    /// Radians to the left, as tracks and camera tell.
    pub(super) turn: f64,
    /// Radians to the left that the tracks were told.
    pub(super) told: f64,
    /// Metres, either way.
    pub(super) way: f64,
    /// The camera saw it turn.
    pub(super) seen: bool,
}

/// A full turn, or two.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Closed {
    /// Radians to the left that it was, and that it was taken for.
    pub(super) turned: f64,
    pub(super) believed: f64,
    /// Radians to the left that the tracks were told.
    pub(super) told: f64,
    /// Radians that the heading may be off after it.
    pub(super) error: f64,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct FullTurn {
    /// What it saw when it began.
    begin: Option<Skyline>,
    /// Radians that the heading was off then.
    error: f64,
    turn: f64,
    told: f64,
    way: f64,
    /// Radians that the camera has not seen.
    unseen: f64,
}

impl FullTurn {
    /// It may be anywhere.
    pub(super) fn forget(&mut self) {
        *self = FullTurn::default();
    }

    /// The camera sees this after that; the heading is off by so many radians.
    pub(super) fn look(&mut self, skyline: &Skyline, step: Step, error: f64) -> Option<Closed> {
        self.turn += step.turn;
        self.told += step.told;
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
        let closed = Closed {
            turned: full + seen,
            believed: self.turn,
            told: self.told,
            error: self.error + SAME_VIEW,
        };
        *self = FullTurn::begin(skyline, closed.error);
        Some(closed)
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

    /// What a camera sees that is turned to the left by so many radians, in a round room.
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
        Skyline::of(&Image::from_rgb(&picture), camera)
    }

    /// Turns by so many radians, of which it takes each for `believed`, and drives so far with each step.
    fn closed(whole: f64, believed: f64, way: f64, seen: bool) -> Option<Closed> {
        let mut full = FullTurn::default();
        let steps = 60;
        (0..=steps).find_map(|step| {
            let turn = whole / f64::from(steps);
            let done = Step {
                turn: turn * believed,
                told: turn * 1.2,
                way,
                seen,
            };
            full.look(&room(turn * f64::from(step)), done, 0.0)
        })
    }

    #[test]
    fn a_full_turn_is_known_however_much_it_was_taken_for() {
        for (whole, believed) in [(6.4, 1.0), (-6.4, 1.04), (6.5, 0.96)] {
            let Some(found) = closed(whole, believed, 0.0, true) else {
                panic!("{whole} {believed}");
            };
            let turned = found.believed / believed;
            assert!((found.turned - turned).abs() < 0.01, "{found:?} {turned}");
            assert!((found.told - 1.2 * turned).abs() < 0.01, "{found:?}");
        }
    }

    #[test]
    fn a_part_of_a_turn_and_one_elsewhere_or_unseen_tell_nothing() {
        assert_eq!(closed(5.0, 1.0, 0.0, true), None);
        assert_eq!(closed(6.4, 1.0, 0.002, true), None);
        assert_eq!(closed(6.4, 1.0, 0.0, false), None);
    }
}
