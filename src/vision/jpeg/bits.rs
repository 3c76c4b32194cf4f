//! The data between a JPEG's markers as a stream of bits.

use super::frame::FrameError;

/// Zeros behind the data, so that eight bytes can be read at once up to its end.
const PADDING: usize = 16;

/// A scan's data without its stuffing, cut at the restart markers.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scan {
    bytes: Vec<u8>,
    /// Where each interval ends.
    ends: Vec<usize>,
}

impl Scan {
    /// Forgets the scan before.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        self.ends.clear();
    }

    /// Takes the bytes behind a scan's header, or the rest of them; returns the marker that ends
    /// the scan.
    pub(crate) fn load(&mut self, mut rest: &[u8]) -> Result<u8, FrameError> {
        loop {
            rest = &rest[self.take(rest)..];
            let &[_, code, ..] = rest else {
                return Err(FrameError::NoEnd);
            };
            rest = &rest[2..];
            match code {
                0xD0..=0xD7 if usize::from(code & 7) == self.ends.len() % 8 => {
                    self.ends.push(self.bytes.len())
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

    /// Takes bytes up to a marker or to where they end for now; returns how many.
    pub(crate) fn take(&mut self, data: &[u8]) -> usize {
        let mut at = 0;
        loop {
            let plain = first_ff(&data[at..]);
            self.bytes.extend_from_slice(&data[at..at + plain]);
            at += plain;
            match data.get(at + 1) {
                Some(0) => {
                    self.bytes.push(0xFF);
                    at += 2;
                }
                Some(0xFF) => at += 1,
                _ => return at,
            }
        }
    }

    /// How many intervals there are.
    pub(crate) fn intervals(&self) -> usize {
        self.ends.len()
    }

    /// The bits of an interval, which must exist.
    pub(crate) fn bits(&self, interval: usize) -> Bits<'_> {
        let start = if interval == 0 {
            0
        } else {
            self.ends[interval - 1]
        };
        Bits {
            bytes: &self.bytes[start..],
            len: self.ends[interval] - start,
            cursor: Cursor::default(),
        }
    }

    /// The bits of the first interval from a place on, as far as they are there.
    pub(crate) fn bits_from(&self, cursor: Cursor) -> Bits<'_> {
        Bits {
            bytes: &self.bytes,
            len: self.ends.first().copied().unwrap_or(self.bytes.len()),
            cursor,
        }
    }
}

/// Where the first 0xFF stands, or the length; eight bytes at a time.
fn first_ff(bytes: &[u8]) -> usize {
    let (words, _) = bytes.as_chunks::<8>();
    for (index, word) in words.iter().enumerate() {
        let inverted = !u64::from_le_bytes(*word);
        // The highest bit of a byte is set where the byte was 0xFF; above the lowest such byte it
        // may lie.
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

/// Reads bits, the highest of a byte first. Behind the end come zeros; [`Bits::left`] tells.
#[derive(Clone, Copy)]
pub(crate) struct Bits<'a> {
    bytes: &'a [u8],
    len: usize,
    cursor: Cursor,
}

/// How far bits have been read.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Cursor {
    at: usize,
    /// The next bits, from the top.
    buffer: u64,
    /// How many of them count; below 64.
    count: u32,
}

impl Bits<'_> {
    /// Makes sure that `LEAST` bits can be looked at, 56 at most.
    #[inline(always)]
    pub(crate) fn refill<const LEAST: u32>(&mut self) {
        if self.cursor.count < LEAST {
            self.refill_always();
        }
    }

    /// Makes sure that 56 bits can be looked at.
    #[inline(always)]
    pub(crate) fn refill_always(&mut self) {
        let Cursor { at, buffer, count } = &mut self.cursor;
        let next = self.bytes.get(*at..).and_then(<[u8]>::first_chunk::<8>);
        let word = next.map_or(0, |bytes| u64::from_be_bytes(*bytes));
        // Bits of a byte that was taken in part are there already, and the same.
        *buffer |= word >> *count;
        *at += (63 - *count) as usize / 8;
        *count |= 56;
    }

    /// The next bits, 1 to 32, without taking them; [`Bits::refill`] must have come before.
    #[inline(always)]
    pub(crate) fn peek(&self, bits: u32) -> usize {
        (self.cursor.buffer >> (64 - bits)) as usize
    }

    /// Takes bits that were looked at.
    #[inline(always)]
    pub(crate) fn skip(&mut self, bits: u32) {
        self.cursor.buffer <<= bits;
        self.cursor.count = self.cursor.count.wrapping_sub(bits);
    }

    /// How many bits are left; negative when more were read than there are.
    pub(crate) fn left(&self) -> i64 {
        // Lengths of frames are bounded, so nothing is cut off.
        self.len as i64 * 8 - (self.cursor.at as i64 * 8 - i64::from(self.cursor.count))
    }

    /// How far they have been read.
    pub(crate) fn cursor(&self) -> Cursor {
        self.cursor
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn stuffed_bytes_come_out_as_they_went_in(
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
    fn reading_on_behind_the_end_is_told() {
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
    fn a_lost_interval_is_noticed() {
        let mut scan = Scan::default();
        assert!(
            scan.load(&[1, 0xFF, 0xD0, 2, 0xFF, 0xD2, 3, 0xFF, 0xD9])
                .is_err()
        );
        assert_eq!(scan.load(&[1, 2, 3]), Err(FrameError::NoEnd));
    }
}
