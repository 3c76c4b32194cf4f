//! Writes codes bit by bit, with JPEG's byte stuffing.

use bytes::Bytes;

use super::tables::Codes;

/// A file to which bits are appended.
pub(super) struct BitWriter {
    file: Vec<u8>,
    /// The lowest `count` bits are not in the file yet.
    waiting: u64,
    count: u32,
}

impl BitWriter {
    /// Starts a file with `head`.
    pub(super) fn after(head: &[u8]) -> BitWriter {
        let mut file = Vec::with_capacity(16 * 1024);
        file.extend_from_slice(head);
        BitWriter {
            file,
            waiting: 0,
            count: 0,
        }
    }

    /// Writes a value: the code of `zeros` and of the value's length, and its bits (T.81, F.1.2).
    pub(super) fn push_value(&mut self, codes: &Codes, zeros: u32, value: i32) {
        let len = 32 - value.unsigned_abs().leading_zeros();
        let (code, code_len) = codes[(zeros << 4 | len) as usize & 255];
        let ones = (1 << len) - 1;
        let bits = (value + (value >> 31)) as u32 & ones;
        self.push(code << len | bits, code_len + len);
    }

    /// Writes the code of a symbol.
    pub(super) fn push_code(&mut self, codes: &Codes, symbol: u8) {
        let (code, len) = codes[usize::from(symbol)];
        self.push(code, len);
    }

    /// Writes at most 32 bits.
    fn push(&mut self, bits: u32, len: u32) {
        self.waiting = self.waiting << len | u64::from(bits);
        self.count += len;
        if self.count >= 32 {
            self.count -= 32;
            let four = ((self.waiting >> self.count) as u32).to_be_bytes();
            if four.contains(&0xFF) {
                four.into_iter().for_each(|byte| self.put(byte));
            } else {
                self.file.extend_from_slice(&four);
            }
        }
    }

    fn put(&mut self, byte: u8) {
        self.file.push(byte);
        if byte == 0xFF {
            self.file.push(0);
        }
    }

    /// Completes the file.
    pub(super) fn end(mut self) -> Bytes {
        while self.count > 0 {
            let missing = 8u32.saturating_sub(self.count);
            self.waiting = self.waiting << missing | ((1 << missing) - 1);
            self.count = self.count + missing - 8;
            self.put((self.waiting >> self.count) as u8);
        }
        self.file.extend_from_slice(&[0xFF, 0xD9]);
        Bytes::from(self.file)
    }
}
