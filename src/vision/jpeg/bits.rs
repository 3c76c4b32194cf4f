//! Reads the entropy-coded data between a JPEG's markers as a bit stream.

use super::frame::FrameError;

/// Zero bytes appended to the data, so that eight bytes can be read at once up to its end.
const PADDING: usize = 16;

#[derive(Debug, Clone, Default)]
pub(crate) struct Scan {
    bytes: Vec<u8>,
    ends: Vec<usize>,
}

impl Scan {
    /// Reads the bytes after a scan's header. Returns the code of the marker that ends the scan.
    pub(crate) fn load(&mut self, data: &[u8]) -> Result<u8, FrameError> {
        self.bytes.clear();
        self.ends.clear();
        let mut at = 0;
        loop {
            let plain = first_ff(&data[at..]);
            self.bytes.extend_from_slice(&data[at..at + plain]);
            at += plain;
            let &[_, code, ..] = &data[at..] else {
                return Err(FrameError::NoEnd);
            };
            at += 2;
            match code {
                0 => self.bytes.push(0xFF),
                0xFF => at -= 1,
                0xD0..=0xD7 if usize::from(code & 7) == self.ends.len() % 8 => {
                    self.ends.push(self.bytes.len());
                }
                0xD0..=0xD7 => return Err(FrameError::damaged("a part of its data is missing")),
                _ => {
                    self.ends.push(self.bytes.len());
                    self.bytes.extend([0; PADDING]);
                    return Ok(code);
                }
            }
        }
    }

    pub(crate) fn intervals(&self) -> usize {
        self.ends.len()
    }

    /// The bits of a restart interval, which must exist.
    pub(crate) fn bits(&self, interval: usize) -> Bits<'_> {
        let start = if interval == 0 {
            0
        } else {
            self.ends[interval - 1]
        };
        Bits {
            bytes: &self.bytes[start..],
            len: self.ends[interval] - start,
            at: 0,
            buffer: 0,
            count: 0,
        }
    }
}

/// The position of the first 0xFF, or the length; compares eight bytes at a time.
fn first_ff(bytes: &[u8]) -> usize {
    let (words, _) = bytes.as_chunks::<8>();
    for (index, word) in words.iter().enumerate() {
        let inverted = !u64::from_le_bytes(*word);
        // The highest bit of each byte that was 0xFF is set. Bytes above the lowest such byte may
        // be set wrongly.
        let zeros =
            inverted.wrapping_sub(0x0101_0101_0101_0101) & !inverted & 0x8080_8080_8080_8080;
        if zeros != 0 {
            return index * 8 + zeros.trailing_zeros() as usize / 8;
        }
    }
    let tail = words.len() * 8;
    tail + bytes[tail..]
        .iter()
        .take_while(|byte| **byte != 0xFF)
        .count()
}

/// Reads bits, the highest bit of a byte first. Zeros follow after the end, which [`Bits::left`]
/// reveals.
#[derive(Clone, Copy)]
pub(crate) struct Bits<'a> {
    bytes: &'a [u8],
    len: usize,
    at: usize,
    /// The next bits, aligned to the top.
    buffer: u64,
    count: u32,
}

impl Bits<'_> {
    /// Ensures that at least `LEAST` bits can be peeked, at most 56.
    #[inline(always)]
    pub(crate) fn refill<const LEAST: u32>(&mut self) {
        if self.count < LEAST {
            self.refill_always();
        }
    }

    /// Ensures that 56 bits can be peeked.
    #[inline(always)]
    pub(crate) fn refill_always(&mut self) {
        let next = self.bytes.get(self.at..).and_then(<[u8]>::first_chunk::<8>);
        let word = next.map_or(0, |bytes| u64::from_be_bytes(*bytes));
        // The bits of a partly consumed byte are already in the buffer with the same values.
        self.buffer |= word >> self.count;
        self.at += (63 - self.count) as usize / 8;
        self.count |= 56;
    }

    /// The next 1 to 32 bits, without consuming them; requires a preceding [`Bits::refill`].
    #[inline(always)]
    pub(crate) fn peek(&self, bits: u32) -> usize {
        (self.buffer >> (64 - bits)) as usize
    }

    #[inline(always)]
    pub(crate) fn skip(&mut self, bits: u32) {
        self.buffer <<= bits;
        self.count = self.count.wrapping_sub(bits);
    }

    /// The number of bits left; negative if more were consumed than there are.
    pub(crate) fn left(&self) -> i64 {
        // Frame lengths are bounded, so nothing is truncated.
        self.len as i64 * 8 - (self.at as i64 * 8 - i64::from(self.count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stuffed_bytes_are_restored(
            parts in proptest::collection::vec(proptest::collection::vec(prop_oneof![Just(0xFF), any::<u8>()], 0..40), 1..12),
        ) {
            let mut stuffed = Vec::new();
            for (index, part) in parts.iter().enumerate() {
                if index > 0 {
                    stuffed.extend([0xFF, 0xD0 + (index as u8 - 1) % 8]);
                }
                part.iter().for_each(|byte| stuffed.extend(if *byte == 0xFF { vec![0xFF, 0] } else { vec![*byte] }));
            }
            stuffed.extend([0xFF, 0xD9, 1, 2, 3]);
            let mut scan = Scan::default();
            prop_assert_eq!(scan.load(&stuffed), Ok(0xD9));
            prop_assert_eq!(scan.intervals(), parts.len());
            for (index, part) in parts.iter().enumerate() {
                let mut bits = scan.bits(index);
                for byte in part {
                    bits.refill::<32>();
                    prop_assert_eq!(bits.peek(8), usize::from(*byte));
                    bits.skip(8);
                }
                prop_assert_eq!(bits.left(), 0);
            }
        }
    }

    #[test]
    fn reading_beyond_the_end_is_reported() {
        let mut scan = Scan::default();
        scan.load(&[0x12, 0xFF, 0xD9]).unwrap();
        let mut bits = scan.bits(0);
        for _ in 0..1000 {
            bits.refill::<32>();
            bits.skip(31);
        }
        assert_eq!(bits.left(), 8 - 31_000);
    }

    #[test]
    fn a_missing_interval_is_an_error() {
        let mut scan = Scan::default();
        assert!(
            scan.load(&[1, 0xFF, 0xD0, 2, 0xFF, 0xD2, 3, 0xFF, 0xD9])
                .is_err()
        );
        assert_eq!(scan.load(&[1, 2, 3]), Err(FrameError::NoEnd));
    }
}
