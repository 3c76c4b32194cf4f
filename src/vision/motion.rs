//! Detects motion in the view while the camera stands still.
//!
//! A lamp brightens everything in an area by nearly the same factor; a moving thing does not. So
//! each pixel is compared with its previous value scaled by the change of its surroundings; what
//! remains different has moved. Works on a picture of half the width and height, which is less
//! noisy.

mod edges;
mod sums;

use serde::{Deserialize, Serialize};

use self::sums::{BoxSums, Size2};
use super::blobs::{Blob, BlobFinder, BlobOptions};
use super::camera::Camera;
use crate::vision::picture::image::Image;
use crate::vision::picture::size::Size;
use crate::vision::picture::spans::Spans;

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
    half: Size2,
    now: Vec<u8>,
    before: Vec<u8>,
    /// Sums over the surroundings of every pixel in the current and the previous frame.
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
        self.half = Size2::default();
    }

    /// Detects what has moved since the previous frame. Finds nothing in the first frame and after
    /// a change of size.
    pub fn update(&mut self, image: &Image) -> Motion<'_> {
        let size = image.size();
        let half = Size2 {
            w: size.width as usize / 2,
            h: size.height as usize / 2,
        };
        std::mem::swap(&mut self.now, &mut self.before);
        std::mem::swap(&mut self.around_now, &mut self.around_before);
        image.halve_luma(&mut self.now);
        self.around_now.sum(&self.now, half);
        let comparable = self.half == half && half.w > 0 && half.h > 0;
        self.half = half;
        let cells = if comparable { self.compare() } else { 0 };
        let pixels = cells * 4;
        let share = f64::from(pixels) / (f64::from(size.width) * f64::from(size.height)).max(1.0);
        let too_few = pixels == 0 || pixels < self.options.min_pixels;
        if too_few || share > MAX_MOVING || self.has_camera_moved() {
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

    /// Marks the pixels that have moved and counts them.
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
        let share =
            |picture| edges::share_of_changed(picture, &self.moved, self.half).unwrap_or(0.0);
        let gone = share(&self.before);
        gone > MAX_TILES || (gone > MANY_TILES && share(&self.now) > MAX_NEW_TILES)
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

    /// Keeps a change only if enough of its neighbours changed too.
    fn drop_isolated_changes(&mut self) {
        let Size2 { w, h } = self.half;
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
        let Size2 { w, h } = self.half;
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

#[cfg(test)]
mod tests;
