//! Blobs: connected pixels of one colour. Names, defaults and meanings follow OpenMV's
//! `find_blobs`.

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

/// Most blobs that are merged: merging compares each with every other.
const MAX_MERGED: usize = 512;
/// Most rounds of merging; in a picture that would need more, overlapping blobs remain.
const MAX_ROUNDS: u32 = 32;

/// What to look for and where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BlobOptions {
    /// The part of the picture to search; `None` for the whole picture.
    pub roi: Option<Roi>,
    /// Finds the pixels that are *not* of the colour.
    pub invert: bool,
    /// Least area of the bounding box, pixels.
    pub area_threshold: u32,
    /// Least number of pixels.
    pub pixels_threshold: u32,
    /// Merges blobs whose bounding boxes overlap.
    pub merge: bool,
    /// Largest gap, in pixels, between bounding boxes that are still merged.
    pub margin: u32,
    /// Most blobs to return; the largest are kept.
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

/// A region of one colour, or of several after merging.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct Blob {
    /// Left column of the bounding box.
    pub x: u32,
    /// Top row of the bounding box.
    pub y: u32,
    /// Width of the bounding box.
    pub w: u32,
    /// Height of the bounding box.
    pub h: u32,
    /// Column of the centroid, sub-pixel.
    pub cx: f64,
    /// Row of the centroid, sub-pixel.
    pub cy: f64,
    /// Number of pixels of the colour.
    pub pixels: u32,
    /// Area of the bounding box, `w * h`.
    pub area: u32,
    /// `pixels / area`, 0..1.
    pub density: f64,
    /// Direction of the major axis in radians, 0..pi: 0 is horizontal, increasing clockwise as seen
    /// in the picture.
    pub rotation: f64,
    /// 0 for a disc, towards 1 for a line: `1 - roundness`.
    pub elongation: f64,
    /// Second moment along the minor axis divided by that along the major axis: 1 for a disc or a
    /// square, 0 for a line.
    pub roundness: f64,
    /// Number of border pixels: those with at least one of their four neighbours outside the blob.
    pub perimeter: u32,
    /// One bit for each colour of the list that the blob contains: bit 0 is the first colour.
    pub code: u32,
    /// Number of blobs that were merged into this one; 1 without merging.
    pub count: u32,
    /// Index of the first colour of the list that the blob contains.
    pub colour: usize,
    /// Horizontal direction of the centroid in radians, left positive.
    pub bearing: f64,
    /// Whether the blob touches the border of the picture and may continue outside.
    pub edge: bool,
}

/// Finds blobs in one picture after another, reusing its buffers.
#[derive(Debug, Default)]
pub struct BlobFinder {
    regions: Regions,
    kept: Vec<Candidate>,
    blobs: Vec<Blob>,
}

/// A blob before its derived values are computed.
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
    /// Finds the blobs of a picture, largest first. The list is valid until the next call.
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

    /// Like [`BlobFinder::find`], but for the labels that `label_row(y, x, row)` writes for columns
    /// `x..`. Label 0 is background, and so is everything outside the returned spans.
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

    /// Keeps the regions that are large enough, largest first, and no more than can be merged or
    /// returned.
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

/// Largest first; equal ones in reading order.
fn order(candidate: &Candidate) -> (std::cmp::Reverse<u64>, u32, u32, u32) {
    (
        std::cmp::Reverse(candidate.moments.pixels),
        candidate.top,
        candidate.left,
        candidate.region,
    )
}

/// Merges blobs whose bounding boxes, extended by the margin, overlap, until none do or the limit
/// of rounds is reached.
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
        // Bounded by the number of pixels of the picture.
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
