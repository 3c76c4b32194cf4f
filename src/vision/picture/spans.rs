//! The spans of a row of pixels that contain something of interest.

use std::ops::Range;

use super::size::MAX_WIDTH;

/// A set of groups of [`Spans::GROUP`] columns, one bit each, counted from the start of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Spans(u128);

impl Spans {
    /// Columns per group.
    pub(crate) const GROUP: usize = 16;
    /// The whole row.
    pub(crate) const ALL: Spans = Spans(u128::MAX);
    /// No group of the row.
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

    /// The groups in a row of `count` groups, from left to right.
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
