//! Decides from brightness profiles of two pictures whether the camera stood still although its
//! robot should have moved.
//!
//! Close to a wall the picture shows little: the edge of a door, stripes of a wallpaper, a skirting
//! board. Averaging many pixels along columns and rows reveals even faint ones. Everything seen
//! below the height of the lens is on the floor or nearer, so the expected movement shifts it by a
//! known minimum. A sample of a profile that would look different after that shift is a *witness*;
//! only if nearly all witnesses look unchanged has the camera stood still.

use std::time::Duration;

use super::camera::Camera;
use super::standstill::{Drive, HalfLuma, LENS_HEIGHT, Verdict};
use super::votes::Votes;

/// The bands of rows over which columns are averaged, as shares of the height below the horizon.
/// Those above the horizon count only in strips that show no floor.
const BANDS: [(f64, f64); 4] = [(-0.7, -0.35), (-0.35, 0.0), (0.25, 0.62), (0.62, 0.98)];
/// Vertical strips of the picture over which rows are averaged.
const STRIPS: usize = 8;
/// If the brightness of a strip changes by less than this between neighbouring rows, of 255, the
/// strip shows a single object from above the height of the lens to the bottom of the picture.
const STEP: f32 = 1.8;
/// Rows compared on each side of such a step.
const REACH: usize = 3;
/// Strips begin here, as a share of the height.
const TOP: f64 = 0.36;
/// Brightness within which steps can be seen; darker or brighter strips may hide them.
const USABLE_BRIGHTNESS: std::ops::RangeInclusive<f32> = 20.0..=240.0;
/// Smallest shift that is evaluated, half-size pixels.
const LEAST_SHIFT: f64 = 1.5;
/// A sample is a witness if the shift changes it by at least this much, of 255.
const WITNESS: f64 = 2.0;
/// A witness votes for standing still if it has changed by less than this share of the expected
/// change.
const STILL: f64 = 0.4;
/// Least number of witnesses for any result, and on each side for a result with a sway.
const FEWEST: u32 = 12;
const FEWEST_ASIDE: u32 = 4;
/// Least distance driven for a result, metres.
const LEAST_WAY: f64 = 0.01;
/// The camera stood still if at least the first share of the witnesses did, and moved if at most
/// the second share did.
const STANDS: f64 = 0.75;
const MOVES: f64 = 0.4;
/// Least number and share of witnesses when driving backwards, where nothing shows that a wall is
/// still distant: both are higher.
const BACKWARDS: (u32, f64) = (24, 0.82);
/// Sideways shifts of the picture that still count as standing still, half-size pixels.
const SWAY: i32 = 2;

/// Mean brightness of a picture along its columns and its rows, in bands and strips.
#[derive(Debug, Clone, Default)]
pub struct Profiles {
    size: (usize, usize),
    pub(super) bands: [Vec<f32>; BANDS.len()],
    strips: [Vec<f32>; STRIPS],
    /// Strips that show no floor.
    near: [bool; STRIPS],
}

impl Profiles {
    /// Number of columns.
    pub fn width(&self) -> u32 {
        self.size.0 as u32
    }

    /// The brightness along the columns just above the horizon.
    pub fn horizon(&self) -> &[f32] {
        &self.bands[1]
    }

    /// Computes the profiles of a picture; reuses the memory of `self`.
    pub fn take(&mut self, luma: &HalfLuma) {
        let (w, h) = luma.size();
        self.size = (w, h);
        for (band, (top, bottom)) in self.bands.iter_mut().zip(rows_of_bands(h)) {
            band.clear();
            band.resize(w, 0.0);
            for y in top..bottom {
                for (sum, value) in band.iter_mut().zip(luma.row(y)) {
                    *sum += f32::from(*value);
                }
            }
            let rows = (bottom - top).max(1) as f32;
            band.iter_mut().for_each(|sum| *sum /= rows);
        }
        let wide = w / STRIPS;
        let top = top_of_strips(h);
        for (number, strip) in self.strips.iter_mut().enumerate() {
            strip.clear();
            let columns = number * wide..(number + 1) * wide;
            strip.extend((top..h).map(|y| {
                let row = &luma.row(y)[columns.clone()];
                let sum: u32 = row.iter().map(|value| u32::from(*value)).sum();
                sum as f32 / wide.max(1) as f32
            }));
            self.near[number] = is_uniform(strip);
        }
    }
}

/// Whether the brightness has no step between neighbouring rows, so that the strip shows a single
/// object.
fn is_uniform(rows: &[f32]) -> bool {
    let step = |rows: &[f32]| {
        let sum = |rows: &[f32]| rows.iter().sum::<f32>() / REACH as f32;
        sum(&rows[..REACH]) - sum(&rows[REACH + 1..])
    };
    let mut steps = rows.windows(2 * REACH + 1).map(step);
    rows.iter().all(|row| USABLE_BRIGHTNESS.contains(row)) && steps.all(|step| step.abs() < STEP)
}

fn top_of_strips(height: usize) -> usize {
    (TOP * height as f64) as usize
}

fn rows_of_bands(height: usize) -> [(usize, usize); BANDS.len()] {
    let horizon = height / 2;
    let row = |share: f64| ((1.0 + share) * horizon as f64) as usize;
    BANDS.map(|(top, bottom)| (row(top), row(bottom)))
}

/// Decides whether the camera stood still between two pictures taken `apart` from each other, while
/// the robot should have made this movement. `ahead` is the greatest possible distance, in metres,
/// of whatever fills the picture, if known.
pub fn compare(
    before: &Profiles,
    now: &Profiles,
    camera: Camera,
    drive: Drive,
    apart: Duration,
    ahead: Option<f64>,
) -> Verdict {
    let (w, h) = now.size;
    let seconds = apart.as_secs_f64();
    let way = drive.forward * seconds;
    if before.size != now.size || w < 2 * STRIPS || h < 8 || way.abs() < LEAST_WAY {
        return Verdict::Unknown;
    }
    let focal = camera.focal_length(w as u32);
    // While the robot turns, everything shifts, whether it is held or not.
    if (focal * drive.turn * seconds).abs() >= LEAST_SHIFT {
        return Verdict::Unknown;
    }
    let reach = focal * LENS_HEIGHT;
    let moved = Moved {
        way,
        reach,
        near: std::array::from_fn(|strip| before.near[strip] && now.near[strip]),
        farthest: (reach / (h as f64 / 2.0)).min(ahead.unwrap_or(f64::INFINITY)),
    };
    let (fewest, surely) = if way < 0.0 {
        BACKWARDS
    } else {
        (FEWEST, STANDS)
    };
    let (mut most, mut stands, mut enough) = (0.0, false, false);
    for sway in -SWAY..=SWAY {
        let votes = moved.votes(before, now, sway);
        if votes.count() < fewest {
            continue;
        }
        // When driving forward, things on the left move to the left and things on the right move to
        // the right: for a sway, both sides must agree.
        let share = if sway == 0 {
            Some(votes.share())
        } else {
            votes.least_share(FEWEST_ASIDE)
        };
        stands |= share.is_some_and(|share| share >= surely);
        most = f64::max(most, votes.share());
        enough = true;
    }
    match most {
        _ if stands => Verdict::Stands,
        most if enough && most <= MOVES => Verdict::Moves,
        _ => Verdict::Unknown,
    }
}

/// One sample of a profile.
struct Sample {
    before: f64,
    now: f64,
    /// The expected value if the camera stood still or swayed.
    stood: f64,
    /// The expected value after the movement.
    moved: f64,
}

impl Sample {
    /// Adds a vote if the sample is a witness.
    fn vote(&self, right: bool, votes: &mut Votes) {
        let change = (self.moved - self.before).abs();
        if change >= WITNESS {
            let off = (self.now - self.stood).abs();
            votes.add(
                right,
                off < STILL * change && off < (self.now - self.moved).abs(),
            );
        }
    }
}

/// The expected movement between the pictures.
struct Moved {
    /// Metres driven forward.
    way: f64,
    /// For a point on the floor: depth times rows below the horizon.
    reach: f64,
    /// Strips without floor: everything in them is at most `farthest` metres away.
    near: [bool; STRIPS],
    farthest: f64,
}

impl Moved {
    fn votes(&self, before: &Profiles, now: &Profiles, sway: i32) -> Votes {
        let (mut votes, height) = (Votes::default(), now.size.1);
        let bands = before.bands.iter().zip(&now.bands);
        for ((before, now), (top, _)) in bands.zip(rows_of_bands(height)) {
            let rows = top as f64 - height as f64 / 2.0;
            self.vote_band(before, now, rows, sway, &mut votes);
        }
        let horizon = height as f64 / 2.0 - top_of_strips(height) as f64;
        for (strip, (before, now)) in before.strips.iter().zip(&now.strips).enumerate() {
            let right = 2 * strip >= STRIPS;
            self.vote_strip(before, now, horizon, |sample| {
                sample.vote(right, &mut votes);
            });
        }
        votes
    }

    /// The least magnification of what is seen this many rows below the horizon.
    fn growth(&self, rows: f64, near: bool) -> f64 {
        let floor = self.reach / rows.max(0.1);
        let depth = if near {
            floor.min(self.farthest)
        } else {
            floor
        };
        depth / (depth - self.way).max(0.05)
    }

    fn vote_band(&self, before: &[f32], now: &[f32], rows: f64, sway: i32, votes: &mut Votes) {
        let middle = before.len() as f64 / 2.0 - 0.5;
        let growth = [false, true].map(|near| self.growth(rows, near));
        for (column, value) in now.iter().enumerate() {
            let x = column as f64 - middle;
            let near = self.near[(column * STRIPS / now.len()).min(STRIPS - 1)];
            let from = x / growth[usize::from(near)];
            let swayed = at(before, column as f64 - f64::from(sway));
            let (Some(swayed), Some(moved)) = (swayed, at(before, middle + from)) else {
                continue;
            };
            if (x - from).abs() >= LEAST_SHIFT {
                let sample = Sample {
                    before: f64::from(before[column]),
                    now: f64::from(*value),
                    stood: swayed,
                    moved,
                };
                sample.vote(x > 0.0, votes);
            }
        }
    }

    fn vote_strip(&self, before: &[f32], now: &[f32], horizon: f64, mut vote: impl FnMut(&Sample)) {
        for (row, value) in now.iter().enumerate() {
            let y = row as f64 + 0.5 - horizon;
            let from = y / self.growth(y, false);
            let Some(moved) = at(before, from + horizon - 0.5) else {
                continue;
            };
            if y > 0.0 && (y - from).abs() >= LEAST_SHIFT {
                let stood = f64::from(before[row]);
                vote(&Sample {
                    before: stood,
                    now: f64::from(*value),
                    stood,
                    moved,
                });
            }
        }
    }
}

/// The linearly interpolated value at a position.
fn at(values: &[f32], place: f64) -> Option<f64> {
    if place < 0.0 {
        return None;
    }
    let index = place as usize;
    let left = f64::from(*values.get(index)?);
    let right = f64::from(*values.get(index + 1).unwrap_or(&values[index]));
    Some(left + (right - left) * place.fract())
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    use super::*;
    use crate::vision::Image;

    const AHEAD: Drive = Drive {
        forward: 0.2,
        turn: 0.0,
    };
    const CURVE: Drive = Drive {
        forward: 0.2,
        turn: 0.3,
    };
    const APART: Duration = Duration::from_millis(400);

    /// The view of a wall `far` metres ahead with pale stripes, 4 % darker and 0.09 m wide. They
    /// begin at these distances to the right of the wall's centre, in metres; each picture has
    /// different noise.
    fn wall(far: f64, aside: f64, stripes: &[f64], noise: u32) -> Profiles {
        let focal = Camera::default().focal_length(320);
        let picture = RgbImage::from_fn(320, 240, |column, row| {
            let x = (f64::from(column) - 159.5) * far / focal + aside;
            let dark = stripes.iter().any(|from| (*from..from + 0.09).contains(&x));
            let mixed = (column * 37 + row * 101 + noise * 7919).wrapping_mul(0x2C1B_3C6D) >> 24;
            Rgb([(if dark { 144 } else { 148 } + mixed % 7) as u8; 3])
        });
        profiles(&picture)
    }

    fn profiles(picture: &RgbImage) -> Profiles {
        let (mut luma, mut profiles) = (HalfLuma::default(), Profiles::default());
        luma.take(&Image::from_rgb(picture));
        profiles.take(&luma);
        profiles
    }

    fn verdict(before: &Profiles, now: &Profiles, drive: Drive) -> Verdict {
        compare(before, now, Camera::default(), drive, APART, None)
    }

    const BOTH_SIDES: [f64; 3] = [-0.25, -0.07, 0.11];

    #[test]
    fn pale_stripes_close_ahead_show_whether_the_robot_is_held() {
        let before = wall(0.4, 0.0, &BOTH_SIDES, 1);
        let held = wall(0.4, 0.0, &BOTH_SIDES, 2);
        assert_eq!(verdict(&before, &held, AHEAD), Verdict::Stands);
        for slower in [0.08, 0.06] {
            let driven = wall(0.4 - slower, 0.0, &BOTH_SIDES, 3);
            assert_ne!(verdict(&before, &driven, AHEAD), Verdict::Stands);
        }
    }

    #[test]
    fn an_edge_that_sways_on_one_side_alone_is_not_a_standstill() {
        let before = wall(0.4, 0.0, &[0.05], 1);
        for (far, aside) in [(0.4, -0.008), (0.38, 0.0), (0.34, 0.005)] {
            let now = wall(far, aside, &[0.05], 2);
            assert_ne!(verdict(&before, &now, AHEAD), Verdict::Stands);
        }
    }

    #[test]
    fn a_plain_wall_a_turn_a_curve_and_other_sizes_give_no_result() {
        let plain = wall(0.4, 0.0, &[], 1);
        let noisy = wall(0.4, 0.0, &[], 2);
        assert_eq!(verdict(&plain, &noisy, AHEAD), Verdict::Unknown);
        let stripes = wall(0.4, 0.0, &BOTH_SIDES, 3);
        let turn = Drive {
            forward: 0.0,
            turn: 1.0,
        };
        for drive in [turn, CURVE] {
            assert_eq!(verdict(&stripes, &stripes, drive), Verdict::Unknown);
        }
        for side in [0, 1, 2, 7, 16, 33] {
            let small = profiles(&RgbImage::from_pixel(side, side, Rgb([90; 3])));
            assert_eq!(verdict(&small, &stripes, AHEAD), Verdict::Unknown);
            assert_eq!(verdict(&small, &small, AHEAD), Verdict::Unknown);
        }
    }

    proptest! {
        #[test]
        fn any_picture_and_any_drive_give_a_verdict(
            pixels in proptest::collection::vec(any::<u8>(), 50 * 40), w in 1u32..50, h in 1u32..40,
            forward in -1e9f64..1e9, turn in -1e9f64..1e9, ahead in -1e9f64..1e9,
        ) {
            let picture = RgbImage::from_fn(w, h, |x, y| Rgb([pixels[(y * 50 + x) as usize]; 3]));
            let one = profiles(&picture);
            compare(&one, &one, Camera::default(), Drive { forward, turn }, APART, Some(ahead));
        }
    }
}
