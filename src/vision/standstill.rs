//! Decides from two pictures whether the camera stood still although its robot should have moved.
//!
//! When the robot drives forward, the floor and what stands on it come nearer; when it turns,
//! everything shifts sideways. A tile of the picture that would look different after the expected
//! movement is a *witness*. If nearly all witnesses look unchanged, the camera stood still; people
//! who walk through the view hide some of them. Without enough witnesses (a plain wall, darkness)
//! the result is unknown. A common sideways shift of all tiles is allowed while the robot drives:
//! one that is held may turn.

use std::time::Duration;

use super::camera::Camera;
use super::votes::Votes;
use crate::vision::picture::image::Image;
use crate::vision::picture::size::Size;

/// Side of a tile of the half-size picture, pixels.
const TILE: usize = 8;
/// Height of the lens above the floor, metres.
pub(super) const LENS_HEIGHT: f64 = 0.2;
/// Distance of the lens ahead of the robot's centre, metres.
pub(super) const LENS_AHEAD: f64 = 0.1;
/// A tile is evaluated only if the expected movement shifts it by at least this many half-size
/// pixels.
const LEAST_SHIFT: f64 = 2.0;
/// A tile is a witness if the expected movement changes its pixels by at least this much on
/// average, of 255.
const WITNESS: f64 = 8.0;
/// A witness votes for standing still if it has changed by less than this share of the expected
/// change.
const STILL: f64 = 0.45;
/// Least number of witnesses for any result.
const FEWEST_WITNESSES: u32 = 8;
/// Least number on each side of the picture if both sides must agree.
const FEWEST_ASIDE: u32 = 3;
/// Least number for a larger sway than [`SWAYS`] while driving straight.
const FEWEST_FAR_ASIDE: u32 = 16;
/// Least number of quarters of the picture (vertical strips, side by side) with witnesses: a ball
/// that the robot pushes ahead is not enough.
const FEWEST_QUARTERS: usize = 2;
/// The camera stood still if at least the first share of the witnesses did, and moved if at most
/// the second share did.
const STANDS: f64 = 0.7;
const MOVES: f64 = 0.4;
/// Sideways shifts of the half-size picture that still count as standing still, pixels.
const SWAYS: [isize; 5] = [0, 1, -1, 2, -2];
/// Sideways shifts within which an edge might be mistaken for a sway, half-size pixels.
const SLIDES: isize = 10;
/// A turn is evaluated only if it is expected to shift the picture by more than this, half-size
/// pixels.
const LEAST_TURN: f64 = 8.0;

/// The movement that the tracks should produce.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Metres per second, negative backwards.
    pub forward: f64,
    /// Radians per second, left positive.
    pub turn: f64,
}

/// The result of a comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The camera stood still.
    Stands,
    /// It moved.
    Moves,
    /// The pictures are inconclusive.
    Unknown,
}

/// A picture's luma at half its width and height.
#[derive(Debug, Clone, Default)]
pub struct HalfLuma {
    w: usize,
    h: usize,
    luma: Vec<u8>,
}

impl HalfLuma {
    /// Takes the luma of a picture; reuses the memory of `self`.
    pub fn take(&mut self, image: &Image) {
        let Size { width, height } = image.size();
        (self.w, self.h) = (width as usize / 2, height as usize / 2);
        image.halve_luma(&mut self.luma);
    }

    /// Number of columns and rows.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.w, self.h)
    }

    /// The pixels of a row, which must be within the picture.
    pub(super) fn row(&self, y: usize) -> &[u8] {
        &self.luma[y * self.w..][..self.w]
    }

    /// Pixels of a tile, row by row; the tile must be within the picture.
    fn tile(&self, left: usize, top: usize) -> impl Iterator<Item = i32> + Clone {
        let rows = (top..top + TILE).map(move |y| &self.luma[y * self.w + left..][..TILE]);
        rows.flatten().map(|value| i32::from(*value))
    }

    /// The tile shifted by this many pixels; `None` unless it is completely within the picture.
    fn shifted(
        &self,
        (left, top): (usize, usize),
        (right, down): (isize, isize),
    ) -> Option<impl Iterator<Item = i32> + Clone> {
        let left = left.checked_add_signed(right)?;
        let top = top.checked_add_signed(down)?;
        (left + TILE <= self.w && top + TILE <= self.h).then(|| self.tile(left, top))
    }
}

/// Decides whether the camera stood still between two pictures taken `apart` from each other, while
/// the robot should have made this movement. A robot that is held may still turn: `swayed` is the
/// most likely shift of the picture to the right in half-size pixels, assuming that it only
/// shifted.
pub fn compare(
    before: &HalfLuma,
    now: &HalfLuma,
    camera: Camera,
    drive: Drive,
    apart: Duration,
    swayed: isize,
) -> Verdict {
    if (before.w, before.h) != (now.w, now.h) || now.w < TILE || now.h < TILE {
        return Verdict::Unknown;
    }
    let expected = Expected::new(now, camera, drive, apart.as_secs_f64());
    let tops = (0..=now.h - TILE).step_by(TILE);
    let tiles = tops.flat_map(|top| {
        (0..=now.w - TILE)
            .step_by(TILE)
            .map(move |left| (left, top))
    });
    let witnesses: Vec<Witness> = tiles
        .filter_map(|place| Witness::at(before, place, expected.shift(place)?))
        .collect();
    let count = witnesses.len() as u32;
    if count < FEWEST_WITNESSES || quarters(&witnesses, now.w) < FEWEST_QUARTERS {
        return Verdict::Unknown;
    }
    let curve = drive.forward != 0.0 && expected.turn != 0.0;
    let votes = |sway: isize, filter: &dyn Fn(&Witness) -> bool| {
        let mut votes = Votes::default();
        for one in witnesses.iter().filter(|one| filter(one)) {
            if let Some(still) = one.stands(before, now, expected.sway_at(one.place, sway)) {
                votes.add(one.place.0 + TILE / 2 >= now.w / 2, still);
            }
        }
        votes
    };
    let slides = SLIDES + expected.turned_pixels() as isize;
    let (mut most, mut stands) = (0.0, false);
    let around = (swayed - 1..=swayed + 1).filter(|sway| !SWAYS.contains(sway));
    for sway in SWAYS.into_iter().chain(around) {
        let all = votes(sway, &|_| true);
        if all.count() < FEWEST_WITNESSES {
            continue;
        }
        most = f64::max(most, all.share());
        if all.share() < STANDS {
            continue;
        }
        // When driving forward, things on the left move to the left and things on the right move to
        // the right. One side alone might therefore have swayed, or show an edge along the
        // direction of travel, such as a line or a skirting board, which looks the same all along.
        // It counts only if it also shows that nothing moved downwards.
        let drives = drive.forward != 0.0;
        // In a curve, the edge of an object that is passed may look as if the robot only turned.
        let both = || {
            all.least_share(FEWEST_ASIDE)
                .is_some_and(|share| share >= STANDS)
        };
        // A few witnesses that suggest a large turn may be chance matches.
        let far_aside = !curve && drives && !SWAYS.contains(&sway);
        if far_aside && all.count() < FEWEST_FAR_ASIDE {
            continue;
        }
        stands = !drives || (!curve && both()) || {
            let sure = votes(sway, &|one| one.differs_from_any_sway(before, slides));
            sure.count() >= FEWEST_WITNESSES && sure.share() >= STANDS
        };
        if stands {
            break;
        }
    }
    if stands {
        Verdict::Stands
    } else if most <= MOVES && !curve {
        Verdict::Moves
    } else {
        // A robot that is held in a curve may turn, too.
        Verdict::Unknown
    }
}

/// In how many of four vertical strips of the picture there are at least two witnesses.
fn quarters(witnesses: &[Witness], width: usize) -> usize {
    let mut counts = [0; 4];
    for witness in witnesses {
        counts[(witness.place.0 * 4 / width).min(3)] += 1;
    }
    counts.iter().filter(|count| **count >= 2).count()
}

/// A tile that would look different after the expected movement.
struct Witness {
    place: (usize, usize),
    /// The expected shift to the right and down, half-size pixels.
    shift: (isize, isize),
    /// The expected mean change of its pixels, of 255.
    change: f64,
}

impl Witness {
    /// Evaluates the tile at this place. The expected shift is compared at the four whole-pixel
    /// shifts around it: an edge along the direction of movement is not a witness.
    fn at(before: &HalfLuma, place: (usize, usize), shift: (f64, f64)) -> Option<Witness> {
        let shift = (shift.0.floor() as isize, shift.1.floor() as isize);
        let there = || before.tile(place.0, place.1);
        let change = difference_after_motion(before, place, shift, there, WITNESS)?;
        let witness = Witness {
            place,
            shift,
            change,
        };
        (change >= WITNESS).then_some(witness)
    }

    /// Whether no sway looks like the movement here. A straight edge through the tile does not show
    /// how far it has moved along itself.
    fn differs_from_any_sway(&self, before: &HalfLuma, slides: isize) -> bool {
        let (right, down) = self.shift;
        let here = || before.tile(self.place.0, self.place.1);
        let slides = slides + 2 * (right.abs() + down.abs());
        (-slides..=slides).all(|slid| {
            let least =
                difference_after_motion(before, self.place, (right + slid, down), here, WITNESS);
            least.is_none_or(|least| least >= WITNESS)
        })
    }

    /// Whether the tile is found `sway` pixels to the right of its place and looks less like the
    /// tile after the movement; `None` if that place is not in the picture.
    fn stands(&self, before: &HalfLuma, now: &HalfLuma, sway: isize) -> Option<bool> {
        let there = now.shifted(self.place, (sway, 0))?;
        let off = difference(there.clone(), before.tile(self.place.0, self.place.1));
        if off >= STILL * self.change {
            return Some(false);
        }
        let moved = difference_after_motion(before, self.place, self.shift, || there.clone(), off);
        Some(moved.is_some_and(|moved| moved > off))
    }
}

/// The least difference of a tile from those that the movement brings here. The search stops once
/// it is below `enough`. `None` if they are not in the picture.
fn difference_after_motion<I: Iterator<Item = i32> + Clone>(
    before: &HalfLuma,
    place: (usize, usize),
    (right, down): (isize, isize),
    tile: impl Fn() -> I,
    enough: f64,
) -> Option<f64> {
    let mut least = f64::INFINITY;
    for (aside, below) in [(0, 0), (1, 1), (0, 1), (1, 0)] {
        let there = before.shifted(place, (-right - aside, -down - below))?;
        least = least.min(difference(tile(), there));
        if least < enough {
            break;
        }
    }
    Some(least)
}

/// The mean absolute difference of two tiles, corrected for their mean brightness.
fn difference(
    one: impl Iterator<Item = i32> + Clone,
    other: impl Iterator<Item = i32> + Clone,
) -> f64 {
    const PIXELS: i32 = (TILE * TILE) as i32;
    let pairs = one.zip(other).map(|(one, other)| one - other);
    let mean = pairs.clone().sum::<i32>() / PIXELS;
    let sum: i32 = pairs.map(|difference| (difference - mean).abs()).sum();
    f64::from(sum) / f64::from(PIXELS)
}

/// Where things move in the picture if the robot moves as commanded.
struct Expected {
    centre: (f64, f64),
    focal: f64,
    /// Metres driven forward.
    way: f64,
    /// Radians turned to the left.
    turn: f64,
    /// Whether the robot also drives forward or backward.
    drives: bool,
}

impl Expected {
    fn new(luma: &HalfLuma, camera: Camera, drive: Drive, seconds: f64) -> Expected {
        let centre = (luma.w as f64 / 2.0, luma.h as f64 / 2.0);
        let focal = camera.focal_length(luma.w as u32);
        let turn = drive.turn * seconds;
        Expected {
            centre,
            focal,
            way: drive.forward * seconds,
            // A small turn cannot be told from a sway.
            turn: if (turn * focal).abs() > LEAST_TURN {
                turn
            } else {
                0.0
            },
            drives: drive.forward != 0.0,
        }
    }

    /// How far the turn may shift the picture, in half-size pixels, with a margin for an inaccurate
    /// turn.
    fn turned_pixels(&self) -> f64 {
        (self.turn * self.focal * 1.4).abs().min(60.0)
    }

    /// Shifts near things farther, because the lens is ahead of the robot's centre when it turns.
    fn sway_at(&self, (_, top): (usize, usize), sway: isize) -> isize {
        let y = (top + TILE / 2) as f64 - self.centre.1;
        let near = LENS_AHEAD / LENS_HEIGHT * y.max(0.0) / self.focal;
        (sway as f64 * (1.0 + near)).round() as isize
    }

    /// The expected shift to the right and down in half-size pixels; `None` if it is too small to
    /// be seen.
    fn shift(&self, (left, top): (usize, usize)) -> Option<(f64, f64)> {
        let x = (left + TILE / 2) as f64 - self.centre.0;
        let y = (top + TILE / 2) as f64 - self.centre.1;
        // Everything seen below the height of the lens is on the floor or nearer; things above it
        // may be far away.
        let ahead = if y > 1.0 {
            let depth = self.focal * LENS_HEIGHT / y;
            self.way / (depth - self.way).max(0.05)
        } else {
            0.0
        };
        // A robot held in a curve may or may not turn: only the movement forward is evaluated.
        let turn = if self.drives { 0.0 } else { self.turn };
        let aside = self.focal * turn * (1.0 + (x / self.focal).powi(2));
        let (right, down) = (x * ahead + aside, y * ahead);
        // Larger shifts are outside the picture anyway.
        let pixels = |shift: f64| shift.clamp(-1e6, 1e6);
        (right.hypot(down) >= LEAST_SHIFT).then(|| (pixels(right), pixels(down)))
    }
}

#[cfg(test)]
mod tests;
