//! Decodes MCUs (minimum coded units): the blocks of all components that cover the same area of the
//! picture.

use std::ops::Range;

use super::bits::{Bits, Scan};
use super::frame::FrameError;
use super::huffman::{STEP_BITS, Step, Table};
use super::idct;
use super::machine::{Coefficients, Machine, Plain};
use crate::Vectors;
use crate::picture::Plane;

/// Most bytes that may be left after all blocks are decoded; some cameras pad.
const MAX_LEFT_OVER: i64 = 16;

pub(super) struct ComponentDecoder<'a> {
    /// Blocks of the component in an MCU, across and down (T.81: H and V).
    pub(super) h: usize,
    pub(super) v: usize,
    pub(super) quantiser: &'a [i32; 64],
    pub(super) dc_table: &'a Table,
    pub(super) ac_table: &'a Table,
    /// The DC coefficient of the previous block; the next one is coded as a difference from it.
    pub(super) predictor: i32,
    pub(super) queue: BlockQueue,
    pub(super) plane: &'a mut Plane,
}

pub(super) fn decode_scan(
    vectors: Vectors,
    scan: &Scan,
    restart_interval: usize,
    across: usize,
    down: usize,
    mut components: [ComponentDecoder<'_>; 3],
) -> Result<(), FrameError> {
    let mcus = across * down;
    let interval = if restart_interval == 0 {
        mcus
    } else {
        restart_interval
    };
    if scan.intervals() != mcus.div_ceil(interval) {
        return Err(FrameError::damaged("a part of its data is missing"));
    }
    for index in 0..scan.intervals() {
        for component in &mut components {
            component.predictor = 0;
        }
        let mcus = Mcus {
            bits: scan.bits(index),
            mcus: index * interval..mcus.min((index + 1) * interval),
            across,
            components: &mut components,
        };
        if mcus.decode(vectors)?.left() > MAX_LEFT_OVER * 8 {
            return Err(FrameError::damaged(
                "its data continues after the last block",
            ));
        }
    }
    Ok(())
}

/// The MCUs of a restart interval; `across` is their number per row.
struct Mcus<'a, 'b, 'c> {
    bits: Bits<'a>,
    mcus: Range<usize>,
    across: usize,
    components: &'b mut [ComponentDecoder<'c>; 3],
}

impl<'a> Mcus<'a, '_, '_> {
    /// Decodes all; returns the bits after them.
    fn decode(self, vectors: Vectors) -> Result<Bits<'a>, FrameError> {
        match vectors {
            Vectors::Plain => self.decode_on(Plain),
            #[cfg(target_arch = "x86_64")]
            Vectors::Avx2(v3) => v3.vectorize(OnV3(v3, self)),
        }
    }

    /// Compiled for each machine. This and all functions on its hot path must be
    /// `#[inline(always)]`: a function that is not inlined is compiled without the machine's
    /// instructions.
    #[inline(always)]
    fn decode_on<M: Machine>(mut self, machine: M) -> Result<Bits<'a>, FrameError> {
        let mut x = self.mcus.start % self.across;
        let mut y = self.mcus.start / self.across;
        for _ in self.mcus {
            for component in &mut *self.components {
                decode_blocks(machine, &mut self.bits, component, x, y)
                    .ok_or_else(|| FrameError::damaged("its data is invalid"))?;
            }
            if self.bits.left() < 0 {
                return Err(FrameError::damaged("its data ends early"));
            }
            x += 1;
            if x == self.across {
                (x, y) = (0, y + 1);
            }
        }
        for component in self.components {
            component.queue.finish(machine, component.plane);
        }
        Ok(self.bits)
    }
}

/// Decodes with AVX2 enabled. This is not a closure, because a closure might not be inlined.
#[cfg(target_arch = "x86_64")]
struct OnV3<'a, 'b, 'c>(pulp::x86::V3, Mcus<'a, 'b, 'c>);

#[cfg(target_arch = "x86_64")]
impl<'a> pulp::NullaryFnOnce for OnV3<'a, '_, '_> {
    type Output = Result<Bits<'a>, FrameError>;

    #[inline(always)]
    fn call(self) -> Self::Output {
        self.1.decode_on(self.0)
    }
}

/// Decodes the blocks of a component in the MCU at column `x`, row `y`.
#[inline(always)]
fn decode_blocks<M: Machine>(
    machine: M,
    bits: &mut Bits<'_>,
    component: &mut ComponentDecoder<'_>,
    x: usize,
    y: usize,
) -> Option<()> {
    let dc_table = component.dc_table;
    let ac_table = component.ac_table;
    let quantiser = component.quantiser;
    let stride = component.plane.stride;
    for row in 0..component.v {
        for column in 0..component.h {
            let at = (y * component.v + row) * 8 * stride + (x * component.h + column) * 8;
            let coefficients = component.queue.next();
            let predictor = &mut component.predictor;
            if decode_block(bits, dc_table, ac_table, quantiser, predictor, coefficients)? {
                component.queue.put(machine, component.plane, at);
            } else {
                idct::fill(
                    coefficients.0[0],
                    &mut component.plane.samples[at..],
                    stride,
                );
            }
        }
    }
    Some(())
}

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
    dc_table: &Table,
    ac_table: &Table,
    quantiser: &[i32; 64],
    predictor: &mut i32,
    Coefficients(coefficients): &mut Coefficients,
) -> Option<bool> {
    *predictor = predictor.wrapping_add(decode_difference(bits, dc_table)?);
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
        let (run, value) = ac_table.next(bits)?;
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

#[inline(always)]
fn decode_difference(bits: &mut Bits<'_>, dc_table: &Table) -> Option<i32> {
    // Most blocks need fewer bits than this loads, so the branch in the next refill is predictable.
    bits.refill_always();
    let step = dc_table.step(bits.peek(STEP_BITS));
    if step.taken() > 0 {
        bits.skip(step.taken());
        return Some(step.first_value());
    }
    match dc_table.next(bits)? {
        (0, difference) => Some(difference),
        _ => None,
    }
}

/// The position after a block without AC coefficients, for [`Step::ends`].
const END_WITHOUT_AC: usize = 129;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::jpeg::huffman::STANDARD_TABLES;

    /// The standard's luma tables: DC, AC.
    fn tables() -> (Table, Table) {
        let mut dc = Table::default();
        let mut ac = Table::default();
        let mut rest = &STANDARD_TABLES[4..];
        for is_ac in [false, true] {
            let counts = rest[1..].first_chunk::<16>().unwrap();
            let len: usize = counts.iter().copied().map(usize::from).sum();
            let symbols = &rest[17..][..len];
            let table = if is_ac { &mut ac } else { &mut dc };
            assert!(table.load(is_ac, counts, symbols));
            rest = &rest[17 + len..];
        }
        (dc, ac)
    }

    /// Decodes code by code as in the standard (T.81 F.2.2).
    fn one_by_one(
        bits: &mut Bits<'_>,
        (dc, ac): (&Table, &Table),
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
            let (run, value) = ac.next(bits)?;
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
                    let any = decode_block(&mut bits, &dc, &ac, &quantiser, &mut predictor, &mut found);
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
