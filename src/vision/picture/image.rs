//! A decoded picture.

use image::{Rgb, RgbImage};

use super::size::Size;
use super::space::{rgb_of, ycc_of};

/// A rectangle of pixels: origin top left, x right, y down. It may extend beyond a picture; the
/// part outside is ignored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
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

/// Samples of luma, Cb or Cr.
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
    /// Resizes the plane to this many columns and rows of samples.
    pub(crate) fn shape(&mut self, (columns, rows): (usize, usize), (across, down): (u32, u32)) {
        self.samples.resize(columns * rows, 128);
        self.stride = columns;
        (self.across, self.down) = (across, down);
    }

    /// The samples that cover pixel row `y`.
    pub(crate) fn row(&self, y: u32) -> &[u8] {
        &self.samples[(y >> self.down) as usize * self.stride..][..self.stride]
    }

    fn at(&self, x: u32, y: u32) -> u8 {
        self.row(y)[(x >> self.across) as usize]
    }
}

/// A decoded picture, stored like a JPEG: luma, Cb and Cr in separate planes.
#[derive(Debug, Clone)]
pub struct Image {
    pub(crate) size: Size,
    pub(crate) planes: [Plane; 3],
    /// A greyscale picture: only the first plane is used.
    pub(crate) grey: bool,
}

impl Default for Image {
    /// An empty picture.
    fn default() -> Self {
        Image {
            size: Size {
                width: 0,
                height: 0,
            },
            planes: Default::default(),
            grey: true,
        }
    }
}

impl Image {
    /// Converts these pixels, accurate to one level per channel.
    pub fn from_rgb(pixels: &RgbImage) -> Image {
        let mut image = Image::default();
        image.set_rgb(
            Size {
                width: pixels.width(),
                height: pixels.height(),
            },
            pixels.as_raw(),
        );
        image
    }

    /// Sets the picture from rows of pixels with three bytes each.
    pub(crate) fn set_rgb(&mut self, size: Size, rgb: &[u8]) {
        (self.size, self.grey) = (size, false);
        for plane in &mut self.planes {
            plane.shape((size.width as usize, size.height as usize), (0, 0));
        }
        let [luma, cb, cr] = self.planes.each_mut().map(|plane| plane.samples.iter_mut());
        for (pixel, ((luma, cb), cr)) in rgb.as_chunks::<3>().0.iter().zip(luma.zip(cb).zip(cr)) {
            [*luma, *cb, *cr] = ycc_of(*pixel);
        }
    }

    /// Sets the picture from rows of grey pixels.
    pub(crate) fn set_luma(&mut self, size: Size, luma: &[u8]) {
        (self.size, self.grey) = (size, true);
        self.planes[0].shape((size.width as usize, size.height as usize), (0, 0));
        self.planes[0].samples.copy_from_slice(luma);
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
