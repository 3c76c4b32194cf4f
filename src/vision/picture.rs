//! A decoded picture.

use image::RgbImage;

use super::frame::Size;

/// A rectangle of pixels: origin top left, x right, y down. It may stick out of a picture; what
/// sticks out does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Roi {
    /// Left column.
    pub x: u32,
    /// Top row.
    pub y: u32,
    /// Columns.
    pub w: u32,
    /// Rows.
    pub h: u32,
}

impl Roi {
    /// The part inside a picture of this size; nothing when that is empty.
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

/// A decoded picture: red, green and blue, eight bits each.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    pub(super) size: Size,
    pub(super) rgb: Vec<u8>,
}

impl Image {
    /// A picture of these pixels, row by row.
    pub fn from_rgb(pixels: RgbImage) -> Image {
        let size = Size {
            width: pixels.width(),
            height: pixels.height(),
        };
        Image {
            size,
            rgb: pixels.into_raw(),
        }
    }

    /// Width and height.
    pub fn size(&self) -> Size {
        self.size
    }

    /// Red, green and blue (0..255) of column `x`, row `y`; nothing outside the picture.
    pub fn pixel(&self, x: u32, y: u32) -> Option<[u8; 3]> {
        let inside = x < self.size.width && y < self.size.height;
        inside.then(|| self.row(y)[x as usize])
    }

    /// A copy that can be drawn on and saved.
    pub fn to_rgb(&self) -> RgbImage {
        // The buffer always has three bytes for each pixel; an empty picture stands for one that has not.
        RgbImage::from_raw(self.size.width, self.size.height, self.rgb.clone()).unwrap_or_default()
    }

    /// The pixels of one row, which must be inside.
    pub(super) fn row(&self, y: u32) -> &[[u8; 3]] {
        let width = self.size.width as usize;
        &self.rgb.as_chunks().0[y as usize * width..][..width]
    }

    /// The bytes of a part of a row, which must be inside.
    pub(super) fn row_bytes(&self, y: u32, x: u32, w: u32) -> &[u8] {
        let start = (y * self.size.width + x) as usize * 3;
        &self.rgb[start..start + w as usize * 3]
    }

    /// The brightness of all pixels, row by row.
    pub(super) fn to_luma(&self) -> Vec<u8> {
        self.rgb.as_chunks().0.iter().copied().map(luma).collect()
    }

    /// The brightness of half as many columns and rows: means of two by two pixels; an odd last one is left out.
    pub(super) fn halve_luma(&self, halved: &mut Vec<u8>) {
        halved.clear();
        for y in 0..self.size.height / 2 {
            let upper = self.row(2 * y).as_chunks::<2>().0;
            let lower = self.row(2 * y + 1).as_chunks::<2>().0;
            let sum = |pair: &[[u8; 3]; 2]| u16::from(luma(pair[0])) + u16::from(luma(pair[1]));
            // The mean of four bytes is a byte.
            halved.extend(
                upper
                    .iter()
                    .zip(lower)
                    .map(|(up, low)| ((sum(up) + sum(low) + 2) / 4) as u8),
            );
        }
    }
}

/// How bright a pixel looks, 0..255: the luma of BT.601, as JPEG has it.
pub(super) fn luma([r, g, b]: [u8; 3]) -> u8 {
    // The weights add up to 2^16, so the result fits.
    ((19_595 * u32::from(r) + 38_470 * u32::from(g) + 7_471 * u32::from(b) + 32_768) >> 16) as u8
}
