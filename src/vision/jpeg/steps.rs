//! A Huffman table for AC coefficients that decodes up to two values and the end of the block in
//! one look-up.

use super::huffman::{Coded, Table};

/// Number of bits per look-up. A larger table decodes more values at once, but takes more of the
/// first-level cache.
pub(super) const STEP_BITS: u32 = 10;

/// The offset of a value that a [`Step`] does not have: such a position is beyond every block.
const NOWHERE: u32 = 64;
/// The advance of a [`Step`] that ends the block.
const END: u32 = 128;

/// The meaning of the next bits. Bits 0..8: number of bits consumed; 8..16 and 16..24: offsets of
/// the two values from the current position, or [`NOWHERE`]; 24..32: advance of the position;
/// 32..48 and 48..64: the values.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step(u64);

impl Step {
    /// The next bits are not a value in the table and must be decoded code by code; see
    /// [`Step::ends`].
    const UNKNOWN: Step = Step::new(0, [NOWHERE; 2], NOWHERE, [0; 2]);

    const fn new(taken: u32, offsets: [u32; 2], advance: u32, values: [i32; 2]) -> Step {
        let low = taken | offsets[0] << 8 | offsets[1] << 16 | advance << 24;
        let high = values[0] as u16 as u32 | (values[1] as u16 as u32) << 16;
        Step(low as u64 | (high as u64) << 32)
    }

    #[inline(always)]
    pub(super) fn taken(self) -> u32 {
        self.0 as u32 & 0xFF
    }

    /// The position of the first value, below 128; from 64 on there is none.
    #[inline(always)]
    pub(super) fn first_place(self, index: usize) -> usize {
        index + (self.0 as usize >> 8 & 0xFF)
    }

    /// Like [`Step::first_place`], for the second value.
    #[inline(always)]
    pub(super) fn second_place(self, index: usize) -> usize {
        index + (self.0 as usize >> 16 & 0xFF)
    }

    #[inline(always)]
    pub(super) fn first_value(self) -> i32 {
        (self.0 >> 32) as i16 as i32
    }

    #[inline(always)]
    pub(super) fn second_value(self) -> i32 {
        (self.0 >> 48) as i16 as i32
    }

    /// The next position if it is below 64; otherwise to be passed to [`Step::ends`].
    #[inline(always)]
    pub(super) fn next(self, index: usize) -> usize {
        index + (self.0 as u32 >> 24) as usize
    }

    /// Whether the block ends with this step. Every other position from 64 on must be decoded code
    /// by code: it is beyond the end of the block, or the code is not in the table.
    #[inline(always)]
    pub(super) fn ends(next: usize) -> bool {
        (END as usize..END as usize + 64).contains(&next)
    }
}

/// The Huffman codes of AC coefficients, prepared for decoding.
#[derive(Debug, Clone)]
pub(super) struct AcTable {
    /// For decoding code by code.
    pub(super) codes: Table,
    steps: Box<[Step; 1 << STEP_BITS]>,
}

impl Default for AcTable {
    fn default() -> Self {
        AcTable {
            codes: Table::default(),
            steps: Box::new([Step::UNKNOWN; 1 << STEP_BITS]),
        }
    }
}

impl AcTable {
    /// See [`Table::load`].
    pub(super) fn load(&mut self, counts: &[u8; 16], symbols: &[u8]) -> bool {
        if self.codes.has_definition(counts, symbols) {
            return true;
        }
        let makes_sense = self.codes.load(counts, symbols);
        if makes_sense {
            for bits in 0..1 << STEP_BITS {
                self.steps[bits as usize] = step(&self.codes, bits << (16 - STEP_BITS));
            }
        }
        makes_sense
    }

    /// The meaning of the next [`STEP_BITS`] bits.
    #[inline(always)]
    pub(super) fn step(&self, bits: usize) -> Step {
        self.steps[bits % (1 << STEP_BITS)]
    }
}

/// The meaning of a code.
enum Meaning {
    Value(Coded),
    End(u32),
}

/// Decodes the top [`STEP_BITS`] of 16 bits.
fn step(codes: &Table, bits: u32) -> Step {
    let meaning = |taken: u32| {
        let coded = codes.coded(bits << taken & 0xFFFF, STEP_BITS - taken)?;
        match (coded.run, coded.value) {
            (0, 0) => Some(Meaning::End(coded.taken)),
            // A run of sixteen zeros, or an invalid code: rare, so not in the table.
            (_, 0) => None,
            _ => Some(Meaning::Value(coded)),
        }
    };
    let first = match meaning(0) {
        Some(Meaning::Value(first)) => first,
        Some(Meaning::End(taken)) => return Step::new(taken, [NOWHERE; 2], END, [0; 2]),
        None => return Step::UNKNOWN,
    };
    let near = u32::from(first.run);
    let alone = |taken, end| Step::new(taken, [near, NOWHERE], near + 1 + end, [first.value, 0]);
    let second = match meaning(first.taken) {
        Some(Meaning::Value(second)) => second,
        Some(Meaning::End(taken)) => return alone(first.taken + taken, END),
        None => return alone(first.taken, 0),
    };
    let far = near + 1 + u32::from(second.run);
    let both = first.taken + second.taken;
    let (taken, end) = match meaning(both) {
        Some(Meaning::End(taken)) => (both + taken, END),
        _ => (both, 0),
    };
    let values = [first.value, second.value];
    Step::new(taken, [near, far], far + 1 + end, values)
}
