//! Decodes single blocks: bits to coefficients, and the coefficients of two blocks at a time to
//! samples.

use super::bits::Bits;
use super::huffman::Table;
use super::idct;
use super::machine::{Coefficients, Machine};
use super::steps::{AcTable, STEP_BITS, Step};
use crate::vision::picture::image::Plane;

/// The storage position of each coefficient in zigzag order. Positions beyond the block, which a
/// step uses for values that it does not have, map to one that is never read.
const PLACES: [u8; 128] = {
    let mut places = [64; 128];
    let mut index = 0;
    while index < 64 {
        places[index] = idct::ZIGZAG[index];
        index += 1;
    }
    places
};

/// Blocks queued for the inverse transform, which processes two at a time.
#[derive(Debug, Clone)]
pub(super) struct BlockQueue {
    /// All zeros, except for queued blocks and positions that are never read.
    blocks: [Coefficients; 2],
    /// The sample offset of the first block, if it is queued.
    first: Option<usize>,
}

impl Default for BlockQueue {
    fn default() -> Self {
        BlockQueue {
            blocks: [Coefficients::ZERO; 2],
            first: None,
        }
    }
}

impl BlockQueue {
    /// The buffer for the next block's coefficients.
    #[inline(always)]
    pub(super) fn next(&mut self) -> &mut Coefficients {
        &mut self.blocks[usize::from(self.first.is_some())]
    }

    /// Transforms the [`next`](BlockQueue::next) block, immediately or together with the one after
    /// it.
    #[inline(always)]
    pub(super) fn put<M: Machine>(&mut self, machine: M, plane: &mut Plane, at: usize) {
        match self.first.take() {
            None => self.first = Some(at),
            Some(first) => {
                let samples = &mut plane.samples;
                let stride = plane.stride;
                machine.transform_two(&self.blocks, samples, [first, at], stride);
                self.blocks = [Coefficients::ZERO; 2];
            }
        }
    }

    /// Transforms a block that is still queued.
    #[inline(always)]
    pub(super) fn finish<M: Machine>(&mut self, machine: M, plane: &mut Plane) {
        if let Some(first) = self.first {
            // Both are written to the same place, because there is no second block.
            self.blocks[1] = self.blocks[0];
            self.put(machine, plane, first);
        }
    }
}

/// Decodes and dequantises a block's coefficients into a zeroed buffer. Returns whether there are
/// AC coefficients; `None` if the data is invalid.
#[inline(always)]
pub(super) fn decode_block(
    bits: &mut Bits<'_>,
    (dc_table, ac_table): (&Table, &AcTable),
    quantiser: &[i32; 64],
    predictor: &mut i32,
    Coefficients(coefficients): &mut Coefficients,
) -> Option<bool> {
    // Most blocks need fewer bits than this loads, so the branch in the refill below is
    // predictable.
    bits.refill_always();
    let (run, difference) = dc_table.next(bits)?;
    if run != 0 {
        return None;
    }
    *predictor = predictor.wrapping_add(difference);
    coefficients[0] = idct::dequantised(*predictor, quantiser[0]);
    let mut put = |place: usize, value: i32| {
        let coefficient = idct::dequantised(value, quantiser[place & 63]);
        coefficients[usize::from(PLACES[place & 127])] = coefficient;
    };
    let mut index = 1;
    loop {
        bits.refill::<{ STEP_BITS + 2 }>();
        let step = ac_table.step(bits.peek(STEP_BITS));
        // A value beyond the block is written to padding that is never read, so no check is needed.
        put(step.first_place(index), step.first_value());
        put(step.second_place(index), step.second_value());
        let next = step.next(index);
        if next < 64 {
            bits.skip(step.taken());
            index = next;
            continue;
        }
        if Step::ends(next) {
            bits.skip(step.taken());
            return Some(next != END_WITHOUT_AC);
        }
        let (run, value) = ac_table.codes.next(bits)?;
        index += run as usize;
        match (run, value) {
            (0, 0) => return Some(index > 1),
            (15, 0) => {}
            (_, 0) => return None,
            _ if index > 63 => return None,
            _ => put(index, value),
        }
        index += 1;
        if index > 63 {
            return Some(true);
        }
    }
}

/// The position after a block without AC coefficients, for [`Step::ends`].
const END_WITHOUT_AC: usize = 129;

#[cfg(test)]
mod tests {
    use super::super::bits::Scan;
    use super::super::huffman::STANDARD_TABLES;
    use super::*;
    use proptest::prelude::*;

    /// The standard's luma tables: DC, AC.
    fn tables() -> (Table, AcTable) {
        let mut dc = Table::default();
        let mut ac = AcTable::default();
        let mut rest = &STANDARD_TABLES[4..];
        for is_ac in [false, true] {
            let counts = rest[1..].first_chunk::<16>().unwrap();
            let len: usize = counts.iter().copied().map(usize::from).sum();
            let symbols = &rest[17..][..len];
            assert!(if is_ac {
                ac.load(counts, symbols)
            } else {
                dc.load(counts, symbols)
            });
            rest = &rest[17 + len..];
        }
        (dc, ac)
    }

    /// Decodes code by code as in the standard (T.81 F.2.2).
    fn one_by_one(
        bits: &mut Bits<'_>,
        (dc, ac): (&Table, &AcTable),
        quantiser: &[i32; 64],
        predictor: &mut i32,
    ) -> Option<[i16; 64]> {
        let mut coefficients = [0; 64];
        let (0, difference) = dc.next(bits)? else {
            return None;
        };
        *predictor = predictor.wrapping_add(difference);
        coefficients[0] = idct::dequantised(*predictor, quantiser[0]);
        let mut index = 1;
        while index < 64 {
            let (run, value) = ac.codes.next(bits)?;
            index += run as usize;
            match (run, value) {
                (0, 0) => break,
                (15, 0) => {}
                (_, 0) => return None,
                _ => {
                    let place = usize::from(*idct::ZIGZAG.get(index)?);
                    coefficients[place] = idct::dequantised(value, quantiser[index]);
                }
            }
            index += 1;
        }
        Some(coefficients)
    }

    proptest! {
            /// For any bits, both decoders give the same coefficients, the same errors and the same
            /// number of bits.
            #[test]
            fn steps_of_several_codes_equal_single_codes(
                bytes in proptest::collection::vec(
                    // Small values have short codes, several of which fit into a step.
                    prop_oneof![any::<u8>(), Just(0u8), Just(0b0010_0100), Just(0b1010_0101)], 1..200,
                ),
            ) {
                let (dc, ac) = tables();
                let quantiser = std::array::from_fn(|index| 300 + 40 * index as i32);
                let mut scan = Scan::default();
                let stuffed = bytes.iter().flat_map(|&byte| match byte {
                    0xFF => vec![0xFF, 0],
                    _ => vec![byte],
                });
                scan.load(&stuffed.chain([0xFF, 0xD9]).collect::<Vec<_>>()).unwrap();
                let mut bits = scan.bits(0);
    let mut other = scan.bits(0);
                let mut predictor = 0;
    let mut other_predictor = 0;
                while bits.left() > 0 {
                    let mut found = Coefficients::ZERO;
                    let any = decode_block(&mut bits, (&dc, &ac), &quantiser, &mut predictor, &mut found);
                    let expected = one_by_one(&mut other, (&dc, &ac), &quantiser, &mut other_predictor);
                    prop_assert_eq!(any.is_some(), expected.is_some());
                    let (Some(any), Some(expected)) = (any, expected) else { break };
                    prop_assert_eq!(&found.0[..64], &expected);
                    prop_assert!(any || expected[1..].iter().all(|value| *value == 0));
                    prop_assert_eq!(bits.left(), other.left());
                    prop_assert_eq!(predictor, other_predictor);
                }
            }
        }
}
