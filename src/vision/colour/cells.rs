//! Cells of the Cb-Cr plane that are known to contain no labelled pixel, so that most pixels of a
//! row can be skipped thirty-two at a time.
//!
//! There are 16 by 16 cells of 8 by 8 levels around grey; those at the border extend to the end of
//! the plane. A cell counts as live, which means that it may contain labelled pixels, until it is
//! [`settled`](Cells::settle) that it does not.

#[cfg(target_arch = "x86_64")]
use super::avx2::LiveSpans;
use crate::vision::picture::spans::Spans;
use crate::vision::vectors::Vectors;

/// The lowest level of the inner cells, minus 8.
const LOWEST: u8 = 64;
/// Levels per cell in each direction; `LiveSpans` depends on this value.
const LEVELS: u8 = 8;

/// Number of searches to skip after an unsuccessful one.
const PAUSE: u8 = 15;

/// The cells of one palette.
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

/// The position of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cell {
    cb: u8,
    cr: u8,
}

fn index(level: u8) -> u8 {
    level.saturating_sub(LOWEST).min(127) / LEVELS
}

impl Cell {
    /// The cell of a Cb and a Cr; `None` at the border, where cells are too large to be settled.
    pub(super) fn from_chroma(cb: u8, cr: u8) -> Option<Cell> {
        let inner = |index: u8| (1..15).contains(&index);
        let cb = index(cb);
        let cr = index(cr);
        (inner(cb) && inner(cr)).then_some(Cell { cb, cr })
    }

    /// All pairs of Cb and Cr in the cell.
    pub(super) fn levels(self) -> impl Iterator<Item = (u8, u8)> {
        let of = |index: u8| (0..LEVELS).map(move |level| LOWEST + index * LEVELS + level);
        of(self.cb).flat_map(move |cb| of(self.cr).map(move |cr| (cb, cr)))
    }
}

impl Cells {
    /// Whether it is known if this cell is live.
    pub(super) fn is_settled(&self, cell: Cell) -> bool {
        self.settled[usize::from(cell.cb)] >> cell.cr & 1 != 0
    }

    /// Records whether a cell is live.
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

    /// The groups of a row that contain live cells, if each Cb and Cr applies to `N` (1 or 2)
    /// pixels. Returns all groups without vector instructions, because checking would then take as
    /// long as looking up each pixel.
    pub(super) fn spans<const N: usize>(&self, vectors: Vectors, cbs: &[u8], crs: &[u8]) -> Spans {
        match vectors {
            Vectors::Plain => Spans::ALL,
            #[cfg(target_arch = "x86_64")]
            Vectors::Avx2(v3) => v3.vectorize(LiveSpans::<N> {
                v3,
                lowest: LOWEST,
                live: &self.live,
                cbs,
                crs,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
                let single = cells.spans::<1>(Vectors::default(), &cbs, &crs);
    let double = cells.spans::<2>(Vectors::default(), &cbs, &crs);
                for (spans, size) in [(single, 16), (double, 8)] {
                    let groups = chroma[..whole].chunks(size).enumerate();
                    let expected = groups.filter(|(_, chroma)| !chroma.iter().all(dead));
                    let expected: Vec<usize> = expected.map(|(group, _)| group).collect();
                    prop_assert_eq!(spans.groups(whole / size).collect::<Vec<_>>(), expected);
                }
            }
        }
}
