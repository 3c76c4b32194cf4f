//! Colours compiled into one table, so that a pixel's colour costs one look-up however many there are.
//!
//! 64 levels a channel keep a blob's area within half a percent of the exact arithmetic; 32 levels
//! cost the same time and twice the error, 16 invent blobs.

use super::colour::Colour;
use super::space::{hsv_of, lab_of_linear, linear};

const BITS: u32 = 6;
const LEVELS: usize = 1 << BITS;

/// Most colours in one [`Palette`].
pub const MAX_COLOURS: usize = 32;

/// A list of colours, ready for whole pictures.
#[derive(Debug, Clone)]
pub struct Palette {
    colours: Vec<Colour>,
    invert: bool,
    /// For each cell of the colour cube: 0, or 1 + the index of the first colour that has it.
    table: Box<[u8]>,
}

impl Palette {
    /// Compiles the first [`MAX_COLOURS`] of `colours`; a few milliseconds, so keep the result.
    ///
    /// A pixel belongs to the first colour that has it, as in OpenMV. With `invert`, to the
    /// first colour that does *not* have it.
    pub fn compile(colours: &[Colour], invert: bool) -> Palette {
        let colours = colours[..colours.len().min(MAX_COLOURS)].to_vec();
        let table = (0..LEVELS.pow(3))
            .map(|cell| label(&colours, invert, cell))
            .collect();
        Palette {
            colours,
            invert,
            table,
        }
    }

    /// The colours it was made of.
    pub fn colours(&self) -> &[Colour] {
        &self.colours
    }

    /// Whether it was compiled from the same colours and the same `invert`.
    pub fn is_of(&self, colours: &[Colour], invert: bool) -> bool {
        self.invert == invert && self.colours == colours[..colours.len().min(MAX_COLOURS)]
    }

    /// Index of the first colour that has the pixel.
    pub fn colour_of(&self, rgb: [u8; 3]) -> Option<usize> {
        self.table[cell_of(rgb)].checked_sub(1).map(usize::from)
    }

    /// Labels a row of pixels: 0, or 1 + the index of the first colour that has the pixel.
    pub(super) fn label_row(&self, rgb: &[u8], labels: &mut [u8]) {
        // A table of known length lets the compiler drop the bounds check.
        let Ok(table) = <&[u8; LEVELS * LEVELS * LEVELS]>::try_from(&*self.table) else {
            return;
        };
        for (label, pixel) in labels.iter_mut().zip(rgb.as_chunks::<3>().0) {
            *label = table[cell_of(*pixel)];
        }
    }
}

fn cell_of([r, g, b]: [u8; 3]) -> usize {
    let level = |value: u8| usize::from(value >> (8 - BITS));
    level(r) << (2 * BITS) | level(g) << BITS | level(b)
}

/// Spread over the whole range, so that pure black, white and primaries are met exactly.
fn value_of(level: usize) -> f64 {
    level as f64 * 255.0 / (LEVELS - 1) as f64
}

fn label(colours: &[Colour], invert: bool, cell: usize) -> u8 {
    let rgb = [
        cell >> (2 * BITS),
        cell >> BITS & (LEVELS - 1),
        cell & (LEVELS - 1),
    ]
    .map(value_of);
    let needs_lab = colours
        .iter()
        .any(|colour| matches!(colour, Colour::Lab { .. }));
    let lab = if needs_lab {
        lab_of_linear(rgb.map(linear))
    } else {
        [0.0; 3]
    };
    let hsv = hsv_of(rgb);
    let has = |colour: &Colour| colour.matches_lab(lab) || colour.matches_hsv(hsv);
    // At most 32 colours, so the number fits.
    colours
        .iter()
        .position(|colour| has(colour) != invert)
        .map_or(0, |index| index as u8 + 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_pixel_belongs_to_the_first_colour_that_has_it() {
        let red = Colour::named("red").unwrap();
        let any = Colour::hsv([0.0, 360.0], [0.0, 100.0], [0.0, 100.0]).unwrap();
        let palette = Palette::compile(&[red, any], false);
        assert_eq!(palette.colour_of([250, 10, 10]), Some(0));
        assert_eq!(palette.colour_of([10, 250, 10]), Some(1));
        let inverted = Palette::compile(&[red], true);
        assert_eq!(inverted.colour_of([250, 10, 10]), None);
        assert_eq!(inverted.colour_of([10, 250, 10]), Some(0));
    }

    #[test]
    fn surplus_colours_are_left_out() {
        let palette = Palette::compile(&[Colour::named("red").unwrap(); 40], false);
        assert_eq!(palette.colours().len(), MAX_COLOURS);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]
        /// Over random pixels and ranges the table differs from the exact arithmetic only near borders.
        #[test]
        fn the_table_agrees_with_exact_arithmetic(
            l in 20.0..60.0f64, a in -60.0..40.0f64, b in -60.0..40.0f64, seed in any::<u32>(),
        ) {
            let colour = Colour::lab([l, l + 35.0], [a, a + 45.0], [b, b + 45.0]).unwrap();
            let palette = Palette::compile(&[colour], false);
            let mut state = seed;
            let mut differ = 0;
            for _ in 0..4_000 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let rgb = [(state >> 24) as u8, (state >> 16) as u8, (state >> 8) as u8];
                differ += usize::from(palette.colour_of(rgb).is_some() != colour.contains(rgb));
            }
            prop_assert!(differ <= 120, "{differ} of 4000 pixels differ");
        }
    }
}
