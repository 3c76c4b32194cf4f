//! Blobs: connected pixels of one colour, with the names, defaults and meanings of OpenMV's `find_blobs`.

mod moments;
mod regions;

use serde::{Deserialize, Serialize};

use self::moments::Moments;
use self::regions::{Region, Regions};
use crate::vision::camera::Camera;
use crate::vision::colour::labeller::Labeller;
use crate::vision::colour::palette::Palette;
use crate::vision::picture::image::{Image, Roi};
use crate::vision::picture::size::Size;
use crate::vision::picture::spans::Spans;

/// Most blobs that are merged with each other: merging compares each with each.
const MAX_MERGED: usize = 512;
/// Most rounds of merging: a picture that is made to need more keeps blobs that overlap.
const MAX_ROUNDS: u32 = 32;

/// What to look for, and where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BlobOptions {
    /// Where to look; nothing for the whole picture.
    pub roi: Option<Roi>,
    /// Look for the pixels that are *not* of the colour.
    pub invert: bool,
    /// Smallest box, in pixels of area.
    pub area_threshold: u32,
    /// Smallest number of pixels.
    pub pixels_threshold: u32,
    /// Make one blob of those whose boxes overlap.
    pub merge: bool,
    /// By how many pixels the boxes may miss each other and still be merged.
    pub margin: u32,
    /// Most blobs to return; the largest stay.
    pub max_blobs: usize,
}

impl BlobOptions {
    /// The defaults.
    pub const DEFAULT: BlobOptions = BlobOptions {
        roi: None,
        invert: false,
        area_threshold: 10,
        pixels_threshold: 10,
        merge: false,
        margin: 0,
        max_blobs: 32,
    };
}

impl Default for BlobOptions {
    fn default() -> BlobOptions {
        BlobOptions::DEFAULT
    }
}

/// A patch of one colour, or of several when merged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Blob {
    /// Left column of its box.
    pub x: u32,
    /// Top row of its box.
    pub y: u32,
    /// Columns of its box.
    pub w: u32,
    /// Rows of its box.
    pub h: u32,
    /// Column of its centroid, sub-pixel.
    pub cx: f64,
    /// Row of its centroid, sub-pixel.
    pub cy: f64,
    /// How many pixels have the colour.
    pub pixels: u32,
    /// Pixels of its box, `w * h`.
    pub area: u32,
    /// `pixels / area`, 0..1.
    pub density: f64,
    /// Direction of its long axis in radians, 0..pi: 0 lies flat, growing clockwise as seen in the picture.
    pub rotation: f64,
    /// 0 for a disc, towards 1 for a line: `1 - roundness`.
    pub elongation: f64,
    /// Second moment across its long axis divided by that along it: 1 for a disc or a square, 0 for a line.
    pub roundness: f64,
    /// Its border pixels: those of which one of the four neighbours is not of the blob.
    pub perimeter: u32,
    /// One bit for each colour of the list that it has: bit 0 is the first.
    pub code: u32,
    /// How many blobs were merged into it; 1 without merging.
    pub count: u32,
    /// Index of the first colour of the list that it has.
    pub colour: usize,
    /// Direction of its centroid in radians, left positive.
    pub bearing: f64,
    /// Whether it touches the border of the picture, and may go on outside.
    pub edge: bool,
}

/// Finds blobs, one picture after the other, in the same buffers.
#[derive(Debug, Default)]
pub struct BlobFinder {
    regions: Regions,
    kept: Vec<Candidate>,
    blobs: Vec<Blob>,
}

/// A blob before its derived figures are worked out.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    region: u32,
    left: u32,
    right: u32,
    top: u32,
    bottom: u32,
    moments: Moments,
    perimeter: u64,
    code: u32,
    count: u32,
}

impl BlobFinder {
    /// The blobs of a picture, largest first; the list lives until the next call.
    ///
    /// The palette must have been compiled with the options' `invert`.
    pub fn find(
        &mut self,
        image: &Image,
        palette: &mut Palette,
        options: &BlobOptions,
        camera: Camera,
    ) -> &[Blob] {
        let mut labeller = Labeller::new(palette, image);
        let label_row = |y, x, row: &mut [u8]| labeller.label_row(y, x, row);
        self.find_labelled(image.size(), label_row, options, camera)
    }

    /// As [`BlobFinder::find`], of whatever labels `label_row(y, x, row)` writes for columns `x..`; 0 is background,
    /// and so is all that lies outside the spans that it returns.
    pub(crate) fn find_labelled(
        &mut self,
        size: Size,
        mut label_row: impl FnMut(u32, u32, &mut [u8]) -> Spans,
        options: &BlobOptions,
        camera: Camera,
    ) -> &[Blob] {
        self.blobs.clear();
        let Some(window) = options.roi.unwrap_or(size.into()).within(size) else {
            return &self.blobs;
        };
        self.regions
            .scan(window, |y, row| label_row(y, window.x, row));
        self.keep(options);
        self.add_perimeters();
        if options.merge {
            merge(&mut self.kept, options.margin);
            self.kept.sort_unstable_by_key(order);
        }
        self.kept.truncate(options.max_blobs);
        self.blobs.extend(
            self.kept
                .iter()
                .map(|candidate| candidate.blob(size, camera)),
        );
        &self.blobs
    }

    /// Keeps the regions that are large enough, largest first, and not more than can matter.
    fn keep(&mut self, options: &BlobOptions) {
        let large_enough = |region: &Region| {
            region.moments.pixels >= u64::from(options.pixels_threshold)
                && region.area() >= u64::from(options.area_threshold)
        };
        self.kept.clear();
        self.kept.extend(
            self.regions
                .found()
                .filter(|(_, region)| large_enough(region))
                .map(Candidate::new),
        );
        let most = if options.merge {
            MAX_MERGED
        } else {
            options.max_blobs
        };
        if most < self.kept.len() {
            self.kept.select_nth_unstable_by_key(most, order);
            self.kept.truncate(most);
        }
        self.kept.sort_unstable_by_key(order);
    }

    fn add_perimeters(&mut self) {
        let Some(smallest) = self.kept.iter().map(|kept| kept.moments.pixels).min() else {
            return;
        };
        self.regions
            .measure_perimeters(|region| region.moments.pixels >= smallest);
        for kept in &mut self.kept {
            kept.perimeter = self.regions.region(kept.region).perimeter;
        }
    }
}

/// Largest first; among equals the one that comes first in reading order.
fn order(candidate: &Candidate) -> (std::cmp::Reverse<u64>, u32, u32, u32) {
    (
        std::cmp::Reverse(candidate.moments.pixels),
        candidate.top,
        candidate.left,
        candidate.region,
    )
}

/// Makes one of those whose boxes, widened by the margin, overlap, until none do or it was tried often
/// enough.
fn merge(blobs: &mut Vec<Candidate>, margin: u32) {
    for _ in 0..MAX_ROUNDS {
        let mut merged = false;
        let mut i = 0;
        while i < blobs.len() {
            let mut j = i + 1;
            while j < blobs.len() {
                if blobs[i].overlaps(&blobs[j], margin) {
                    let other = blobs.swap_remove(j);
                    blobs[i].absorb(&other);
                    merged = true;
                } else {
                    j += 1;
                }
            }
            i += 1;
        }
        if !merged {
            return;
        }
    }
}

impl Candidate {
    fn new((index, region): (u32, &Region)) -> Candidate {
        Candidate {
            region: index,
            left: region.left,
            right: region.right,
            top: region.top,
            bottom: region.bottom,
            moments: region.moments,
            perimeter: 0,
            code: 1 << (region.label - 1),
            count: 1,
        }
    }

    fn overlaps(&self, other: &Candidate, margin: u32) -> bool {
        let near = |low: u32, high: u32| low <= high.saturating_add(margin);
        near(self.left, other.right)
            && near(other.left, self.right)
            && near(self.top, other.bottom)
            && near(other.top, self.bottom)
    }

    fn absorb(&mut self, other: &Candidate) {
        self.left = self.left.min(other.left);
        self.right = self.right.max(other.right);
        self.top = self.top.min(other.top);
        self.bottom = self.bottom.max(other.bottom);
        self.moments.absorb(&other.moments);
        self.perimeter += other.perimeter;
        self.code |= other.code;
        self.count += other.count;
    }

    fn blob(&self, size: Size, camera: Camera) -> Blob {
        let (w, h) = (self.right - self.left + 1, self.bottom - self.top + 1);
        // Bounded by the picture's pixels.
        let (pixels, area) = (self.moments.pixels as u32, w * h);
        let (cx, cy) = self.moments.centroid();
        let axes = self.moments.axes();
        Blob {
            x: self.left,
            y: self.top,
            w,
            h,
            cx,
            cy,
            pixels,
            area,
            density: f64::from(pixels) / f64::from(area),
            rotation: axes.rotation,
            elongation: 1.0 - axes.roundness,
            roundness: axes.roundness,
            perimeter: self.perimeter as u32,
            code: self.code,
            count: self.count,
            colour: self.code.trailing_zeros() as usize,
            bearing: camera.bearing(cx, cy, size),
            edge: self.left == 0
                || self.top == 0
                || self.right + 1 == size.width
                || self.bottom + 1 == size.height,
        }
    }
}

#[cfg(test)]
mod tests;
