//! A decoded picture.

use std::ops::Range;

use image::{Rgb, RgbImage};
use serde::{Deserialize, Serialize};

/// A rectangle of pixels: origin top left, x right, y down. It may extend beyond a picture; the
/// part outside is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roi {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Number of columns.
    pub w: u32,
    /// Number of rows.
    pub h: u32,
}

impl Roi {
    /// The part inside a picture of this size; `None` if it is empty.
    pub fn within(self, size: Size) -> Option<Roi> {
        let w = self
            .x
            .saturating_add(self.w)
            .min(size.width)
            .checked_sub(self.x)?;
        let h = self
            .y
            .saturating_add(self.h)
            .min(size.height)
            .checked_sub(self.y)?;
        (w > 0 && h > 0).then_some(Roi { w, h, ..self })
    }
}

impl From<Size> for Roi {
    fn from(size: Size) -> Roi {
        Roi {
            x: 0,
            y: 0,
            w: size.width,
            h: size.height,
        }
    }
}

#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Plane {
    pub(crate) samples: Vec<u8>,
    /// Samples from one row to the next; at least the picture's width, rounded up to whole blocks.
    pub(crate) stride: usize,
    /// How many columns and rows of pixels share a sample (subsampling), as a power of two.
    pub(crate) across: u32,
    pub(crate) down: u32,
}

impl Plane {
    pub(crate) fn shape(&mut self, columns: usize, rows: usize, across: u32, down: u32) {
        self.samples.resize(columns * rows, 128);
        self.stride = columns;
        (self.across, self.down) = (across, down);
    }

    pub(crate) fn row(&self, y: u32) -> &[u8] {
        &self.samples[(y >> self.down) as usize * self.stride..][..self.stride]
    }

    fn at(&self, x: u32, y: u32) -> u8 {
        self.row(y)[(x >> self.across) as usize]
    }
}

/// A decoded picture, stored like a JPEG: luma, Cb and Cr in separate planes.
#[derive(Debug, Clone, Default)]
pub struct Image {
    pub(crate) size: Size,
    pub(crate) planes: [Plane; 3],
    /// A greyscale picture: only the first plane is used.
    pub(crate) grey: bool,
}

impl Image {
    /// Converts these pixels, accurate to one level per channel.
    pub fn from_rgb(pixels: &RgbImage) -> Image {
        let size = Size {
            width: pixels.width(),
            height: pixels.height(),
        };
        let mut image = Image {
            size,
            ..Image::default()
        };
        for plane in &mut image.planes {
            plane.shape(size.width as usize, size.height as usize, 0, 0);
        }
        let [luma, cb, cr] = image
            .planes
            .each_mut()
            .map(|plane| plane.samples.iter_mut());
        for (pixel, ((luma, cb), cr)) in pixels.pixels().zip(luma.zip(cb).zip(cr)) {
            [*luma, *cb, *cr] = ycc_of(pixel.0);
        }
        image
    }

    /// Width and height in pixels.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Red, green and blue (0..255) of column `x`, row `y`; `None` outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        (x < self.size.width && y < self.size.height).then(|| self.rgb_at(x, y))
    }

    /// Converts the picture to RGB, for drawing and saving.
    pub fn to_rgb(&self) -> RgbImage {
        RgbImage::from_fn(self.size.width, self.size.height, |x, y| {
            Rgb(self.rgb_at(x, y))
        })
    }

    fn rgb_at(&self, x: u32, y: u32) -> [u8; 3] {
        let [luma, cb, cr] = &self.planes;
        if self.grey {
            [luma.at(x, y); 3]
        } else {
            rgb_of([luma.at(x, y), cb.at(x, y), cr.at(x, y)]).map(|value| value as u8)
        }
    }

    /// The brightness of a row of pixels, 0..255.
    pub(crate) fn luma_row(&self, y: u32) -> &[u8] {
        &self.planes[0].row(y)[..self.size.width as usize]
    }

    /// Computes the brightness at half the width and height as means of 2 by 2 pixels; an odd last
    /// row or column is dropped.
    pub(crate) fn halve_luma(&self, halved: &mut Vec<u8>) {
        halved.clear();
        for y in 0..self.size.height / 2 {
            let upper = self.luma_row(2 * y).as_chunks::<2>().0;
            let lower = self.luma_row(2 * y + 1).as_chunks::<2>().0;
            let sum = |pair: &[u8; 2]| u16::from(pair[0]) + u16::from(pair[1]);
            // The mean of four bytes fits into a byte.
            halved.extend(
                upper
                    .iter()
                    .zip(lower)
                    .map(|(up, low)| ((sum(up) + sum(low) + 2) / 4) as u8),
            );
        }
    }
}

/// Widest picture that is decoded, in pixels.
pub const MAX_WIDTH: u32 = 1280;
/// Highest picture that is decoded, in pixels.
pub const MAX_HEIGHT: u32 = 1024;

/// Width and height in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
pub struct Size {
    /// Number of columns, 1..=[`MAX_WIDTH`].
    pub width: u32,
    /// Number of rows, 1..=[`MAX_HEIGHT`].
    pub height: u32,
}

/// Hue in degrees 0..360, saturation and value in percent, of sRGB values 0..255. Greys have hue 0.
pub(crate) fn hsv_of([r, g, b]: [f64; 3]) -> [f64; 3] {
    let max = r.max(g).max(b);
    let chroma = max - r.min(g).min(b);
    if chroma == 0.0 {
        return [0.0, 0.0, max / 2.55];
    }
    let sixth = if max == r {
        ((g - b) / chroma).rem_euclid(6.0)
    } else if max == g {
        (b - r) / chroma + 2.0
    } else {
        (r - g) / chroma + 4.0
    };
    [sixth * 60.0, chroma / max * 100.0, max / 2.55]
}

/// CIE Lab under D65 of sRGB values 0..255: L 0..100, a and b about -128..127.
pub(crate) fn lab_of(rgb: [f64; 3]) -> [f64; 3] {
    lab_of_linear(rgb.map(linear))
}

/// Linear light of an sRGB value 0..255, in 0..1.
pub(crate) fn linear(value: f64) -> f64 {
    let value = value / 255.0;
    if value <= 0.04045 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
}

/// CIE Lab of linear light: sRGB primaries, white D65.
pub(crate) fn lab_of_linear([r, g, b]: [f64; 3]) -> [f64; 3] {
    let x = (0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b) / 0.950_47;
    let y = 0.212_672_9 * r + 0.715_152_2 * g + 0.072_175_0 * b;
    let z = (0.019_333_9 * r + 0.119_192_0 * g + 0.950_304_1 * b) / 1.088_83;
    let [fx, fy, fz] = [x, y, z].map(lightness_curve);
    [116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)]
}

fn lightness_curve(t: f64) -> f64 {
    const KNEE: f64 = 216.0 / 24_389.0;
    if t > KNEE {
        t.cbrt()
    } else {
        (24_389.0 / 27.0 * t + 16.0) / 116.0
    }
}

/// Luma, Cb and Cr (0..255) of a pixel, as in JPEG (JFIF, full range).
pub(crate) fn ycc_of(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(i32::from);
    let luma = 19_595 * r + 38_470 * g + 7_471 * b;
    let cb = -11_058 * r - 21_710 * g + 32_768 * b + (128 << 16);
    let cr = 32_768 * r - 27_439 * g - 5_329 * b + (128 << 16);
    [luma, cb, cr].map(|value| ((value + 32_768) >> 16).clamp(0, 255) as u8)
}

/// Red, green and blue (0..=255) of luma, Cb and Cr.
pub(crate) fn rgb_of([luma, cb, cr]: [u8; 3]) -> [i32; 3] {
    let luma = i32::from(luma) << 16;
    let cb = i32::from(cb) - 128;
    let cr = i32::from(cr) - 128;
    [
        luma + 91_881 * cr,
        luma - 22_554 * cb - 46_802 * cr,
        luma + 116_130 * cb,
    ]
    .map(|value| ((value + 32_768) >> 16).clamp(0, 255))
}

pub(crate) fn rgb_of_ycc([luma, cb, cr]: [f64; 3]) -> [f64; 3] {
    let cb = cb - 128.0;
    let cr = cr - 128.0;
    [
        luma + 1.402 * cr,
        luma - 0.344_136 * cb - 0.714_136 * cr,
        luma + 1.772 * cb,
    ]
    .map(|value| value.clamp(0.0, 255.0))
}

/// A set of groups of [`Spans::GROUP`] columns, one bit each, counted from the start of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Spans(u128);

impl Spans {
    pub(crate) const GROUP: usize = 16;
    pub(crate) const ALL: Spans = Spans(u128::MAX);
    pub(crate) const NONE: Spans = Spans(0);

    /// Adds a group. Picture widths are limited so that every group has a bit.
    #[inline(always)]
    pub(crate) fn add(&mut self, group: usize) {
        const { assert!(MAX_WIDTH as usize <= 128 * Spans::GROUP) };
        self.0 |= 1 << (group % 128);
    }

    /// Adds groups from `first` on, one bit per group, the lowest bit first.
    #[inline(always)]
    pub(crate) fn add_bits(&mut self, first: usize, bits: u32) {
        self.0 |= u128::from(bits) << (first % 128);
    }

    pub(crate) fn groups(self, count: usize) -> impl Iterator<Item = usize> {
        let mut left = self.0;
        std::iter::from_fn(move || {
            let group = left.trailing_zeros() as usize;
            left &= left.wrapping_sub(1);
            (group < count).then_some(group)
        })
    }

    /// The column ranges in a row of this width, from left to right; neighbouring groups are
    /// joined.
    pub(crate) fn ranges(self, width: usize) -> impl Iterator<Item = Range<usize>> {
        let mut left = self.0;
        let groups = width.div_ceil(Spans::GROUP);
        std::iter::from_fn(move || {
            let start = left.trailing_zeros() as usize;
            if start >= groups {
                return None;
            }
            let end = start + (left >> start).trailing_ones() as usize;
            left &= u128::MAX.checked_shl(end as u32).unwrap_or(0);
            Some(start * Spans::GROUP..width.min(end * Spans::GROUP))
        })
    }
}

/// Mean brightness of a part of a picture, 0 (black) to 1 (white); 0 for a part outside it.
pub fn brightness(image: &Image, roi: Option<Roi>) -> f64 {
    let Some(part) = roi.unwrap_or(image.size().into()).within(image.size()) else {
        return 0.0;
    };
    let row_sum = |row: &[u8]| row.iter().map(|value| u32::from(*value)).sum::<u32>();
    let sum: u64 = rows(image, part).map(|row| u64::from(row_sum(row))).sum();
    sum as f64 / (255.0 * f64::from(part.w) * f64::from(part.h))
}

/// The sharpness of a part of a picture: the variance of its Laplacian. It is 0 for an even
/// surface, tens for a blurred picture, and hundreds to thousands for a sharp one. Only comparable
/// between pictures of the same scene. 0 for a part smaller than 3x3.
pub fn sharpness(image: &Image, roi: Option<Roi>) -> f64 {
    let Some(part) = roi.unwrap_or(image.size().into()).within(image.size()) else {
        return 0.0;
    };
    if part.w < 3 || part.h < 3 {
        return 0.0;
    }
    let mut sum = 0i64;
    let mut squares = 0i64;
    let below = rows(image, part).skip(2);
    for ((above, here), below) in rows(image, part).zip(rows(image, part).skip(1)).zip(below) {
        let (row_sum, row_squares) = edges(above, here, below);
        sum += i64::from(row_sum);
        squares += i64::from(row_squares);
    }
    let count = f64::from(part.w - 2) * f64::from(part.h - 2);
    let mean = sum as f64 / count;
    (squares as f64 / count - mean * mean).max(0.0)
}

/// Sum and sum of squares of a row's Laplacian. At most 1,280 values below 1,021 each, so neither
/// overflows.
fn edges(above: &[u8], here: &[u8], below: &[u8]) -> (i32, i32) {
    let end = here.len() - 1;
    // Slices of provably equal length let the compiler vectorise the loop.
    let left = &here[..end - 1];
    let middle = &here[1..end];
    let right = &here[2..];
    let above = &above[1..end];
    let below = &below[1..end];
    let mut sum = 0;
    let mut squares = 0;
    for x in 0..middle
        .len()
        .min(above.len())
        .min(below.len())
        .min(left.len())
        .min(right.len())
    {
        let around = [left[x], right[x], above[x], below[x]].map(i32::from);
        let edge = 4 * i32::from(middle[x]) - around.iter().sum::<i32>();
        sum += edge;
        squares += edge * edge;
    }
    (sum, squares)
}

fn rows(image: &Image, part: Roi) -> impl Iterator<Item = &[u8]> {
    (part.y..part.y + part.h)
        .map(move |y| &image.luma_row(y)[part.x as usize..(part.x + part.w) as usize])
}

/// Leaves of each sample by how much it differs from the mean of those around it. What falls off
/// slowly does so for the lens and not for the room: it stays where it is when the robot drives.
/// `sums` is a buffer.
pub(crate) fn remove_shading(samples: &mut [f32], reach: usize, sums: &mut Vec<f64>) {
    sums.clear();
    sums.push(0.0);
    sums.extend(samples.iter().scan(0.0, |sum, sample| {
        *sum += f64::from(*sample);
        Some(*sum)
    }));
    let last = samples.len().saturating_sub(1);
    for (index, sample) in samples.iter_mut().enumerate() {
        let reach = reach.min(index).min(last - index);
        let around = sums[index + reach + 1] - sums[index - reach];
        *sample -= (around / (2 * reach + 1) as f64) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn near(found: [f64; 3], expected: [f64; 3]) {
        let far = found
            .iter()
            .zip(expected)
            .any(|(f, e)| (f - e).abs() > 0.02);
        assert!(!far, "{found:?} is not {expected:?}");
    }

    #[test]
    fn known_colours_have_their_known_lab() {
        near(lab_of([255.0, 255.0, 255.0]), [100.0, 0.0, 0.0]);
        near(lab_of([0.0, 0.0, 0.0]), [0.0, 0.0, 0.0]);
        near(lab_of([255.0, 0.0, 0.0]), [53.24, 80.09, 67.20]);
        near(lab_of([0.0, 0.0, 255.0]), [32.30, 79.19, -107.86]);
    }

    #[test]
    fn colours_survive_the_round_trip_through_luma_cb_and_cr() {
        for step in 0..4096u32 {
            let rgb = [step >> 8, step >> 4 & 15, step & 15].map(|value| (value * 17) as u8);
            let back = rgb_of(ycc_of(rgb));
            assert!(
                rgb.iter()
                    .zip(back)
                    .all(|(a, b)| i32::from(*a).abs_diff(b) <= 2),
                "{rgb:?} {back:?}"
            );
        }
        assert_eq!(ycc_of([255, 0, 0]), [76, 85, 255]);
        assert_eq!(rgb_of([76, 85, 255]).map(|value| value as u8), [254, 0, 0]);
    }

    #[test]
    fn known_colours_have_their_known_hsv() {
        near(hsv_of([255.0, 0.0, 0.0]), [0.0, 100.0, 100.0]);
        near(hsv_of([255.0, 0.0, 1.0]), [359.76, 100.0, 100.0]);
        near(hsv_of([0.0, 255.0, 255.0]), [180.0, 100.0, 100.0]);
        near(hsv_of([51.0, 51.0, 51.0]), [0.0, 0.0, 20.0]);
    }

    #[test]
    fn neighbouring_groups_are_joined_and_the_last_range_ends_with_the_row() {
        let mut spans = Spans::NONE;
        spans.add_bits(0, 0b10011);
        spans.add(9);
        let found: Vec<_> = spans.ranges(150).collect();
        assert_eq!(found, [0..32, 64..80, 144..150]);
        assert_eq!(spans.groups(9).collect::<Vec<_>>(), [0, 1, 4]);
        let found: Vec<_> = spans.ranges(144).collect();
        assert_eq!(found, [0..32, 64..80]);
        let mut whole = Spans::ALL.ranges(1280);
        assert_eq!((whole.next(), whole.next()), (Some(0..1280), None));
        assert_eq!(Spans::NONE.ranges(1280).count(), 0);
    }

    fn stripes() -> RgbImage {
        RgbImage::from_fn(64, 48, |x, _| {
            Rgb(if x / 8 % 2 == 0 { [230; 3] } else { [30; 3] })
        })
    }

    #[test]
    fn blur_lowers_sharpness_and_an_even_surface_has_none() {
        let sharp = sharpness(&Image::from_rgb(&stripes()), None);
        let blurred = sharpness(
            &Image::from_rgb(&imageproc::filter::gaussian_blur_f32(&stripes(), 1.5)),
            None,
        );
        assert!(sharp > 4.0 * blurred && blurred > 1.0, "{sharp} {blurred}");
        let even = Image::from_rgb(&RgbImage::from_pixel(64, 48, Rgb([77; 3])));
        assert_eq!(sharpness(&even, None), 0.0);
    }

    #[test]
    fn parts_outside_and_parts_too_small_have_none() {
        let image = Image::from_rgb(&stripes());
        for roi in [
            Roi {
                x: 64,
                y: 0,
                w: 9,
                h: 9,
            },
            Roi {
                x: 62,
                y: 0,
                w: 9,
                h: 9,
            },
            Roi {
                x: 0,
                y: 0,
                w: 2,
                h: 9,
            },
        ] {
            assert_eq!(sharpness(&image, Some(roi)), 0.0);
        }
        assert_eq!(
            brightness(
                &image,
                Some(Roi {
                    x: 64,
                    y: 0,
                    w: 9,
                    h: 9
                })
            ),
            0.0
        );
        let bright = brightness(
            &image,
            Some(Roi {
                x: 0,
                y: 0,
                w: 8,
                h: 9,
            }),
        );
        assert!((bright - 230.0 / 255.0).abs() < 1e-9);
    }
}
