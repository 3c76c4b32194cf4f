//! Detects motion in the view while the camera stands still. A lamp brightens everything in an area
//! by nearly the same factor; a moving thing does not. So each pixel is compared with its previous
//! value scaled by the change of its surroundings.

use serde::{Deserialize, Serialize};

use super::blobs::{Blob, BlobFinder, BlobOptions};
use super::camera::Camera;
use super::picture::{Image, Size, Spans};

/// Brightness limits beyond which a pixel is clipped and says nothing about the light.
const CLIPPED: (i32, i32) = (4, 250);
/// If more than this share of the picture changes at once, the cause was the light or the camera.
const MAX_MOVING: f64 = 0.5;
/// A change counts only if more than this many of the 3 by 3 pixels around it, itself included,
/// have changed.
const SUPPORT: u8 = 3;
/// If more than this share of the tiles with edges has changed, the camera has moved.
const MAX_TILES: f64 = 0.5;
/// The same applies to more than this share, if also more than [`MAX_NEW_TILES`] of the tiles that
/// have edges now have changed.
const MANY_TILES: f64 = 0.4;
const MAX_NEW_TILES: f64 = 0.6;

/// If at least this share of the picture, without what glares, has got brighter, or darker, by more
/// than [`LIGHT_CHANGE`], the light has changed. If then more than [`MAX_UNEVEN`] of the picture glares or
/// differs from the mean change by more than [`UNEVEN`], the borders of what the light has changed
/// differently change as a moving thing does.
const MOST: f64 = 0.75;
const LIGHT_CHANGE: u64 = 115; // percent
const MAX_UNEVEN: f64 = 0.1;
const UNEVEN: u64 = 125; // percent
/// The sum of a whole box that glares: a mean brightness of 240.
const GLARE: u64 = 240 * (2 * REACH as u64 + 1).pow(2);

/// What counts as motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MotionOptions {
    /// Least change of a pixel's brightness, of 255.
    pub threshold: u8,
    /// Least number of changed pixels.
    pub min_pixels: u32,
}

impl MotionOptions {
    /// The defaults.
    pub const DEFAULT: MotionOptions = MotionOptions {
        threshold: 15,
        min_pixels: 150,
    };
}

impl Default for MotionOptions {
    fn default() -> MotionOptions {
        MotionOptions::DEFAULT
    }
}

/// The motion since the previous frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion<'a> {
    /// Share of the picture that has changed, 0..1; 0 if fewer than `min_pixels` have.
    pub score: f64,
    /// Number of changed pixels; 0 if fewer than `min_pixels`.
    pub pixels: u32,
    /// The changed areas, largest first.
    pub blobs: &'a [Blob],
}

/// Compares each frame with the previous one.
#[derive(Debug, Default)]
pub struct MotionDetector {
    options: MotionOptions,
    camera: Camera,
    /// Width and height of the pictures of half size.
    half: (usize, usize),
    now: Vec<u8>,
    before: Vec<u8>,
    around_now: BoxSums,
    around_before: BoxSums,
    changed: Vec<u8>,
    moved: Vec<u8>,
    finder: BlobFinder,
}

impl MotionDetector {
    /// A detector without a previous frame.
    pub fn new(options: MotionOptions, camera: Camera) -> MotionDetector {
        MotionDetector {
            options,
            camera,
            ..MotionDetector::default()
        }
    }

    /// Forgets the previous frame; to be called while the camera moves.
    pub fn reset(&mut self) {
        self.half = (0, 0);
    }

    /// Detects what has moved since the previous frame. Finds nothing in the first frame and after
    /// a change of size.
    pub fn update(&mut self, image: &Image) -> Motion<'_> {
        let size = image.size();
        let half = (size.width as usize / 2, size.height as usize / 2);
        std::mem::swap(&mut self.now, &mut self.before);
        std::mem::swap(&mut self.around_now, &mut self.around_before);
        image.halve_luma(&mut self.now);
        self.around_now.sum(&self.now, half.0);
        let comparable = self.half == half && !self.now.is_empty();
        self.half = half;
        let cells = if comparable { self.compare() } else { 0 };
        let pixels = cells * 4;
        let share = f64::from(pixels) / (f64::from(size.width) * f64::from(size.height)).max(1.0);
        let too_few = pixels == 0 || pixels < self.options.min_pixels;
        let is_all = too_few || share > MAX_MOVING;
        if is_all || self.has_light_changed_unevenly() || self.has_camera_moved() {
            return Motion {
                score: 0.0,
                pixels: 0,
                blobs: &[],
            };
        }
        Motion {
            score: share.min(1.0),
            pixels,
            blobs: self.blobs(size),
        }
    }

    fn compare(&mut self) -> u32 {
        self.mark_changes();
        self.drop_isolated_changes();
        self.moved.iter().map(|moved| u32::from(*moved)).sum()
    }

    /// Whether most vertical edges are no longer where they were, because the robot was pushed or
    /// carried. A thing that moves through the view covers few of them. If about half of them are
    /// affected, the new edges decide: someone who comes into view close by brings many, but then
    /// the old edges have stayed.
    fn has_camera_moved(&self) -> bool {
        let share = |picture| share_of_changed(picture, &self.moved, self.half.0).unwrap_or(0.0);
        let gone = share(&self.before);
        gone > MAX_TILES || (gone > MANY_TILES && share(&self.now) > MAX_NEW_TILES)
    }

    fn has_light_changed_unevenly(&self) -> bool {
        let now = &self.around_now.sums;
        let before = &self.around_before.sums;
        let total = |sums: &[u32]| sums.iter().map(|sum| u64::from(*sum)).sum::<u64>().max(1);
        let even = [total(now), total(before)];
        let mut brighter = 0u32;
        let mut darker = 0u32;
        let mut uneven = 0u32;
        let mut glares = 0u32;
        for (now, before) in now.iter().zip(before) {
            let [now, before] = [u64::from(*now), u64::from(*before)];
            if now.min(before) >= GLARE {
                glares += 1;
                continue;
            }
            brighter += u32::from(exceeds(now, before, LIGHT_CHANGE));
            darker += u32::from(exceeds(before, now, LIGHT_CHANGE));
            let expected = before * even[0] / even[1];
            let differs = exceeds(now, expected, UNEVEN) || exceeds(expected, now, UNEVEN);
            uneven += u32::from(differs);
        }
        let all = now.len() as f64;
        let is_light = f64::from(brighter.max(darker)) >= MOST * (all - f64::from(glares));
        is_light && f64::from(uneven + glares) > MAX_UNEVEN * all
    }

    fn mark_changes(&mut self) {
        let threshold = i32::from(self.options.threshold.max(1));
        let clipped = |value: u8| i32::from(value) <= CLIPPED.0 || i32::from(value) >= CLIPPED.1;
        self.changed.clear();
        let pairs = self.now.iter().zip(&self.before);
        let sums = self.around_now.sums.iter().zip(&self.around_before.sums);
        self.changed.extend(pairs.zip(sums).map(
            |((&now, &before), (&around_now, &around_before))| {
                // now - before * around_now / around_before without the division; all products are
                // below 255^2 times 15^2.
                let around_now = around_now as i32 + 1;
                let around_before = around_before as i32 + 1;
                let rest = i32::from(now) * around_before - i32::from(before) * around_now;
                let both_clipped = clipped(now) && clipped(before);
                u8::from(!both_clipped && rest.abs() > threshold * around_before.max(around_now))
            },
        ));
    }

    fn drop_isolated_changes(&mut self) {
        let (w, h) = self.half;
        self.moved.clear();
        self.moved.resize(w * h, 0);
        for y in 1..h.saturating_sub(1) {
            let rows = [y - 1, y, y + 1].map(|y| &self.changed[y * w..][..w]);
            let moved = &mut self.moved[y * w..][..w];
            for x in 1..w.saturating_sub(1) {
                let support: u8 = rows
                    .iter()
                    .map(|row| row[x - 1] + row[x] + row[x + 1])
                    .sum();
                moved[x] = u8::from(rows[1][x] == 1 && support > SUPPORT);
            }
        }
    }

    fn blobs(&mut self, size: Size) -> &[Blob] {
        let (w, h) = self.half;
        let moved = &self.moved;
        let label_row = |y: u32, x: u32, row: &mut [u8]| {
            let y = (y as usize / 2).min(h - 1);
            for (label, x) in row.iter_mut().zip(x as usize..) {
                *label = moved[y * w + (x / 2).min(w - 1)];
            }
            Spans::ALL
        };
        let options = BlobOptions {
            merge: true,
            margin: 8,
            ..BlobOptions::default()
        };
        self.finder
            .find_labelled(size, label_row, &options, self.camera)
    }
}

/// Whether `one` is more than so many percent of `other`.
fn exceeds(one: u64, other: u64, percent: u64) -> bool {
    one * 100 > other * percent
}

/// Half the side of a box: this many pixels on each side of the pixel.
const REACH: usize = 7;

/// Sums over a square around every pixel; at the border the square is clipped.
#[derive(Debug, Default)]
struct BoxSums {
    sums: Vec<u32>,
    columns: Vec<u32>,
}

impl BoxSums {
    /// Computes the sums of rows of this width with two running sums: down every column, then along
    /// every row.
    fn sum(&mut self, values: &[u8], w: usize) {
        let h = values.len() / w.max(1);
        self.sums.clear();
        self.columns.clear();
        self.columns.resize(w, 0);
        let row = |y: usize| &values[y * w..][..w];
        for y in 0..REACH.min(h) {
            self.columns
                .iter_mut()
                .zip(row(y))
                .for_each(|(sum, value)| *sum += u32::from(*value));
        }
        for y in 0..h {
            if y + REACH < h {
                self.columns
                    .iter_mut()
                    .zip(row(y + REACH))
                    .for_each(|(sum, value)| *sum += u32::from(*value));
            }
            if y > REACH {
                self.columns
                    .iter_mut()
                    .zip(row(y - REACH - 1))
                    .for_each(|(sum, value)| *sum -= u32::from(*value));
            }
            let columns = &self.columns;
            let mut sum: u32 = columns.iter().take(REACH).sum();
            self.sums.extend((0..w).map(|x| {
                sum += columns.get(x + REACH).copied().unwrap_or(0);
                sum -= x.checked_sub(REACH + 1).map_or(0, |left| columns[left]);
                sum
            }));
        }
    }
}

/// Side of a tile of the half-size picture, pixels.
const TILE: usize = 10;
/// Moved pixels are also counted this far to the left and right of a tile.
const AROUND_A_TILE: usize = 3;
/// A vertical edge: a brightness difference of more than this between the pixels this far to each
/// side.
const EDGE: (i32, usize) = (25, 2);
/// Least number of edge pixels, or of moved pixels, for a tile to count.
const IN_A_TILE: u32 = 4;
/// Least number of tiles with edges needed to tell whether the camera moved.
const FEWEST_TILES: u32 = 8;

/// The share of the tiles with vertical edges of this half-size picture, of width `w`, in which pixels
/// have moved (a moving camera changes most of them); `None` if too few tiles have edges.
fn share_of_changed(picture: &[u8], moved_cells: &[u8], w: usize) -> Option<f64> {
    let h = picture.len() / w;
    let (contrast, reach) = EDGE;
    let mut tiles = 0u32;
    let mut changed = 0u32;
    for top in (0..h).step_by(TILE) {
        for left in (0..w).step_by(TILE) {
            let mut edges = 0;
            let mut moved = 0;
            for y in top..(top + TILE).min(h) {
                let row = &picture[y * w..][..w];
                for x in left.max(reach)..(left + TILE).min(w.saturating_sub(reach)) {
                    let step = i32::from(row[x + reach]) - i32::from(row[x - reach]);
                    edges += u32::from(step.abs() > contrast);
                }
                // An edge on the border of a tile may have moved into the next tile.
                let right = (left + TILE + AROUND_A_TILE).min(w);
                let cells = &moved_cells[y * w..][left.saturating_sub(AROUND_A_TILE)..right];
                moved += cells.iter().map(|cell| u32::from(*cell)).sum::<u32>();
            }
            if edges >= IN_A_TILE {
                tiles += 1;
                changed += u32::from(moved >= IN_A_TILE);
            }
        }
    }
    (tiles >= FEWEST_TILES).then(|| f64::from(changed) / f64::from(tiles))
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use imageproc::drawing::draw_filled_circle_mut;
    use proptest::prelude::*;

    use super::*;

    /// A room with furniture, lit with a brightness that may vary from left to right; the noise depends
    /// on `seed`.
    fn room(brightness: f64, slope: f64, ball: Option<(i32, i32)>, seed: u32) -> Image {
        let mut picture = RgbImage::from_fn(320, 240, |x, y| {
            let plank = if (x / 40 + y / 30).is_multiple_of(2) {
                110
            } else {
                80
            };
            let shelf = if (200..260).contains(&x) && (40..120).contains(&y) {
                40
            } else {
                plank
            };
            Rgb([shelf; 3])
        });
        if let Some(place) = ball {
            draw_filled_circle_mut(&mut picture, place, 18, Rgb([210, 180, 60]));
        }
        let mut state = seed;
        for (x, _, pixel) in picture.enumerate_pixels_mut() {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let noise = f64::from(state >> 29) - 4.0;
            let light = brightness + slope * f64::from(x) / 320.0;
            pixel.0 = pixel
                .0
                .map(|value| (f64::from(value) * light + noise).clamp(0.0, 255.0) as u8);
        }
        Image::from_rgb(&picture)
    }

    fn detector() -> MotionDetector {
        MotionDetector::new(MotionOptions::default(), Camera::default())
    }

    #[test]
    fn a_still_room_has_no_motion() {
        let mut detector = detector();
        for seed in 1..6 {
            assert_eq!(detector.update(&room(1.0, 0.0, None, seed)).pixels, 0);
        }
    }

    #[test]
    fn a_rolling_ball_is_motion_where_it_rolls() {
        let mut detector = detector();
        for step in 0..6 {
            let x = 60 + 12 * step;
            let motion = detector.update(&room(1.0, 0.0, Some((x, 150)), 9 + step as u32));
            if step > 0 {
                let blob = motion.blobs[0];
                assert!(motion.score > 0.002 && motion.pixels >= 150, "{motion:?}");
                assert!(
                    (blob.cx - f64::from(x - 6)).abs() < 12.0 && (blob.cy - 150.0).abs() < 12.0,
                    "{blob:?}"
                );
            }
        }
    }

    #[test]
    fn a_light_switched_on_is_not_motion() {
        for (brightness, slope) in [(1.8, 0.0), (1.3, 0.9), (0.5, 0.0), (2.4, -1.3)] {
            let mut detector = detector();
            detector.update(&room(1.0, 0.0, None, 1));
            let motion = detector.update(&room(brightness, slope, None, 2));
            assert_eq!(motion.pixels, 0, "light {brightness} {slope}");
            assert_eq!(detector.update(&room(brightness, slope, None, 3)).pixels, 0);
        }
    }

    /// A dim wall above a floor, and a box on the floor. A lamp on the ceiling lights floor and box.
    fn room_with_a_lamp(is_on: bool, ball: Option<i32>) -> Image {
        let mut picture = RgbImage::from_fn(320, 240, |x, y| {
            let is_box = (60..140).contains(&x) && (90..180).contains(&y);
            let light = if is_box || y >= 160 { 8.0 } else { 1.35 };
            let light = if is_on { light } else { 1.0 };
            let surface = if is_box { 28.0 } else { 25.0 };
            Rgb([(surface * light) as u8; 3])
        });
        if let Some(x) = ball {
            draw_filled_circle_mut(&mut picture, (x, 200), 18, Rgb([110, 110, 110]));
        }
        Image::from_rgb(&picture)
    }

    #[test]
    fn a_lamp_that_lights_the_floor_more_than_the_walls_is_not_motion() {
        for is_on in [true, false] {
            let mut detector = detector();
            detector.update(&room_with_a_lamp(!is_on, None));
            let motion = detector.update(&room_with_a_lamp(is_on, None));
            assert_eq!(motion.pixels, 0, "{motion:?}");
            detector.update(&room_with_a_lamp(is_on, Some(200)));
            let motion = detector.update(&room_with_a_lamp(is_on, Some(220)));
            assert!(motion.pixels > 150, "{motion:?}");
        }
    }

    #[test]
    fn a_ball_is_seen_even_while_the_light_changes() {
        let mut detector = detector();
        detector.update(&room(1.0, 0.0, Some((80, 150)), 1));
        let motion = detector.update(&room(1.5, 0.0, Some((100, 150)), 2));
        assert!(
            motion.pixels > 150 && (motion.blobs[0].cx - 90.0).abs() < 15.0,
            "{motion:?}"
        );
    }

    /// The room shifted to the right by `by` pixels.
    fn shifted(by: u32, ball: Option<(i32, i32)>) -> Image {
        let mut picture = RgbImage::from_fn(320, 240, |x, y| {
            let x = x + 400 - by;
            let plank = if (x / 40 + y / 30).is_multiple_of(2) {
                115
            } else {
                75
            };
            Rgb([plank; 3])
        });
        if let Some((x, y)) = ball {
            draw_filled_circle_mut(&mut picture, (x + by as i32, y), 18, Rgb([210, 180, 60]));
        }
        Image::from_rgb(&picture)
    }

    #[test]
    fn a_turned_camera_is_not_motion_and_a_ball_in_a_patterned_room_is() {
        for by in [5, 9, 15, 30] {
            let mut detector = detector();
            detector.update(&shifted(0, None));
            assert_eq!(detector.update(&shifted(by, None)).pixels, 0, "by {by}");
            assert_eq!(detector.update(&shifted(by, None)).pixels, 0, "by {by}");
            let motion = detector.update(&shifted(by, Some((100, 150))));
            assert!(motion.pixels >= 150, "by {by}: {motion:?}");
        }
    }

    /// A plain object beside stripes, some of which stay when the camera turns while others come into
    /// view.
    fn beside_a_plain_thing(turned: bool) -> Image {
        let picture = RgbImage::from_fn(320, 240, |x, _| {
            let striped = x < 130 || (turned && (160..260).contains(&x));
            let moved = if turned && x >= 90 { 6 } else { 0 };
            let stripe = if ((x + moved) / 12).is_multiple_of(2) {
                115
            } else {
                75
            };
            Rgb([if striped { stripe } else { 95 }; 3])
        });
        Image::from_rgb(&picture)
    }

    #[test]
    fn a_camera_turned_away_from_a_plain_object_is_not_motion() {
        let mut detector = detector();
        detector.update(&beside_a_plain_thing(false));
        let motion = detector.update(&beside_a_plain_thing(true));
        assert_eq!(motion.pixels, 0, "{motion:?}");
    }

    #[test]
    fn nothing_is_compared_after_a_reset_or_another_size() {
        let mut detector = detector();
        detector.update(&room(1.0, 0.0, Some((80, 150)), 1));
        detector.reset();
        assert_eq!(
            detector.update(&room(1.0, 0.0, Some((120, 150)), 1)).pixels,
            0
        );
        for side in [0, 1, 2, 3, 17] {
            let image = Image::from_rgb(&RgbImage::from_pixel(side, side, Rgb([9, 9, 9])));
            detector.update(&image);
            assert_eq!(detector.update(&image).pixels, 0);
        }
    }

    proptest! {
        #[test]
        fn box_sums_equal_those_added_pixel_by_pixel(
            (w, h) in (1usize..40, 1usize..30), values in proptest::collection::vec(any::<u8>(), 40 * 30),
        ) {
            let mut sums = BoxSums::default();
            sums.sum(&values[..w * h], w);
            for (index, sum) in sums.sums.iter().enumerate() {
                let around = |at: usize, limit: usize| at.saturating_sub(REACH)..(at + REACH + 1).min(limit);
                let rows = around(index / w, h);
                let plain: u32 =
                    rows.flat_map(|y| around(index % w, w).map(move |x| (x, y))).map(|(x, y)| u32::from(values[y * w + x])).sum();
                prop_assert_eq!(*sum, plain);
            }
        }
    }
}
