//! Colours compiled into one table, so that a pixel's colour costs one look-up however many there are.
//!
//! The table is over luma, Cb and Cr, as JPEG has them: no pixel is ever turned into
//! red, green and blue. For each pair of Cb and Cr it holds a row of 64 levels of
//! brightness, filled by the exact arithmetic when a picture first has that pair. So compiling is quick,
//! a picture touches few cache lines, and pairs that no colour has share one row.

use super::Colour;
use crate::vision::picture::image::Image;
use crate::vision::picture::space::{hsv_of, lab_of_linear, linear, rgb_of_ycc};

/// Bits of Cb and of Cr that are told apart.
const CHROMA_BITS: u32 = 7;
const PAIRS: usize = 1 << (2 * CHROMA_BITS);
/// Levels of brightness.
const LEVELS: usize = 64;

/// Most colours in one [`Palette`].
pub const MAX_COLOURS: usize = 32;

/// For each level of brightness 0, or 1 + the index of the first colour that has it.
type Row = [u8; LEVELS];

/// The row of a pair that no picture had yet, and that of all pairs that no colour has.
const UNKNOWN: u16 = 0;
const NOTHING: u16 = 1;

/// A list of colours, ready for whole pictures.
#[derive(Debug, Clone)]
pub struct Palette {
    colours: Vec<Colour>,
    invert: bool,
    has_lab: bool,
    /// Light of each sRGB value.
    linear: Box<[f64; 256]>,
    /// For each pair of Cb and Cr, which row is its own.
    index: Box<[u16; PAIRS]>,
    rows: Vec<Row>,
    /// 0 for each pair whose row is known to be [`NOTHING`], else 1. Small enough for the nearest cache.
    lively: Box<[u8; PAIRS]>,
    /// The pairs of a row of pixels.
    pairs: Vec<u16>,
}

impl Palette {
    /// Compiles the first [`MAX_COLOURS`] of `colours`.
    ///
    /// A pixel belongs to the first colour that has it, as in OpenMV. With `invert`, to the
    /// first colour that does *not* have it.
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
            lively: Box::new([1; PAIRS]),
            pairs: Vec::new(),
        }
    }

    /// The colours it was made of.
    pub fn colours(&self) -> &[Colour] {
        &self.colours
    }

    /// Whether it was compiled from the same colours and the same `invert`.
    pub fn is_of(&self, colours: &[Colour], invert: bool) -> bool {
        self.invert == invert && self.colours == first(colours)
    }

    /// Index of the first colour that has the pixel of column `x`, row `y`; nothing outside the picture.
    pub fn colour_at(&mut self, image: &Image, x: u32, y: u32) -> Option<usize> {
        image.pixel(x, y)?;
        let mut label = [0];
        self.label_row(image, y, x, &mut label);
        label[0].checked_sub(1).map(usize::from)
    }

    /// Labels the pixels of row `y` from column `x` on: 0, or 1 + the index of the first colour that has the pixel.
    pub(crate) fn label_row(&mut self, image: &Image, y: u32, x: u32, labels: &mut [u8]) {
        let luma = &image.luma_row(y)[x as usize..];
        if image.grey {
            let row = self.row(pair_of(128, 128));
            labels
                .iter_mut()
                .zip(luma)
                .for_each(|(label, luma)| *label = row[level(*luma)]);
            return;
        }
        let [_, cb, cr] = &image.planes;
        let (cbs, crs) = (cb.row(y), cr.row(y));
        match (cb.across, cr.across) {
            (0, 0) => self.label_groups::<1>(luma, &cbs[x as usize..], &crs[x as usize..], labels),
            (1, 1) if x.is_multiple_of(2) => {
                let from = x as usize / 2;
                self.label_groups::<2>(luma, &cbs[from..], &crs[from..], labels);
            }
            shifts => {
                for ((label, luma), x) in labels.iter_mut().zip(luma).zip(x..) {
                    let (cb, cr) = (cbs[(x >> shifts.0) as usize], crs[(x >> shifts.1) as usize]);
                    *label = self.row(pair_of(cb, cr))[level(*luma)];
                }
            }
        }
    }

    /// Labels pixels of which `N` share Cb and Cr; the last ones may be fewer. Most pixels have no
    /// colour of interest, so eight pairs at a time are asked whether any of them may have one.
    fn label_groups<const N: usize>(
        &mut self,
        luma: &[u8],
        cbs: &[u8],
        crs: &[u8],
        labels: &mut [u8],
    ) {
        let mut pairs = std::mem::take(&mut self.pairs);
        pairs.clear();
        let chroma = cbs.iter().zip(crs).take(labels.len().div_ceil(N));
        pairs.extend(chroma.map(|(cb, cr)| pair_of(*cb, *cr)));
        let (whole, rest) = pairs.as_chunks::<8>();
        let (first, last) = labels.split_at_mut((whole.len() * 8 * N).min(labels.len()));
        for ((labels, luma), pairs) in first.chunks_mut(8 * N).zip(luma.chunks(8 * N)).zip(whole) {
            let lively = pairs
                .iter()
                .fold(0, |any, pair| any | self.lively[usize::from(*pair) % PAIRS]);
            if lively == 0 {
                labels.fill(0);
            } else {
                self.label_lively::<N>(pairs, luma, labels);
            }
        }
        self.label_lively::<N>(rest, &luma[first.len()..], last);
        self.pairs = pairs;
    }

    fn label_lively<const N: usize>(&mut self, pairs: &[u16], luma: &[u8], labels: &mut [u8]) {
        for ((labels, luma), pair) in labels.chunks_mut(N).zip(luma.chunks(N)).zip(pairs) {
            let row = self.row(*pair);
            labels
                .iter_mut()
                .zip(luma)
                .for_each(|(label, luma)| *label = row[level(*luma)]);
        }
    }

    #[inline(always)]
    fn row(&mut self, pair: u16) -> &Row {
        let row = match self.index[usize::from(pair) % PAIRS] {
            UNKNOWN => self.meet(pair.into()),
            row => row,
        };
        &self.rows[usize::from(row)]
    }

    /// Works out the row of a pair that is met for the first time.
    #[cold]
    fn meet(&mut self, pair: usize) -> u16 {
        let chroma = |value: usize| (value * 2) as f64 + 0.5;
        let (cb, cr) = (
            chroma(pair >> CHROMA_BITS),
            chroma(pair & ((1 << CHROMA_BITS) - 1)),
        );
        // Spread over the whole range, so that black and white are met exactly.
        let luma = |level: usize| level as f64 * 255.0 / (LEVELS - 1) as f64;
        let labels: Row =
            std::array::from_fn(|level| self.label(rgb_of_ycc([luma(level), cb, cr])));
        let row = if labels == self.rows[usize::from(NOTHING)] {
            self.lively[pair] = 0;
            NOTHING
        } else {
            self.rows.push(labels);
            // There are fewer pairs than numbers.
            self.rows.len() as u16 - 1
        };
        self.index[pair] = row;
        row
    }

    fn label(&self, rgb: [f64; 3]) -> u8 {
        let lab = if self.has_lab {
            lab_of_linear(rgb.map(|value| self.linear[value.round() as usize & 0xFF]))
        } else {
            [0.0; 3]
        };
        let hsv = hsv_of(rgb);
        let has = |colour: &Colour| colour.matches_lab(lab) || colour.matches_hsv(hsv);
        // At most 32 colours, so the number fits.
        self.colours
            .iter()
            .position(|colour| has(colour) != self.invert)
            .map_or(0, |index| index as u8 + 1)
    }
}

fn first(colours: &[Colour]) -> &[Colour] {
    &colours[..colours.len().min(MAX_COLOURS)]
}

#[inline(always)]
fn pair_of(cb: u8, cr: u8) -> u16 {
    u16::from(cb >> (8 - CHROMA_BITS)) << CHROMA_BITS | u16::from(cr >> (8 - CHROMA_BITS))
}

#[inline(always)]
fn level(luma: u8) -> usize {
    usize::from(luma) * LEVELS / 256
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    fn label(palette: &mut Palette, rgb: [u8; 3]) -> u8 {
        let mut labels = [9];
        palette.label_row(
            &Image::from_rgb(&RgbImage::from_pixel(1, 1, Rgb(rgb))),
            0,
            0,
            &mut labels,
        );
        labels[0]
    }

    #[test]
    fn a_pixel_belongs_to_the_first_colour_that_has_it() {
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
        /// Over random pixels and ranges the table differs from the exact arithmetic only near borders.
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
                let mut labels = [0; 64];
                palette.label_row(&image, y, 0, &mut labels);
                for (label, x) in labels.into_iter().zip(0..) {
                    differ += u32::from((label != 0) != colour.contains(picture.get_pixel(x, y).0));
                }
            }
            prop_assert!(differ <= 4096 * 3 / 100, "{differ} of 4096 pixels differ");
        }

        /// Whatever the sharing of Cb and Cr and the first column, a row is labelled pixel by pixel.
        #[test]
        fn rows_are_labelled_alike_in_every_layout(
            across in 0u32..=2, down in 0u32..=2, x in 0u32..7, width in 7u32..30, grey in any::<bool>(),
            noise in proptest::collection::vec(any::<u8>(), 3 * 32 * 4),
        ) {
            let mut image = Image { size: crate::vision::Size { width, height: 4 }, grey, ..Image::default() };
            for (index, plane) in image.planes.iter_mut().enumerate() {
                plane.shape((32, 4), if index == 0 { (0, 0) } else { (across, down) });
                plane.samples.copy_from_slice(&noise[index * 128..][..128]);
            }
            let colours = ["red", "green", "blue"].map(|name| Colour::named(name).unwrap());
            let mut palette = Palette::compile(&colours, false);
            for y in 0..4 {
                let mut labels = vec![9; (width - x) as usize];
                palette.label_row(&image, y, x, &mut labels);
                for (label, x) in labels.into_iter().zip(x..) {
                    let at = |plane: usize| {
                        let plane = &image.planes[plane];
                        plane.samples[(y >> plane.down) as usize * 32 + (x >> plane.across) as usize]
                    };
                    let (cb, cr) = if grey { (128, 128) } else { (at(1), at(2)) };
                    prop_assert_eq!(label, palette.row(pair_of(cb, cr))[level(at(0))]);
                }
            }
        }
    }
}
