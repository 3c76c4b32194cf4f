//! Blobs: connected pixels of one colour. Names, defaults and meanings follow OpenMV's
//! `find_blobs`.

mod regions;

use serde::{Deserialize, Serialize};

use self::regions::{Region, Regions};
use crate::camera::Camera;
use crate::colour::labeller::Labeller;
use crate::colour::palette::Palette;
use crate::picture::{Image, Roi, Size, Spans};

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

/// One region, or several after merging, before the derived values of a blob are computed.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    index: u32,
    region: Region,
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
                .map(|(index, region)| Candidate::new(index, region)),
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
        let Some(smallest) = self
            .kept
            .iter()
            .map(|kept| kept.region.moments.pixels)
            .min()
        else {
            return;
        };
        self.regions
            .measure_perimeters(|region| region.moments.pixels >= smallest);
        for kept in &mut self.kept {
            kept.region = self.regions.region(kept.index);
        }
    }
}

/// Largest first; equal ones in reading order.
fn order(Candidate { index, region, .. }: &Candidate) -> (std::cmp::Reverse<u64>, u32, u32, u32) {
    let pixels = std::cmp::Reverse(region.moments.pixels);
    (pixels, region.top, region.left, *index)
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
    fn new(index: u32, region: &Region) -> Candidate {
        Candidate {
            index,
            region: *region,
            code: 1 << (region.label - 1),
            count: 1,
        }
    }

    fn overlaps(&self, other: &Candidate, margin: u32) -> bool {
        let near = |low: u32, high: u32| low <= high.saturating_add(margin);
        let one = &self.region;
        let other = &other.region;
        near(one.left, other.right)
            && near(other.left, one.right)
            && near(one.top, other.bottom)
            && near(other.top, one.bottom)
    }

    fn absorb(&mut self, other: &Candidate) {
        self.region.absorb(&other.region);
        self.code |= other.code;
        self.count += other.count;
    }

    fn blob(&self, size: Size, camera: Camera) -> Blob {
        let region = &self.region;
        let w = region.right - region.left + 1;
        let h = region.bottom - region.top + 1;
        // Bounded by the number of pixels of the picture.
        let pixels = region.moments.pixels as u32;
        let area = w * h;
        let (cx, cy) = region.moments.centroid();
        let (rotation, roundness) = region.moments.axes();
        Blob {
            x: region.left,
            y: region.top,
            w,
            h,
            cx,
            cy,
            pixels,
            area,
            density: f64::from(pixels) / f64::from(area),
            rotation,
            elongation: 1.0 - roundness,
            roundness,
            perimeter: region.perimeter as u32,
            code: self.code,
            count: self.count,
            colour: self.code.trailing_zeros() as usize,
            bearing: camera.bearing(cx, cy, size),
            edge: region.left == 0
                || region.top == 0
                || region.right + 1 == size.width
                || region.bottom + 1 == size.height,
        }
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use imageproc::drawing::draw_filled_rect_mut;
    use imageproc::rect::Rect;

    use super::*;
    use crate::Colour;

    const RED: Rgb<u8> = Rgb([220, 20, 20]);
    const BLUE: Rgb<u8> = Rgb([20, 20, 220]);

    fn grey() -> RgbImage {
        RgbImage::from_pixel(320, 240, Rgb([120, 120, 120]))
    }

    fn find(pixels: RgbImage, names: &[&str], options: BlobOptions) -> Vec<Blob> {
        let colours: Vec<Colour> = names
            .iter()
            .map(|name| Colour::named(name).unwrap())
            .collect();
        let mut palette = Palette::compile(&colours, options.invert);
        BlobFinder::default()
            .find(
                &Image::from_rgb(&pixels),
                &mut palette,
                &options,
                Camera::default(),
            )
            .to_vec()
    }

    fn boxed(pixels: &mut RgbImage, x: i32, y: i32, w: u32, h: u32, colour: Rgb<u8>) {
        draw_filled_rect_mut(pixels, Rect::at(x, y).of_size(w, h), colour);
    }

    #[test]
    fn a_box_has_the_values_of_a_box() {
        let mut pixels = grey();
        boxed(&mut pixels, 40, 100, 30, 10, RED);
        let [blob] = find(pixels, &["red"], BlobOptions::default())[..] else {
            panic!("expected one blob")
        };
        assert_eq!((blob.x, blob.y, blob.w, blob.h), (40, 100, 30, 10));
        assert_eq!((blob.pixels, blob.area, blob.density), (300, 300, 1.0));
        assert_eq!((blob.cx, blob.cy), (54.5, 104.5));
        assert_eq!(blob.perimeter, 2 * 30 + 2 * 8);
        assert_eq!(
            (blob.code, blob.count, blob.colour, blob.edge),
            (1, 1, 0, false)
        );
        assert!(blob.rotation.abs() < 1e-9);
        assert!(
            (blob.roundness - 99.0 / 899.0).abs() < 1e-9,
            "ratio of the variances of 10 and of 30 pixels"
        );
        assert!((blob.roundness + blob.elongation - 1.0).abs() < 1e-12);
        assert!(blob.bearing > 0.0, "left of the middle is positive");
    }

    #[test]
    fn the_largest_come_first_and_their_number_is_limited() {
        let mut pixels = grey();
        for (index, size) in [12, 30, 20, 25].into_iter().enumerate() {
            boxed(&mut pixels, 10 + 50 * index as i32, 10, size, size, RED);
        }
        let sizes = |max_blobs| {
            let blobs = find(
                pixels.clone(),
                &["red"],
                BlobOptions {
                    max_blobs,
                    ..Default::default()
                },
            );
            blobs.iter().map(|blob| blob.w).collect::<Vec<_>>()
        };
        assert_eq!(sizes(32), [30, 25, 20, 12]);
        assert_eq!(sizes(2), [30, 25]);
        assert!(sizes(0).is_empty());
    }

    #[test]
    fn small_blobs_are_left_out() {
        let mut pixels = grey();
        boxed(&mut pixels, 10, 10, 3, 3, RED);
        boxed(&mut pixels, 50, 10, 5, 2, RED);
        assert_eq!(
            find(pixels.clone(), &["red"], BlobOptions::default()).len(),
            1
        );
        let all = BlobOptions {
            area_threshold: 0,
            pixels_threshold: 0,
            ..Default::default()
        };
        assert_eq!(find(pixels.clone(), &["red"], all.clone()).len(), 2);
        assert_eq!(
            find(
                pixels,
                &["red"],
                BlobOptions {
                    area_threshold: 11,
                    ..all
                }
            )
            .len(),
            0
        );
    }

    #[test]
    fn only_the_roi_is_searched() {
        let mut pixels = grey();
        boxed(&mut pixels, 100, 100, 40, 40, RED);
        let options = BlobOptions {
            roi: Some(Roi {
                x: 120,
                y: 0,
                w: 900,
                h: 110,
            }),
            ..Default::default()
        };
        let blob = find(pixels.clone(), &["red"], options)[0];
        assert_eq!(
            (blob.x, blob.y, blob.w, blob.h, blob.edge),
            (120, 100, 20, 10, false)
        );
        for (x, w) in [(320, 5), (5, 0), (u32::MAX, u32::MAX)] {
            let options = BlobOptions {
                roi: Some(Roi { x, y: 0, w, h: 9 }),
                ..Default::default()
            };
            assert_eq!(find(pixels.clone(), &["red"], options), []);
        }
    }

    #[test]
    fn blobs_of_several_colours_have_the_bit_of_their_colour() {
        let mut pixels = grey();
        boxed(&mut pixels, 10, 10, 40, 40, BLUE);
        boxed(&mut pixels, 50, 10, 30, 30, RED);
        let blobs = find(pixels, &["red", "blue"], BlobOptions::default());
        assert_eq!(
            blobs
                .iter()
                .map(|blob| (blob.code, blob.colour))
                .collect::<Vec<_>>(),
            [(2, 1), (1, 0)]
        );
    }

    #[test]
    fn merging_joins_nearby_boxes_and_their_codes() {
        let mut pixels = grey();
        boxed(&mut pixels, 10, 10, 20, 20, BLUE);
        boxed(&mut pixels, 34, 10, 20, 10, RED);
        boxed(&mut pixels, 200, 10, 15, 15, RED);
        let merge = |margin| BlobOptions {
            merge: true,
            margin,
            ..Default::default()
        };
        assert_eq!(find(pixels.clone(), &["red", "blue"], merge(3)).len(), 3);
        let blobs = find(pixels, &["red", "blue"], merge(5));
        assert_eq!(blobs.len(), 2);
        let both = blobs[0];
        assert_eq!(
            (both.code, both.colour, both.count, both.pixels),
            (3, 0, 2, 600)
        );
        assert_eq!((both.x, both.y, both.w, both.h), (10, 10, 44, 20));
        assert!((both.cx - (19.5 * 400.0 + 43.5 * 200.0) / 600.0).abs() < 1e-9);
    }

    #[test]
    fn a_merged_box_continues_to_merge() {
        let mut pixels = grey();
        // The third box lies within the bounding box of the first two, though near neither of them.
        boxed(&mut pixels, 10, 10, 60, 4, RED);
        boxed(&mut pixels, 72, 10, 4, 80, RED);
        boxed(&mut pixels, 20, 60, 6, 6, RED);
        let blobs = find(
            pixels,
            &["red"],
            BlobOptions {
                merge: true,
                margin: 4,
                ..Default::default()
            },
        );
        assert_eq!(blobs.len(), 1);
        assert_eq!(blobs[0].count, 3);
    }

    #[test]
    fn invert_finds_pixels_not_of_the_colour() {
        let mut pixels = RgbImage::from_pixel(320, 240, RED);
        boxed(&mut pixels, 100, 50, 20, 20, BLUE);
        let blobs = find(
            pixels,
            &["red"],
            BlobOptions {
                invert: true,
                ..Default::default()
            },
        );
        assert_eq!((blobs.len(), blobs[0].x, blobs[0].pixels), (1, 100, 400));
    }

    #[test]
    fn a_blob_at_the_border_is_marked() {
        for (x, y) in [(0, 100), (300, 100), (100, 0), (100, 220)] {
            let mut pixels = grey();
            boxed(&mut pixels, x, y, 20, 20, RED);
            assert!(find(pixels, &["red"], BlobOptions::default())[0].edge);
        }
    }

    #[test]
    fn worst_case_noise_is_bounded() {
        let pixels =
            RgbImage::from_fn(320, 240, |x, y| if x % 2 + y % 2 == 0 { RED } else { BLUE });
        let options = BlobOptions {
            area_threshold: 0,
            pixels_threshold: 0,
            merge: true,
            max_blobs: usize::MAX,
            ..Default::default()
        };
        assert!(find(pixels, &["red", "white"], options).len() <= MAX_MERGED);
    }
}
