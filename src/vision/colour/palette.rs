//! Colours compiled into one table, so that classifying a pixel costs one look-up however many
//! colours there are. It is indexed by luma, Cb and Cr: for each pair of Cb and Cr it has a row of
//! 64 brightness levels, computed when the pair first occurs in a picture.

use super::Colour;
use crate::Vectors;
use crate::picture::{Image, Plane, Spans, hsv_of, lab_of_linear, linear, rgb_of_ycc};

/// Number of bits of Cb and of Cr that are used.
const CHROMA_BITS: u32 = 7;
const PAIRS: usize = 1 << (2 * CHROMA_BITS);
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
    linear: Box<[f64; 256]>,
    index: Box<[u16; PAIRS]>,
    rows: Vec<Row>,
    /// The parts of the Cb-Cr plane that are known to have no colour.
    pub(super) cells: Cells,
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

    #[inline(always)]
    pub(super) fn row_number(&mut self, pair: u16) -> u16 {
        match self.index[usize::from(pair) % PAIRS] {
            UNKNOWN => self.compute_row(pair.into()),
            row => row,
        }
    }

    #[inline(always)]
    pub(super) fn row(&self, number: u16) -> &Row {
        &self.rows[usize::from(number)]
    }

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

#[inline(always)]
pub(super) fn level(luma: u8) -> usize {
    usize::from(luma) * LEVELS / 256
}

/// The lowest level of the inner cells, minus 8.
const LOWEST: u8 = 64;
/// Levels per cell in each direction; `LiveSpans` depends on this value.
const CELL_LEVELS: u8 = 8;

/// Number of searches to skip after an unsuccessful one.
const PAUSE: u8 = 15;

/// Cells of the Cb-Cr plane that are known to contain no labelled pixel, so that most pixels of a row
/// can be skipped thirty-two at a time: 16 by 16 cells of 8 by 8 levels around grey; those at the
/// border extend to the end of the plane. A cell counts as live, which means that it may contain
/// labelled pixels, until it is [`settled`](Cells::settle) that it does not.
#[derive(Debug, Clone)]
pub(super) struct Cells {
    /// Whether each cell is live: indexed by the cell of Cb, one bit per cell of Cr, the lower
    /// eight and the upper eight.
    live: [[u8; 16]; 2],
    /// Whether that is settled, with one bit per cell in the same way.
    settled: [u16; 16],
    /// Remaining searches for unsettled cells to skip.
    pause: u8,
}

impl Default for Cells {
    fn default() -> Self {
        Cells {
            live: [[0xFF; 16]; 2],
            settled: [0; 16],
            pause: 0,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cell {
    cb: u8,
    cr: u8,
}

fn index(level: u8) -> u8 {
    level.saturating_sub(LOWEST).min(127) / CELL_LEVELS
}

impl Cell {
    /// The cell of a Cb and a Cr; `None` at the border, where cells are too large to be settled.
    pub(super) fn from_chroma(cb: u8, cr: u8) -> Option<Cell> {
        let inner = |index: u8| (1..15).contains(&index);
        let cb = index(cb);
        let cr = index(cr);
        (inner(cb) && inner(cr)).then_some(Cell { cb, cr })
    }

    pub(super) fn levels(self) -> impl Iterator<Item = (u8, u8)> {
        let of =
            |index: u8| (0..CELL_LEVELS).map(move |level| LOWEST + index * CELL_LEVELS + level);
        of(self.cb).flat_map(move |cb| of(self.cr).map(move |cr| (cb, cr)))
    }
}

impl Cells {
    /// Whether it is known if this cell is live.
    pub(super) fn is_settled(&self, cell: Cell) -> bool {
        self.settled[usize::from(cell.cb)] >> cell.cr & 1 != 0
    }

    pub(super) fn settle(&mut self, cell: Cell, live: bool) {
        self.settled[usize::from(cell.cb)] |= 1 << cell.cr;
        if !live {
            self.live[usize::from(cell.cr / 8)][usize::from(cell.cb)] &= !(1 << (cell.cr % 8));
        }
    }

    /// Records that a search found no unsettled cell, so that the next ones are skipped.
    pub(super) fn pause(&mut self) {
        self.pause = PAUSE;
    }

    /// Whether to skip the next search; counts down.
    pub(super) fn is_pausing(&mut self) -> bool {
        let pausing = self.pause > 0;
        self.pause = self.pause.saturating_sub(1);
        pausing
    }

    /// The groups of a row that contain live cells, if each Cb and Cr applies to two pixels. Returns
    /// all groups without vector instructions, because checking would then take as long as looking
    /// up each pixel.
    pub(super) fn spans(&self, vectors: Vectors, cbs: &[u8], crs: &[u8]) -> Spans {
        match vectors {
            Vectors::Plain => Spans::ALL,
            #[cfg(target_arch = "x86_64")]
            Vectors::Avx2(v3) => v3.vectorize(avx2::LiveSpans {
                v3,
                lowest: LOWEST,
                live: &self.live,
                cbs,
                crs,
            }),
        }
    }
}

/// Looks up thirty-two chroma samples at a time in cells.
#[cfg(target_arch = "x86_64")]
mod avx2 {
    use pulp::cast;
    use pulp::x86::V3;
    use std::arch::x86_64::{__m128i, __m256i};

    use crate::picture::Spans;

    /// Finds the groups of a row that contain live cells, if each Cb and Cr applies to two pixels.
    pub(super) struct LiveSpans<'a> {
        pub(super) v3: V3,
        /// The end of the first cell, minus its eight levels.
        pub(super) lowest: u8,
        /// One bit per cell of Cr, indexed by the cell of Cb: the lower eight and the upper eight.
        pub(super) live: &'a [[u8; 16]; 2],
        pub(super) cbs: &'a [u8],
        pub(super) crs: &'a [u8],
    }

    impl pulp::NullaryFnOnce for LiveSpans<'_> {
        type Output = Spans;

        #[inline(always)]
        fn call(self) -> Spans {
            let tables = self.live.map(|half| twice(self.v3, half));
            let mut spans = Spans::NONE;
            let chunks = self.cbs.chunks(32).zip(self.crs.chunks(32));
            for (index, (cbs, crs)) in chunks.enumerate() {
                // A remainder at the end of a row counts as live.
                let live = match (cbs.first_chunk(), crs.first_chunk()) {
                    (Some(cbs), Some(crs)) => eights(self.v3, self.lowest, tables, cbs, crs),
                    _ => 0b1111,
                };
                spans.add_bits(4 * index, live);
            }
            spans
        }
    }

    #[inline(always)]
    fn twice(v3: V3, half: [u8; 16]) -> __m256i {
        v3.avx2
            ._mm256_broadcastsi128_si256(cast::<[u8; 16], __m128i>(half))
    }

    /// For each eight pairs of Cb and Cr, one bit that is set if any of their cells is live.
    #[inline(always)]
    fn eights(
        v3: V3,
        lowest: u8,
        [lower, upper]: [__m256i; 2],
        cbs: &[u8; 32],
        crs: &[u8; 32],
    ) -> u32 {
        let avx2 = v3.avx2;
        let all = |byte: u8| -> __m256i { cast([byte; 32]) };
        let index = |levels: &[u8; 32]| {
            let above = avx2._mm256_subs_epu8(cast(*levels), all(lowest));
            let bounded = avx2._mm256_min_epu8(above, all(127));
            avx2._mm256_and_si256(avx2._mm256_srli_epi16::<3>(bounded), all(15))
        };
        let cb = index(cbs);
        let cr = index(crs);
        let lower = avx2._mm256_shuffle_epi8(lower, cb);
        let upper = avx2._mm256_shuffle_epi8(upper, cb);
        // The fourth bit of the index selects the half: shifted to each byte's highest bit.
        let half = avx2._mm256_blendv_epi8(lower, upper, avx2._mm256_slli_epi16::<4>(cr));
        let bits: [u8; 8] = [1, 2, 4, 8, 16, 32, 64, 128];
        let bits = twice(v3, cast([bits; 2]));
        let bit = avx2._mm256_shuffle_epi8(bits, cr);
        let dead = avx2._mm256_cmpeq_epi64(avx2._mm256_and_si256(half, bit), all(0));
        !v3.avx._mm256_movemask_pd(cast(dead)) as u32 & 0b1111
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    use super::*;

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

    #[test]
    fn a_cells_levels_belong_to_it_and_the_border_has_none() {
        let cell = Cell::from_chroma(131, 100).unwrap();
        assert_eq!(cell.levels().count(), 64);
        assert!(
            cell.levels()
                .all(|(cb, cr)| Cell::from_chroma(cb, cr) == Some(cell))
        );
        for border in [0, 71, 184, 255] {
            assert_eq!(Cell::from_chroma(border, 128), None);
            assert_eq!(Cell::from_chroma(128, border), None);
        }
    }

    proptest! {
        /// Exactly the groups whose cells are all settled as not live are skipped.
        #[test]
        fn exactly_the_groups_without_live_cells_are_skipped(
            settled in proptest::collection::vec((72u8..184, 72u8..184, any::<bool>()), 0..300),
            chroma in proptest::collection::vec((60u8..200, 60u8..200), 1..200),
        ) {
            let mut cells = Cells::default();
            for (cb, cr, live) in settled {
                let cell = Cell::from_chroma(cb, cr).unwrap();
                cells.settle(cell, live);
                prop_assert!(cells.is_settled(cell));
            }
            let dead = |&(cb, cr): &(u8, u8)| Cell::from_chroma(cb, cr).is_some_and(|cell| {
                cells.live[usize::from(cell.cr / 8)][usize::from(cell.cb)] >> (cell.cr % 8) & 1 == 0
            });
            let (cbs, crs): (Vec<u8>, Vec<u8>) = chroma.iter().copied().unzip();
            if matches!(Vectors::default(), Vectors::Plain) {
                return Ok(());
            }
            let whole = chroma.len() / 32 * 32;
            let spans = cells.spans(Vectors::default(), &cbs, &crs);
            let groups = chroma[..whole].chunks(8).enumerate();
            let expected = groups.filter(|(_, chroma)| !chroma.iter().all(dead));
            let expected: Vec<usize> = expected.map(|(group, _)| group).collect();
            prop_assert_eq!(spans.groups(whole / 8).collect::<Vec<_>>(), expected);
        }
    }
}
