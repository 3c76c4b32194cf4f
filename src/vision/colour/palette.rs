//! Colours compiled into one table, so that classifying a pixel costs one look-up however many
//! colours there are.
//!
//! The table is indexed by luma, Cb and Cr, as in JPEG: pixels are never converted to RGB. For each
//! pair of Cb and Cr it has a row of 64 brightness levels, computed exactly when the pair first
//! occurs in a picture. So compiling is fast, a picture touches few cache lines, and all pairs
//! without any colour share one row.

use super::Colour;
use super::cells::Cells;
use crate::vision::picture::image::{Image, Plane};
use crate::vision::picture::space::{hsv_of, lab_of_linear, linear, rgb_of_ycc};

/// Number of bits of Cb and of Cr that are used.
const CHROMA_BITS: u32 = 7;
const PAIRS: usize = 1 << (2 * CHROMA_BITS);
/// Number of brightness levels.
const LEVELS: usize = 64;

/// Most colours in one [`Palette`].
pub const MAX_COLOURS: usize = 32;

/// For each brightness level 0, or 1 + the index of the first matching colour.
pub(super) type Row = [u8; LEVELS];

/// Marks a pair that has not occurred yet, and the row of all pairs without any colour.
const UNKNOWN: u16 = 0;
pub(super) const NO_COLOUR_ROW: u16 = 1;

/// A compiled list of colours, ready to classify whole pictures.
#[derive(Debug, Clone)]
pub struct Palette {
    colours: Vec<Colour>,
    invert: bool,
    has_lab: bool,
    /// Linear light of each sRGB value.
    linear: Box<[f64; 256]>,
    /// The row number of each pair of Cb and Cr.
    index: Box<[u16; PAIRS]>,
    rows: Vec<Row>,
    /// The parts of the Cb-Cr plane that are known to have no colour.
    pub(super) cells: Cells,
    /// Buffer for the row numbers of a row of pixels.
    pub(super) numbers: Vec<u16>,
}

impl Palette {
    /// Compiles the first [`MAX_COLOURS`] of `colours`.
    ///
    /// A pixel belongs to the first colour that matches it, as in OpenMV; with `invert`, to the
    /// first colour that does *not* match it.
    pub fn compile(colours: &[Colour], invert: bool) -> Palette {
        let colours = first(colours).to_vec();
        let has_lab = colours
            .iter()
            .any(|colour| matches!(colour, Colour::Lab { .. }));
        let linear = Box::new(std::array::from_fn(|value| linear(value as f64)));
        let index = Box::new([UNKNOWN; PAIRS]);
        Palette {
            colours,
            invert,
            has_lab,
            linear,
            index,
            rows: vec![[0; LEVELS]; 2],
            cells: Cells::default(),
            numbers: Vec::new(),
        }
    }

    /// The compiled colours.
    pub fn colours(&self) -> &[Colour] {
        &self.colours
    }

    /// Whether the palette was compiled from these colours and this `invert`.
    pub fn is_of(&self, colours: &[Colour], invert: bool) -> bool {
        self.invert == invert && self.colours == first(colours)
    }

    /// Index of the first colour that matches the pixel in column `x`, row `y`; `None` also outside
    /// the picture.
    pub fn colour_at(&mut self, image: &Image, x: u32, y: u32) -> Option<usize> {
        image.pixel(x, y)?;
        let at = |plane: &Plane| plane.row(y)[(x >> plane.across) as usize];
        let [luma, cb, cr] = &image.planes;
        let (cb, cr) = if image.grey {
            (128, 128)
        } else {
            (at(cb), at(cr))
        };
        let row = self.row_number(pair_of(cb, cr));
        let label = self.row(row)[level(at(luma))];
        label.checked_sub(1).map(usize::from)
    }

    /// Whether no pixel with this Cb and Cr has a label. Slow for a pair that has not occurred yet.
    pub(super) fn has_no_colour(&mut self, pair: u16) -> bool {
        let index = usize::from(pair) % PAIRS;
        if self.index[index] == UNKNOWN {
            let labels = |level| self.label_of(index, level);
            if (0..LEVELS).all(|level| labels(level) == 0) {
                self.index[index] = NO_COLOUR_ROW;
            }
        }
        self.index[index] == NO_COLOUR_ROW
    }

    /// The number of the row with the labels for this Cb and Cr.
    #[inline(always)]
    pub(super) fn row_number(&mut self, pair: u16) -> u16 {
        match self.index[usize::from(pair) % PAIRS] {
            UNKNOWN => self.compute_row(pair.into()),
            row => row,
        }
    }

    /// The labels of a row, indexed by [`level`].
    #[inline(always)]
    pub(super) fn row(&self, number: u16) -> &Row {
        &self.rows[usize::from(number)]
    }

    /// Computes the row of a pair that occurs for the first time.
    #[cold]
    fn compute_row(&mut self, pair: usize) -> u16 {
        let labels: Row = std::array::from_fn(|level| self.label_of(pair, level));
        let row = if labels == self.rows[usize::from(NO_COLOUR_ROW)] {
            NO_COLOUR_ROW
        } else {
            self.rows.push(labels);
            // There are fewer pairs than `u16` values.
            self.rows.len() as u16 - 1
        };
        self.index[pair] = row;
        row
    }

    /// The label of a pair at a brightness level.
    fn label_of(&self, pair: usize, level: usize) -> u8 {
        let chroma = |value: usize| (value * 2) as f64 + 0.5;
        let cb = chroma(pair >> CHROMA_BITS);
        let cr = chroma(pair & ((1 << CHROMA_BITS) - 1));
        // Levels cover the full range, so that black and white are exact.
        let luma = level as f64 * 255.0 / (LEVELS - 1) as f64;
        self.label(rgb_of_ycc([luma, cb, cr]))
    }

    fn label(&self, rgb: [f64; 3]) -> u8 {
        let lab = if self.has_lab {
            lab_of_linear(rgb.map(|value| self.linear[value.round() as usize & 0xFF]))
        } else {
            [0.0; 3]
        };
        let hsv = hsv_of(rgb);
        let has = |colour: &Colour| colour.matches_lab(lab) || colour.matches_hsv(hsv);
        // There are at most 32 colours, so the number fits into a byte.
        self.colours
            .iter()
            .position(|colour| has(colour) != self.invert)
            .map_or(0, |index| index as u8 + 1)
    }
}

fn first(colours: &[Colour]) -> &[Colour] {
    &colours[..colours.len().min(MAX_COLOURS)]
}

/// The table index of a Cb and a Cr.
#[inline(always)]
pub(super) fn pair_of(cb: u8, cr: u8) -> u16 {
    u16::from(cb >> (8 - CHROMA_BITS)) << CHROMA_BITS | u16::from(cr >> (8 - CHROMA_BITS))
}

/// The index of a luma value in a [`Row`].
#[inline(always)]
pub(super) fn level(luma: u8) -> usize {
    usize::from(luma) * LEVELS / 256
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    fn label(palette: &mut Palette, rgb: [u8; 3]) -> u8 {
        let image = Image::from_rgb(&RgbImage::from_pixel(1, 1, Rgb(rgb)));
        palette
            .colour_at(&image, 0, 0)
            .map_or(0, |index| index as u8 + 1)
    }

    #[test]
    fn a_pixel_belongs_to_the_first_matching_colour() {
        let red = Colour::named("red").unwrap();
        let any = Colour::hsv([0.0, 360.0], [0.0, 100.0], [0.0, 100.0]).unwrap();
        let mut palette = Palette::compile(&[red, any], false);
        assert_eq!(label(&mut palette, [250, 10, 10]), 1);
        assert_eq!(label(&mut palette, [10, 250, 10]), 2);
        let mut inverted = Palette::compile(&[red], true);
        assert_eq!(label(&mut inverted, [250, 10, 10]), 0);
        assert_eq!(label(&mut inverted, [10, 250, 10]), 1);
    }

    #[test]
    fn surplus_colours_are_left_out() {
        let red = Colour::named("red").unwrap();
        let palette = Palette::compile(&[red; 40], false);
        assert_eq!(palette.colours().len(), MAX_COLOURS);
        assert!(palette.is_of(&[red; 50], false));
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]
        /// For random pixels and ranges, the table differs from the exact computation only near
        /// boundaries.
        #[test]
        fn the_table_agrees_with_exact_arithmetic(
            l in 20.0..60.0f64, a in -60.0..40.0f64, b in -60.0..40.0f64, seed in any::<u32>(),
        ) {
            let colour = Colour::lab([l, l + 35.0], [a, a + 45.0], [b, b + 45.0]).unwrap();
            let mut palette = Palette::compile(&[colour], false);
            let mut state = seed;
            let picture = RgbImage::from_fn(64, 64, |_, _| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                Rgb([(state >> 24) as u8, (state >> 16) as u8, (state >> 8) as u8])
            });
            let image = Image::from_rgb(&picture);
            let mut differ = 0;
            for y in 0..64 {
                for x in 0..64 {
                    let found = palette.colour_at(&image, x, y).is_some();
                    differ += u32::from(found != colour.contains(picture.get_pixel(x, y).0));
                }
            }
            prop_assert!(differ <= 4096 * 3 / 100, "{differ} of 4096 pixels differ");
        }
    }
}
