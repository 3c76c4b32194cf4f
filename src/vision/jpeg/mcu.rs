//! Decodes MCUs (minimum coded units): the blocks of all components that cover the same area of the
//! picture.

use std::ops::Range;

use super::bits::{Bits, Cursor, Scan};
use super::block::{BlockQueue, decode_block};
use super::headers::{DecodeError, damaged};
use super::huffman::Table;
use super::idct;
use super::machine::{Machine, Work, run};
use super::steps::AcTable;
use crate::vision::picture::image::Plane;
use crate::vision::vectors::Vectors;

/// Most bytes that may be left after all blocks are decoded; some cameras pad.
const MAX_LEFT_OVER: i64 = 16;

/// Upper limit of the bits of a block: 64 values with a code of 16 bits and 11 bits of value each.
const MAX_BLOCK_BITS: i64 = 64 * (16 + 11);

/// The state of a component while its blocks are decoded.
pub(super) struct ComponentDecoder<'a> {
    /// Blocks of the component in an MCU, across and down (T.81: H and V).
    pub(super) h: usize,
    pub(super) v: usize,
    pub(super) quantiser: &'a [i32; 64],
    pub(super) dc_table: &'a Table,
    pub(super) ac_table: &'a AcTable,
    /// The DC coefficient of the previous block; the next one is coded as a difference from it.
    pub(super) predictor: i32,
    pub(super) queue: BlockQueue,
    pub(super) plane: &'a mut Plane,
}

/// Decodes all MCUs of a scan.
pub(super) fn decode_scan(
    vectors: Vectors,
    scan: &Scan,
    restart_interval: usize,
    (across, down): (usize, usize),
    mut components: [ComponentDecoder<'_>; 3],
) -> Result<(), DecodeError> {
    let mcus = across * down;
    let interval = if restart_interval == 0 {
        mcus
    } else {
        restart_interval
    };
    if scan.intervals() != mcus.div_ceil(interval) {
        return Err(damaged("a part of its data is missing"));
    }
    for index in 0..scan.intervals() {
        components
            .iter_mut()
            .for_each(|component| component.predictor = 0);
        let some = index * interval..mcus.min((index + 1) * interval);
        decode_interval(vectors, scan.bits(index), some, across, &mut components)?;
    }
    Ok(())
}

/// Decodes the remaining MCUs of a restart interval, which must end with them; `across` is the
/// number of MCUs per row.
pub(super) fn decode_interval(
    vectors: Vectors,
    bits: Bits<'_>,
    mcus: Range<usize>,
    across: usize,
    components: &mut [ComponentDecoder<'_>; 3],
) -> Result<(), DecodeError> {
    let mcus = Mcus {
        bits,
        mcus,
        across,
        components,
        reserve: i64::MIN,
    };
    let (bits, _) = run(vectors, mcus)?;
    if bits.left() > MAX_LEFT_OVER * 8 {
        return Err(damaged("its data continues after the last block"));
    }
    Ok(())
}

/// Decodes MCUs as long as enough bits have been received. Returns the read position and the index
/// of the next MCU.
pub(super) fn decode_ahead(
    vectors: Vectors,
    bits: Bits<'_>,
    mcus: Range<usize>,
    across: usize,
    components: &mut [ComponentDecoder<'_>; 3],
) -> Result<(Cursor, usize), DecodeError> {
    let blocks: usize = components.iter().map(|part| part.h * part.v).sum();
    let mcus = Mcus {
        bits,
        mcus,
        across,
        components,
        reserve: blocks as i64 * MAX_BLOCK_BITS,
    };
    let (bits, mcu) = run(vectors, mcus)?;
    Ok((bits.cursor(), mcu))
}

/// MCUs to decode while more than `reserve` bits are left.
struct Mcus<'a, 'b, 'c> {
    bits: Bits<'a>,
    mcus: Range<usize>,
    across: usize,
    components: &'b mut [ComponentDecoder<'c>; 3],
    reserve: i64,
}

impl<'a> Work for Mcus<'a, '_, '_> {
    /// The bits after the decoded MCUs, and the index of the next MCU.
    type Output = Result<(Bits<'a>, usize), DecodeError>;

    #[inline(always)]
    fn run<M: Machine>(mut self, machine: M) -> Self::Output {
        let Range { start, end } = self.mcus;
        let mut mcu = start;
        let mut x = start % self.across;
        let mut y = start / self.across;
        while mcu < end && self.bits.left() > self.reserve {
            for component in &mut *self.components {
                decode_blocks(machine, &mut self.bits, component, x, y)
                    .ok_or_else(|| damaged("its data is invalid"))?;
            }
            if self.bits.left() < 0 {
                return Err(damaged("its data ends early"));
            }
            (mcu, x) = (mcu + 1, x + 1);
            if x == self.across {
                (x, y) = (0, y + 1);
            }
        }
        for component in self.components {
            component.queue.finish(machine, component.plane);
        }
        Ok((self.bits, mcu))
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
    let tables = (component.dc_table, component.ac_table);
    let quantiser = component.quantiser;
    let stride = component.plane.stride;
    for row in 0..component.v {
        for column in 0..component.h {
            let at = (y * component.v + row) * 8 * stride + (x * component.h + column) * 8;
            let coefficients = component.queue.next();
            let predictor = &mut component.predictor;
            if decode_block(bits, tables, quantiser, predictor, coefficients)? {
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
