//! Decides from two pictures whether the camera stood still although its robot should have moved.
//! Each picture is reduced to a few rows and columns of mean brightness; a sample that the movement
//! would change is a *witness*, and only if nearly all witnesses look unchanged has the camera
//! stood still. Without enough witnesses the result is unknown.

use std::time::Duration;

use super::camera::{Camera, Horizon};
use crate::picture::{Image, Size, remove_shading};

/// The bands of rows over which columns are averaged, as shares of the rows from the horizon to the
/// upper or lower edge of the picture.
const BANDS: [(f64, f64); 4] = [(-0.7, -0.35), (-0.35, 0.0), (0.25, 0.62), (0.62, 0.98)];
/// Vertical strips of the picture over which rows are averaged, and how far above the horizon they
/// begin, as a share of the height.
const STRIPS: usize = 8;
const TOP: f64 = 0.14;
const AHEAD: std::ops::Range<usize> = 3..5;
/// If the brightness of a strip changes by less than this from the rows above to the rows below
/// everywhere, of 255, it shows a single surface from above the height of the lens to the bottom.
const STEP: f32 = 1.8;
const STEP_ROWS: usize = 3;
/// Samples on each side of one of which the mean counts as shading.
const SHADING: usize = 10;
/// Brightness within which steps can be seen; darker or brighter strips may hide them.
const USABLE_BRIGHTNESS: std::ops::RangeInclusive<f32> = 20.0..=240.0;
/// Smallest shift that is evaluated, in pixels of half size; and that of a turn.
const LEAST_SHIFT: f64 = 1.5;
const LEAST_TURN: f64 = 8.0;
/// Least distance driven for a result, metres.
const LEAST_WAY: f64 = 0.01;
/// A sample is a witness if the movement changes it by at least this much, of 255. It votes for
/// standing still if it has changed by less than this share of that.
const WITNESS: f64 = 2.0;
const STILL: f64 = 0.4;
/// The camera stood still if at least this many witnesses are asked and this share of them says so;
/// more when the robot drives backwards, where nothing shows that a wall is still distant. It moved
/// if at most the last share says so.
const STANDS: (u32, f64) = (12, 0.75);
const STANDS_BACKWARDS: (u32, f64) = (24, 0.82);
const MOVES: f64 = 0.4;
/// Sideways shifts of the picture that still count as standing still, half-size pixels; then each
/// side of the picture must have this many witnesses and agree.
const MAX_SHIFT: i32 = 2;
const FEWEST_ASIDE: u32 = 4;

/// The movement that the tracks should produce.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drive {
    /// Metres per second, negative backwards.
    pub forward: f64,
    /// Radians per second, left positive.
    pub turn: f64,
}

impl Drive {
    /// Tracks that stand.
    pub const STILL: Drive = Drive {
        forward: 0.0,
        turn: 0.0,
    };
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

/// The mean brightness of a picture of half size along its columns and its rows, in bands and
/// strips, which follow a tilted horizon.
#[derive(Debug, Clone, Default)]
pub struct Profiles {
    luma: Vec<u8>,
    size: (usize, usize),
    layout: Layout,
    /// Without the shading.
    bands: [Vec<f32>; BANDS.len()],
    strips: [Vec<f32>; STRIPS],
    /// The strips without the shading.
    details: [Vec<f32>; STRIPS],
    /// A buffer.
    sums: Vec<f64>,
    /// Strips that show a single surface, and so no floor.
    plain: [bool; STRIPS],
}

/// Where bands and strips are in a picture of half size, at the horizon's middle.
#[derive(Debug, Clone, Default, PartialEq)]
struct Layout {
    horizon: Horizon,
    bands: [std::ops::Range<isize>; BANDS.len()],
    /// Rows of the strips, the first of which is above the horizon unless the picture shows no
    /// horizon.
    strips: std::ops::Range<isize>,
    /// Whether the strips begin above the horizon.
    shows_horizon: bool,
}

impl Layout {
    fn new(camera: Camera, width: usize, height: usize) -> Layout {
        let horizon = camera.horizon(Size {
            width: width as u32,
            height: height as u32,
        });
        let first = horizon.tilt(width as f64);
        let last = height as f64 - first;
        let middle = horizon.y + 0.5;
        let row = |share: f64| {
            let reach = if share < 0.0 {
                middle - first
            } else {
                last - middle
            };
            ((middle + share * reach.max(0.0)) as isize).clamp(first as isize, last as isize)
        };
        let top = middle - TOP * height as f64;
        let shows_horizon = top >= first;
        Layout {
            bands: BANDS.map(|(from, to)| row(from)..row(to)),
            strips: (top.max(first) as isize).min(last as isize)..last as isize,
            shows_horizon,
            horizon,
        }
    }

    /// Rows by which the horizon is lower in a column than in its middle.
    fn shift(&self, column: usize) -> isize {
        self.horizon.shift(column as f64).round() as isize
    }
}

impl Profiles {
    /// Computes the profiles of a picture; reuses the memory of `self`.
    pub fn take(&mut self, image: &Image, camera: Camera) {
        let Size { width, height } = image.size();
        let w = width as usize / 2;
        let h = height as usize / 2;
        self.size = (w, h);
        self.layout = Layout::new(camera, w, h);
        image.halve_luma(&mut self.luma);
        self.take_bands();
        self.take_strips();
    }

    fn take_bands(&mut self) {
        let (w, h) = self.size;
        let luma = &self.luma;
        let row = |y: isize| row_of(luma, w, y);
        let level = self.layout.horizon.slope == 0.0;
        let shifts: Vec<isize> = if level {
            Vec::new()
        } else {
            (0..w).map(|column| self.layout.shift(column)).collect()
        };
        for (band, rows) in self.bands.iter_mut().zip(&self.layout.bands) {
            band.clear();
            if w == 0 || h == 0 || rows.is_empty() {
                continue;
            }
            band.resize(w, 0.0);
            for y in rows.clone() {
                if level {
                    for (sum, value) in band.iter_mut().zip(row(y)) {
                        *sum += f32::from(*value);
                    }
                } else {
                    for (column, (sum, shift)) in band.iter_mut().zip(&shifts).enumerate() {
                        *sum += f32::from(row(y + shift)[column]);
                    }
                }
            }
            let rows = rows.len() as f32;
            band.iter_mut().for_each(|sum| *sum /= rows);
            remove_shading(band, SHADING, &mut self.sums);
        }
    }

    fn take_strips(&mut self) {
        let (w, h) = self.size;
        let luma = &self.luma;
        let row = |y: isize| row_of(luma, w, y);
        let wide = w / STRIPS;
        for (number, strip) in self.strips.iter_mut().enumerate() {
            let left = number * wide;
            let shift = self.layout.shift(left + wide / 2);
            let mean = |y: isize| {
                let part = &row(y + shift)[left..][..wide];
                let sum: u32 = part.iter().map(|value| u32::from(*value)).sum();
                sum as f32 / wide.max(1) as f32
            };
            strip.clear();
            if h > 0 {
                strip.extend(self.layout.strips.clone().map(mean));
            }
            self.plain[number] = self.layout.shows_horizon && is_plain(strip);
            self.details[number].clone_from(strip);
            remove_shading(&mut self.details[number], SHADING, &mut self.sums);
        }
    }

    /// The greatest possible distance, in metres, from the lens to what fills the picture ahead;
    /// `None` if floor may be visible there.
    pub fn nearer_than(&self, camera: Camera) -> Option<f64> {
        let (w, h) = self.size;
        if w < 2 * STRIPS || h < 8 || self.plain[AHEAD].contains(&false) {
            return None;
        }
        let size = Size {
            width: w as u32,
            height: h as u32,
        };
        let bottom = self.layout.strips.end as f64 - 0.5;
        let nearest = camera.floor_position(self.layout.horizon.x, bottom, size)?;
        Some(nearest.ahead)
    }

    /// How far below the horizon the foot of what stands ahead is, in half-size pixels: the edge
    /// that leaves the picture last when the robot drives on.
    pub fn foot_ahead(&self) -> Option<f64> {
        let top = self.layout.strips.start as f64;
        let horizon = (self.layout.horizon.y + 0.5 - top).max(0.0) as usize;
        let [left, right] = &self.strips[AHEAD] else {
            return None;
        };
        let rows = left.iter().zip(right).skip(horizon);
        let rows: Vec<f32> = rows.map(|(left, right)| (left + right) / 2.0).collect();
        let steps: Vec<f32> = steps(&rows).collect();
        let first = steps.iter().position(|step| *step >= STEP)?;
        // The step is visible from some rows above the edge on and is largest at the edge.
        let near = &steps[first..steps.len().min(first + 2 * STEP_ROWS + 1)];
        let weighted = near
            .iter()
            .zip(0u8..)
            .map(|(step, row)| step * f32::from(row));
        let middle = weighted.sum::<f32>() / near.iter().sum::<f32>();
        let row = (horizon + first + STEP_ROWS) as f64 + f64::from(middle);
        Some(top + row - self.layout.horizon.y)
    }
}

/// By how much the rows above each row differ from those below it.
fn steps(rows: &[f32]) -> impl Iterator<Item = f32> + '_ {
    let mean = |rows: &[f32]| rows.iter().sum::<f32>() / STEP_ROWS as f32;
    rows.windows(2 * STEP_ROWS + 1)
        .map(move |rows| (mean(&rows[..STEP_ROWS]) - mean(&rows[STEP_ROWS + 1..])).abs())
}

/// A row of a picture of this width. The layout leaves room for the shift; the clamp is for pictures
/// of a few pixels.
fn row_of(luma: &[u8], width: usize, y: isize) -> &[u8] {
    let last = (luma.len() / width.max(1)) as isize - 1;
    &luma[y.clamp(0, last.max(0)) as usize * width..][..width]
}

/// Whether the brightness has no step from the rows above to the rows below.
fn is_plain(rows: &[f32]) -> bool {
    let is_usable = rows.iter().all(|row| USABLE_BRIGHTNESS.contains(row));
    is_usable && steps(rows).all(|step| step < STEP)
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
    let focal = camera.focal_length(w as u32);
    let way = drive.forward * apart.as_secs_f64();
    let turned = focal * drive.turn * apart.as_secs_f64();
    let is_visible = if drive.forward == 0.0 {
        turned.abs() >= LEAST_TURN
    } else {
        // In a curve everything shifts, whether the robot is held or not.
        way.abs() >= LEAST_WAY && turned.abs() < LEAST_SHIFT
    };
    if before.size != now.size
        || before.layout != now.layout
        || w < 2 * STRIPS
        || h < 8
        || !is_visible
    {
        return Verdict::Unknown;
    }
    let horizon = now.layout.horizon;
    // A point on the floor is this deep, in the camera's frame, over the cosine of the pitch and the
    // rows below the horizon; driving reduces the depth by the cosine times the way.
    let reach = focal * camera.height;
    let pitch = camera.pitch.to_radians().cos();
    let expected = Expected {
        way: way * pitch * pitch,
        middle: horizon.x,
        turned,
        focal,
        reach,
        plain: std::array::from_fn(|strip| before.plain[strip] && now.plain[strip]),
        farthest: (reach / (h as f64 - 0.5 - horizon.y)).min(ahead.unwrap_or(f64::INFINITY)),
    };
    expected.verdict(before, now)
}

/// What the witnesses say, on the left and on the right.
#[derive(Debug, Default)]
struct Tally {
    asked: [u32; 2],
    still: [u32; 2],
}

impl Tally {
    fn count(&self) -> u32 {
        self.asked[0] + self.asked[1]
    }

    fn share(&self) -> f64 {
        f64::from(self.still[0] + self.still[1]) / f64::from(self.count().max(1))
    }

    /// The share on the side where it is smaller; 0 if a side has too few witnesses.
    fn least_share(&self) -> f64 {
        if self.asked.iter().any(|asked| *asked < FEWEST_ASIDE) {
            return 0.0;
        }
        let share = |side: usize| f64::from(self.still[side]) / f64::from(self.asked[side]);
        share(0).min(share(1))
    }

    /// Asks a sample, with its values in both pictures and those expected if the camera stood still
    /// (or shifted sideways) and if it moved.
    fn ask(&mut self, right: bool, before: f64, now: f64, stood: f64, moved: f64) {
        let change = (moved - before).abs();
        if change < WITNESS {
            return;
        }
        let off = (now - stood).abs();
        let is_still = off < STILL * change && off < (now - moved).abs();
        self.asked[usize::from(right)] += 1;
        self.still[usize::from(right)] += u32::from(is_still);
    }
}

struct Expected {
    way: f64,
    /// The column straight ahead.
    middle: f64,
    /// Half-size pixels by which a turn on the spot shifts the middle of the picture to the right.
    turned: f64,
    focal: f64,
    /// For a point on the floor: depth times rows below the horizon.
    reach: f64,
    /// Strips without floor: everything in them is at most `farthest` metres away.
    plain: [bool; STRIPS],
    farthest: f64,
}

impl Expected {
    fn verdict(&self, before: &Profiles, now: &Profiles) -> Verdict {
        let (fewest, surely) = if self.way < 0.0 {
            STANDS_BACKWARDS
        } else {
            STANDS
        };
        let mut most = None;
        for shift in -MAX_SHIFT..=MAX_SHIFT {
            let votes = self.votes(before, now, shift);
            if votes.count() < fewest {
                continue;
            }
            // When driving forward, things on the left move to the left and things on the right
            // move to the right: for a lateral shift, both sides must agree.
            let share = if shift == 0 {
                votes.share()
            } else {
                votes.least_share()
            };
            if share >= surely {
                return Verdict::Stands;
            }
            most = Some(f64::max(most.unwrap_or(0.0), votes.share()));
        }
        match most {
            Some(most) if most <= MOVES => Verdict::Moves,
            _ => Verdict::Unknown,
        }
    }

    fn votes(&self, before: &Profiles, now: &Profiles, shift: i32) -> Tally {
        let mut votes = Tally::default();
        let horizon = now.layout.horizon.y;
        let bands = before.bands.iter().zip(&now.bands);
        for ((before, now), band) in bands.zip(&now.layout.bands) {
            let rows = band.start as f64 - 0.5 - horizon;
            self.ask_band(before, now, rows, shift, &mut votes);
        }
        if self.way != 0.0 {
            let horizon = horizon + 0.5 - now.layout.strips.start as f64;
            for (strip, (before, now)) in before.details.iter().zip(&now.details).enumerate() {
                self.ask_strip(before, now, horizon, 2 * strip >= STRIPS, &mut votes);
            }
        }
        votes
    }

    /// The least magnification of what is seen this many rows below the horizon.
    fn growth(&self, rows: f64, plain: bool) -> f64 {
        let floor = self.reach / rows.max(0.1);
        let depth = if plain {
            floor.min(self.farthest)
        } else {
            floor
        };
        depth / (depth - self.way).max(0.05)
    }

    fn ask_band(&self, before: &[f32], now: &[f32], rows: f64, shift: i32, votes: &mut Tally) {
        let middle = self.middle;
        let growth = [false, true].map(|plain| self.growth(rows, plain));
        for (column, value) in now.iter().enumerate() {
            let x = column as f64 - middle;
            let plain = self.plain[(column * STRIPS / now.len()).min(STRIPS - 1)];
            let from = if self.way == 0.0 {
                x - self.turned * (1.0 + (x / self.focal).powi(2))
            } else {
                x / growth[usize::from(plain)]
            };
            let stood = at(before, column as f64 - f64::from(shift));
            let moved = at(before, middle + from);
            if let (Some(stood), Some(moved)) = (stood, moved)
                && (x - from).abs() >= LEAST_SHIFT
            {
                let before = f64::from(before[column]);
                votes.ask(x > 0.0, before, f64::from(*value), stood, moved);
            }
        }
    }

    fn ask_strip(&self, before: &[f32], now: &[f32], horizon: f64, right: bool, votes: &mut Tally) {
        for (row, value) in now.iter().enumerate() {
            let y = row as f64 + 0.5 - horizon;
            let from = y / self.growth(y, false);
            if y > 0.0
                && (y - from).abs() >= LEAST_SHIFT
                && let Some(moved) = at(before, from + horizon - 0.5)
            {
                let before = f64::from(before[row]);
                votes.ask(right, before, f64::from(*value), before, moved);
            }
        }
    }
}

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

    const DRIVES: Drive = Drive {
        forward: 0.2,
        turn: 0.0,
    };
    const TURNS: Drive = Drive {
        forward: 0.0,
        turn: 0.8,
    };
    const APART: Duration = Duration::from_millis(400);
    const BOTH_SIDES: [f64; 3] = [-0.25, -0.07, 0.11];

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
        let mut profiles = Profiles::default();
        profiles.take(&Image::from_rgb(picture), Camera::default());
        profiles
    }

    fn verdict(before: &Profiles, now: &Profiles, drive: Drive) -> Verdict {
        compare(before, now, Camera::default(), drive, APART, None)
    }

    #[test]
    fn pale_stripes_close_ahead_show_whether_the_robot_is_held() {
        let before = wall(0.4, 0.0, &BOTH_SIDES, 1);
        let held = wall(0.4, 0.0, &BOTH_SIDES, 2);
        assert_eq!(verdict(&before, &held, DRIVES), Verdict::Stands);
        for slower in [0.08, 0.06] {
            let driven = wall(0.4 - slower, 0.0, &BOTH_SIDES, 3);
            assert_ne!(verdict(&before, &driven, DRIVES), Verdict::Stands);
        }
    }

    #[test]
    fn an_edge_that_shifts_on_one_side_alone_is_not_a_standstill() {
        let before = wall(0.4, 0.0, &[0.05], 1);
        for (far, aside) in [(0.4, -0.008), (0.38, 0.0), (0.34, 0.005)] {
            let now = wall(far, aside, &[0.05], 2);
            assert_ne!(verdict(&before, &now, DRIVES), Verdict::Stands);
        }
    }

    #[test]
    fn a_robot_that_should_turn_but_does_not_stands_still() {
        let before = wall(1.0, 0.0, &BOTH_SIDES, 1);
        let held = wall(1.0, 0.0, &BOTH_SIDES, 2);
        assert_eq!(verdict(&before, &held, TURNS), Verdict::Stands);
        for turned in [0.32, 0.16] {
            let turned = wall(1.0, -turned, &BOTH_SIDES, 3);
            assert_ne!(verdict(&before, &turned, TURNS), Verdict::Stands);
        }
    }

    /// The corners of a genuine picture are darker than its middle, wherever the camera is.
    #[test]
    fn the_dark_corners_of_every_picture_are_no_sign_of_a_standstill() {
        let plain = |noise: u32| {
            profiles(&RgbImage::from_fn(320, 240, |x, y| {
                let corner = (159.5f64.powi(2) + 119.5f64.powi(2)).sqrt();
                let out = (f64::from(x) - 159.5).hypot(f64::from(y) - 119.5) / corner;
                let mixed = (x * 37 + y * 101 + noise * 7919).wrapping_mul(0x2C1B_3C6D) >> 24;
                let light = 180.0 * (1.0 - 0.45 * out.powi(2));
                Rgb([light as u8 + (mixed % 5) as u8; 3])
            }))
        };
        for forward in [0.1, 0.2, 0.35, -0.2] {
            let drive = Drive { forward, turn: 0.0 };
            assert_ne!(verdict(&plain(1), &plain(2), drive), Verdict::Stands);
        }
    }

    #[test]
    fn only_a_surface_that_hides_all_floor_ahead_is_near() {
        let camera = Camera::default();
        let near = wall(0.4, 0.0, &BOTH_SIDES, 1).nearer_than(camera);
        // The lens is 0.29 m above the floor, and 123.6 rows above the lower edge.
        assert!(
            (near.unwrap() - 0.29 * 379.87 / 123.6).abs() < 0.02,
            "{near:?}"
        );
        let with_floor = |row: u32| {
            profiles(&RgbImage::from_fn(320, 240, |_, y| {
                Rgb([if y < row { 150 } else { 144 }; 3])
            }))
        };
        assert_eq!(with_floor(225).nearer_than(camera), None);
        let foot = with_floor(200).foot_ahead().unwrap();
        assert!((foot - (199.5 - 115.91) / 2.0).abs() < 1.0, "{foot}");
        for grey in [0, 255] {
            let dazzled = profiles(&RgbImage::from_pixel(320, 240, Rgb([grey; 3])));
            assert_eq!(dazzled.nearer_than(camera), None);
        }
    }

    #[test]
    fn a_plain_wall_a_curve_and_pictures_of_other_sizes_give_no_result() {
        let plain = wall(0.4, 0.0, &[], 1);
        let noisy = wall(0.4, 0.0, &[], 2);
        for drive in [DRIVES, TURNS] {
            assert_eq!(verdict(&plain, &noisy, drive), Verdict::Unknown);
        }
        let stripes = wall(0.4, 0.0, &BOTH_SIDES, 3);
        let curve = Drive {
            forward: 0.2,
            turn: 0.3,
        };
        assert_eq!(verdict(&stripes, &stripes, curve), Verdict::Unknown);
        for side in [0, 1, 2, 7, 16, 33] {
            let small = profiles(&RgbImage::from_pixel(side, side, Rgb([90; 3])));
            assert_eq!(verdict(&small, &stripes, DRIVES), Verdict::Unknown);
            assert_eq!(verdict(&small, &small, DRIVES), Verdict::Unknown);
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
            for drive in [Drive { forward, turn }, Drive { forward: 0.0, turn }] {
                compare(&one, &one, Camera::default(), drive, APART, Some(ahead));
            }
        }
    }
}
