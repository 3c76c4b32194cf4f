//! Huffman tables of JPEG: decoding of codes, and the tables that the standard suggests.

use super::bits::Bits;

/// Number of bits per look-up. A larger table decodes more values at once, but takes more of the
/// first-level cache.
pub(super) const STEP_BITS: u32 = 10;

/// A table, prepared for decoding. The upper half of a symbol is a run of zeros, the lower half the
/// number of bits of the value that follows.
#[derive(Debug, Clone)]
pub(super) struct Table {
    /// The definition in the frame, 16 counts and the symbols: used to detect that the next frame
    /// has the same table.
    source: Vec<u8>,
    /// For each code length, the first longer code, as 16 bits aligned to the top.
    above: [u32; 17],
    /// For each code length, the offset from a code to the index of its symbol.
    place: [i32; 17],
    symbols: [u8; 256],
    steps: Box<[Step; 1 << STEP_BITS]>,
}

/// A decoded code and the value that follows it.
#[derive(Debug, Clone, Copy)]
struct Coded {
    taken: u32,
    run: u8,
    value: i32,
}

impl Default for Table {
    fn default() -> Self {
        Table {
            source: Vec::new(),
            above: [0; 17],
            place: [0; 17],
            symbols: [0; 256],
            steps: Box::new([Step::UNKNOWN; 1 << STEP_BITS]),
        }
    }
}

impl Table {
    /// Builds the table from its definition in a frame: 16 counts, one for each code length, and
    /// the symbols in the order of their codes. In a table for AC coefficients, a step decodes up to
    /// two of them and the end of the block. Returns whether it is valid. Does nothing if the previous
    /// frame had the same table.
    pub(super) fn load(&mut self, is_ac: bool, counts: &[u8; 16], symbols: &[u8]) -> bool {
        if self.source.get(..16) == Some(counts) && &self.source[16..] == symbols {
            return true;
        }
        self.source.clear();
        if symbols.len() > 256 || !self.number(counts) {
            return false;
        }
        self.symbols = [0; 256];
        self.symbols[..symbols.len()].copy_from_slice(symbols);
        for bits in 0..1 << STEP_BITS {
            let top = bits << (16 - STEP_BITS);
            self.steps[bits as usize] = if is_ac {
                self.ac_step(top)
            } else {
                self.dc_step(top)
            };
        }
        self.source.extend_from_slice(counts);
        self.source.extend_from_slice(symbols);
        true
    }

    /// Assigns the codes: shorter ones first, each length continuing after the previous one.
    fn number(&mut self, counts: &[u8; 16]) -> bool {
        let mut code = 0u32;
        let mut place = 0i32;
        for (length, count) in (1..=16).zip(counts) {
            self.place[length] = place - code as i32;
            code += u32::from(*count);
            place += i32::from(*count);
            if code > 1 << length {
                return false;
            }
            self.above[length] = code << (16 - length);
            code <<= 1;
        }
        true
    }

    /// Decodes a code and its value from the top of 16 bits, of which only the first `known` are
    /// valid; `None` if they need more bits or the code does not exist.
    fn coded(&self, bits: u32, known: u32) -> Option<Coded> {
        let (symbol, length) = self.code(bits)?;
        let run = symbol >> 4;
        let size = u32::from(symbol & 15);
        let taken = length + size;
        if taken > known {
            return None;
        }
        let value = match size {
            0 => 0,
            _ => signed(bits >> (16 - taken) & ((1 << size) - 1), size),
        };
        Some(Coded { taken, run, value })
    }

    /// Symbol and length of the code at the top of 16 bits.
    fn code(&self, bits: u32) -> Option<(u8, u32)> {
        let length = (1..=16).find(|length| bits < self.above[*length])?;
        let place = (bits >> (16 - length)) as i32 + self.place[length];
        Some((self.symbols[place as usize & 0xFF], length as u32))
    }

    /// The meaning of the next [`STEP_BITS`] bits.
    #[inline(always)]
    pub(super) fn step(&self, bits: usize) -> Step {
        self.steps[bits % (1 << STEP_BITS)]
    }

    /// The next run of zeros and the value after it; a value of 0 means that there is none. Returns
    /// `None` for a code that does not exist. Slow: for what is not in the steps.
    #[inline(always)]
    pub(super) fn next(&self, bits: &mut Bits<'_>) -> Option<(u32, i32)> {
        let mut copy = *bits;
        let found = self.next_slowly(&mut copy);
        *bits = copy;
        found
    }

    #[cold]
    fn next_slowly(&self, bits: &mut Bits<'_>) -> Option<(u32, i32)> {
        bits.refill::<32>();
        let (symbol, length) = self.code(bits.peek(16) as u32)?;
        bits.skip(length);
        let run = u32::from(symbol >> 4);
        let size = u32::from(symbol & 15);
        if size == 0 {
            return Some((run, 0));
        }
        // A code has at most 16 bits, so 16 of the 32 are left for the value.
        let plain = bits.peek(size) as u32;
        bits.skip(size);
        Some((run, signed(plain, size)))
    }

    fn dc_step(&self, bits: u32) -> Step {
        match self.coded(bits, STEP_BITS) {
            Some(Coded {
                taken,
                run: 0,
                value,
            }) => Step::new(taken, [0, NOWHERE], 0, [value, 0]),
            _ => Step::UNKNOWN,
        }
    }

    /// Decodes the top [`STEP_BITS`] of 16 bits.
    fn ac_step(&self, bits: u32) -> Step {
        let meaning = |taken: u32| {
            let coded = self.coded(bits << taken & 0xFFFF, STEP_BITS - taken)?;
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
        let alone =
            |taken, end| Step::new(taken, [near, NOWHERE], near + 1 + end, [first.value, 0]);
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
}

/// Converts the bits of a value: values whose first bit is 0 are negative.
fn signed(plain: u32, size: u32) -> i32 {
    let value = plain as i32;
    if value < 1 << (size - 1) {
        value - (1 << size) + 1
    } else {
        value
    }
}

/// The tables that the standard suggests (T.81, annex K.3) as one segment, including the marker.
/// Motion JPEG cameras use them and omit them from every frame.
#[rustfmt::skip]
pub(crate) const STANDARD_TABLES: [u8; 420] = [
    0xFF, 0xC4, 0x01, 0xA2, 0x00, 0x00, 0x01, 0x05, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x02,
    0x03, 0x04, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0A, 0x0B, 0x10, 0x00, 0x02, 0x01, 0x03, 0x03, 0x02, 0x04, 0x03, 0x05, 0x05, 0x04, 0x04, 0x00, 0x00,
    0x01, 0x7D, 0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71, 0x14, 0x32, 0x81, 0x91,
    0xA1, 0x08, 0x23, 0x42, 0xB1, 0xC1, 0x15, 0x52, 0xD1, 0xF0, 0x24, 0x33, 0x62, 0x72, 0x82, 0x09, 0x0A, 0x16, 0x17, 0x18, 0x19, 0x1A, 0x25, 0x26,
    0x27, 0x28, 0x29, 0x2A, 0x34, 0x35, 0x36, 0x37, 0x38, 0x39, 0x3A, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x53, 0x54, 0x55, 0x56, 0x57,
    0x58, 0x59, 0x5A, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6A, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A, 0x83, 0x84, 0x85, 0x86, 0x87,
    0x88, 0x89, 0x8A, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9A, 0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7, 0xA8, 0xA9, 0xAA, 0xB2, 0xB3, 0xB4,
    0xB5, 0xB6, 0xB7, 0xB8, 0xB9, 0xBA, 0xC2, 0xC3, 0xC4, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8, 0xD9, 0xDA,
    0xE1, 0xE2, 0xE3, 0xE4, 0xE5, 0xE6, 0xE7, 0xE8, 0xE9, 0xEA, 0xF1, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7, 0xF8, 0xF9, 0xFA, 0x01, 0x00, 0x03, 0x01,
    0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x08, 0x09, 0x0A,
    0x0B, 0x11, 0x00, 0x02, 0x01, 0x02, 0x04, 0x04, 0x03, 0x04, 0x07, 0x05, 0x04, 0x04, 0x00, 0x01, 0x02, 0x77, 0x00, 0x01, 0x02, 0x03, 0x11, 0x04,
    0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22, 0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xA1, 0xB1, 0xC1, 0x09, 0x23, 0x33,
    0x52, 0xF0, 0x15, 0x62, 0x72, 0xD1, 0x0A, 0x16, 0x24, 0x34, 0xE1, 0x25, 0xF1, 0x17, 0x18, 0x19, 0x1A, 0x26, 0x27, 0x28, 0x29, 0x2A, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3A, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4A, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59, 0x5A, 0x63, 0x64, 0x65, 0x66,
    0x67, 0x68, 0x69, 0x6A, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7A, 0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8A, 0x92, 0x93, 0x94,
    0x95, 0x96, 0x97, 0x98, 0x99, 0x9A, 0xA2, 0xA3, 0xA4, 0xA5, 0xA6, 0xA7, 0xA8, 0xA9, 0xAA, 0xB2, 0xB3, 0xB4, 0xB5, 0xB6, 0xB7, 0xB8, 0xB9, 0xBA,
    0xC2, 0xC3, 0xC4, 0xC5, 0xC6, 0xC7, 0xC8, 0xC9, 0xCA, 0xD2, 0xD3, 0xD4, 0xD5, 0xD6, 0xD7, 0xD8, 0xD9, 0xDA, 0xE2, 0xE3, 0xE4, 0xE5, 0xE6, 0xE7,
    0xE8, 0xE9, 0xEA, 0xF2, 0xF3, 0xF4, 0xF5, 0xF6, 0xF7, 0xF8, 0xF9, 0xFA,
];

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

enum Meaning {
    Value(Coded),
    End(u32),
}
