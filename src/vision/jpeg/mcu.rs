//! Decodes MCUs (minimum coded units): the blocks of all components that share one place of the
//! picture.

use std::ops::Range;

use super::bits::{Bits, Scan};
use super::headers::{DecodeError, damaged};
use super::huffman::Table;
use super::idct;
use crate::vision::picture::image::Plane;

/// Most bytes that may be left over when all blocks are decoded; some cameras pad.
const MAX_LEFT_OVER: i64 = 16;

/// Bits that a block cannot exceed: 64 values, a code of 16 and 11 of their own each.
pub(super) const MAX_BLOCK_BITS: usize = 64 * (16 + 11);

/// A component while its blocks are decoded.
pub(super) struct ComponentDecoder<'a> {
    /// Blocks of it in an MCU, across and down (T.81: H and V).
    pub(super) h: usize,
    pub(super) v: usize,
    pub(super) quantiser: [i32; 64],
    pub(super) dc_table: &'a Table,
    pub(super) ac_table: &'a Table,
    /// The DC coefficient of the block before: the next one is coded as a difference to it.
    pub(super) predictor: i32,
    pub(super) plane: &'a mut Plane,
}

/// Decodes all MCUs of a scan.
pub(super) fn decode_scan(
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
        decode_interval(scan.bits(index), some, across, &mut components)?;
    }
    Ok(())
}

/// Decodes the MCUs that are left of a restart interval, which must end with them.
pub(super) fn decode_interval(
    mut bits: Bits<'_>,
    mcus: Range<usize>,
    across: usize,
    components: &mut [ComponentDecoder<'_>; 3],
) -> Result<(), DecodeError> {
    for mcu in mcus {
        decode_mcu(&mut bits, components, mcu, across)?;
        if bits.left() < 0 {
            return Err(damaged("its data ends early"));
        }
    }
    if bits.left() > MAX_LEFT_OVER * 8 {
        return Err(damaged("its data goes on behind its end"));
    }
    Ok(())
}

/// Decodes MCU number `mcu`; `across` is how many there are in a row.
#[inline]
pub(super) fn decode_mcu(
    bits: &mut Bits<'_>,
    components: &mut [ComponentDecoder<'_>; 3],
    mcu: usize,
    across: usize,
) -> Result<(), DecodeError> {
    for component in components {
        decode_blocks(bits, component, mcu % across, mcu / across)
            .ok_or_else(|| damaged("its data makes no sense"))?;
    }
    Ok(())
}

/// Decodes the blocks of a component in the MCU at column `x`, row `y`.
#[inline]
fn decode_blocks(
    bits: &mut Bits<'_>,
    component: &mut ComponentDecoder<'_>,
    x: usize,
    y: usize,
) -> Option<()> {
    for row in 0..component.v {
        for column in 0..component.h {
            let stride = component.plane.stride;
            let at = (y * component.v + row) * 8 * stride + (x * component.h + column) * 8;
            let mut coefficients = [0; 64];
            let has_ac = decode_block(bits, component, &mut coefficients)?;
            let target = &mut component.plane.samples[at..];
            if has_ac {
                idct::transform(&mut coefficients, target, stride);
            } else {
                idct::fill(coefficients[0], target, stride);
            }
        }
    }
    Some(())
}

/// Reads a block's coefficients, multiplied by their quantisers; whether there are AC coefficients.
#[inline(never)]
fn decode_block(
    bits: &mut Bits<'_>,
    component: &mut ComponentDecoder<'_>,
    coefficients: &mut [i16; 64],
) -> Option<bool> {
    // A copy of its own stays in registers.
    let mut local = *bits;
    let (run, difference) = component.dc_table.next(&mut local)?;
    if run != 0 {
        return None;
    }
    component.predictor = component.predictor.wrapping_add(difference);
    coefficients[0] = idct::dequantised(component.predictor, component.quantiser[0]);
    let mut index = 1;
    while index < 64 {
        let (run, value) = component.ac_table.next(&mut local)?;
        index += run as usize;
        if value == 0 {
            match run {
                0 => break,
                15 => {}
                _ => return None,
            }
        } else {
            let place = idct::ZIGZAG.get(index)?;
            coefficients[usize::from(place & 63)] =
                idct::dequantised(value, component.quantiser[index & 63]);
        }
        index += 1;
    }
    *bits = local;
    Some(coefficients[1..].iter().any(|value| *value != 0))
}
