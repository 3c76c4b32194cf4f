//! Labels the rows of a picture with a palette and skips the parts without any of its colours,
//! usually most of it.

use super::palette::{Cell, NO_COLOUR_ROW, Palette, level, pair_of};
use crate::Vectors;
use crate::picture::{Image, Spans};

/// Most cells that are settled per picture: each may take a tenth of a picture's decoding time.
const MAX_SETTLED: u32 = 4;

pub(crate) struct Labeller<'a> {
    palette: &'a mut Palette,
    image: &'a Image,
    vectors: Vectors,
    /// Rows of Cb and of Cr and the first pixel column for which `spans` is valid; rows of pixels
    /// may share them.
    known: Option<[u32; 3]>,
    spans: Spans,
    settled: u32,
}

impl<'a> Labeller<'a> {
    /// Starts with a picture; uses the best available instruction set.
    pub(crate) fn new(palette: &'a mut Palette, image: &'a Image) -> Labeller<'a> {
        Labeller {
            palette,
            image,
            vectors: Vectors::default(),
            known: None,
            spans: Spans::NONE,
            settled: 0,
        }
    }

    /// Labels the pixels of row `y` from column `x` on: 0, or 1 + the index of the first matching
    /// colour. Outside the returned spans no pixel has a colour, and nothing is written.
    pub(crate) fn label_row(&mut self, y: u32, x: u32, labels: &mut [u8]) -> Spans {
        let image = self.image;
        let luma = &image.luma_row(y)[x as usize..];
        if image.grey {
            let row = self.palette.row_number(pair_of(128, 128));
            let row = self.palette.row(row);
            for (label, luma) in labels.iter_mut().zip(luma) {
                *label = row[level(*luma)];
            }
            return Spans::ALL;
        }
        let [_, cb, cr] = &image.planes;
        let cbs = cb.row(y);
        let crs = cr.row(y);
        let key = [y >> cb.down, y >> cr.down, x];
        match (cb.across, cr.across) {
            (1, 1) if x.is_multiple_of(2) => {
                let from = x as usize / 2;
                self.label_pairs(key, luma, &cbs[from..], &crs[from..], labels)
            }
            shifts => {
                for ((label, luma), x) in labels.iter_mut().zip(luma).zip(x..) {
                    let cb = cbs[(x >> shifts.0) as usize];
                    let cr = crs[(x >> shifts.1) as usize];
                    let row = self.palette.row_number(pair_of(cb, cr));
                    *label = self.palette.row(row)[level(*luma)];
                }
                Spans::ALL
            }
        }
    }

    /// Labels pixels of which two share Cb and Cr, as in the frames of cameras; the last one may be
    /// alone.
    fn label_pairs(
        &mut self,
        key: [u32; 3],
        luma: &[u8],
        cbs: &[u8],
        crs: &[u8],
        labels: &mut [u8],
    ) -> Spans {
        let count = labels.len().div_ceil(2);
        let cbs = &cbs[..count];
        let crs = &crs[..count];
        if self.known != Some(key) {
            self.spans = self.find_spans(cbs, crs);
            self.known = Some(key);
        }
        for span in self.spans.ranges(labels.len()) {
            let numbers = &self.palette.numbers[span.start / 2..span.end.div_ceil(2)];
            let (labels, last_labels) = labels[span.clone()].as_chunks_mut::<2>();
            let (luma, last_luma) = luma[span].as_chunks::<2>();
            for ((labels, luma), number) in labels.iter_mut().zip(luma).zip(numbers) {
                let row = self.palette.row(*number);
                *labels = luma.map(|luma| row[level(luma)]);
            }
            for (label, luma) in last_labels.iter_mut().zip(last_luma) {
                *label = self.palette.row(numbers[numbers.len() - 1])[level(*luma)];
            }
        }
        self.spans
    }

    /// Finds the spans that may have labels, first by cells, then by pairs; stores the row numbers
    /// of the pairs.
    fn find_spans(&mut self, cbs: &[u8], crs: &[u8]) -> Spans {
        let coarse = self.palette.cells.spans(self.vectors, cbs, crs);
        let mut spans = Spans::NONE;
        let group = Spans::GROUP / 2;
        let mut numbers = std::mem::take(&mut self.palette.numbers);
        numbers.resize(cbs.len(), NO_COLOUR_ROW);
        for index in coarse.groups(cbs.len().div_ceil(group)) {
            let part = index * group..cbs.len().min((index + 1) * group);
            let cbs = &cbs[part.clone()];
            let crs = &crs[part.clone()];
            let mut any = false;
            for (number, (cb, cr)) in numbers[part].iter_mut().zip(cbs.iter().zip(crs)) {
                *number = self.palette.row_number(pair_of(*cb, *cr));
                any |= *number != NO_COLOUR_ROW;
            }
            if any {
                spans.add(index);
            } else {
                self.learn(cbs, crs);
            }
        }
        self.palette.numbers = numbers;
        spans
    }

    /// Settles the cell of one of these pairs, which have no labels, so that it is skipped from now
    /// on.
    #[cold]
    fn learn(&mut self, cbs: &[u8], crs: &[u8]) {
        if matches!(self.vectors, Vectors::Plain)
            || self.settled == MAX_SETTLED
            || self.palette.cells.is_pausing()
        {
            return;
        }
        let cells = cbs
            .iter()
            .zip(crs)
            .filter_map(|(cb, cr)| Cell::from_chroma(*cb, *cr));
        let mut unknown = cells.filter(|cell| !self.palette.cells.is_settled(*cell));
        let unknown = unknown.next();
        if let Some(cell) = unknown {
            self.settled += 1;
            let live = cell
                .levels()
                .any(|(cb, cr)| !self.palette.has_no_colour(pair_of(cb, cr)));
            self.palette.cells.settle(cell, live);
        } else {
            self.palette.cells.pause();
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Colour;

    proptest! {
        /// A row gets the same labels as pixel by pixel, whatever the subsampling, the first column
        /// and the instruction set.
        #[test]
        fn rows_are_labelled_alike_in_every_layout(
            across in 0u32..=2, down in 0u32..=2, x in 0u32..7, width in 7u32..130, grey in any::<bool>(),
            near_grey in any::<bool>(),
            noise in proptest::collection::vec(any::<u8>(), 3 * 136 * 4),
        ) {
            let mut image = Image { size: crate::Size { width, height: 4 }, grey, ..Image::default() };
            for (index, plane) in image.planes.iter_mut().enumerate() {
                let shift = |shift| if index == 0 { 0 } else { shift };
                plane.shape(136, 4, shift(across), shift(down));
                plane.samples.copy_from_slice(&noise[index * 544..][..544]);
                if near_grey && index > 0 {
                    plane.samples.iter_mut().for_each(|value| *value = 116 + *value % 24);
                }
            }
            let colours = ["red", "green", "blue"].map(|name| Colour::named(name).unwrap());
            for vectors in [Vectors::Plain, Vectors::default()] {
                let mut palette = Palette::compile(&colours, false);
                let mut plain = palette.clone();
                // Repeatedly, until all cells are settled.
                for y in (0..32).map(|row| row % 4) {
                    let mut labeller = Labeller { vectors, ..Labeller::new(&mut palette, &image) };
                    let mut found = vec![9; (width - x) as usize];
                    let spans = labeller.label_row(y, x, &mut found);
                    let mut labels = vec![0; found.len()];
                    for span in spans.ranges(found.len()) {
                        labels[span.clone()].copy_from_slice(&found[span]);
                    }
                    for (label, x) in labels.into_iter().zip(x..) {
                        let expected = plain.colour_at(&image, x, y).map_or(0, |index| index as u8 + 1);
                        prop_assert_eq!(label, expected);
                    }
                }
            }
        }
    }
}
