//! Which part of a frame on its way a host does not have yet.

use bytes::Bytes;

use crate::robot::Coming;

/// What a host was given of the frame on its way.
#[derive(Debug, Default)]
pub(super) struct Ahead {
    seq: u64,
    passed: usize,
}

impl Ahead {
    /// What has come since the last call, and how many bytes came before it.
    pub(super) fn rest(&mut self, Coming { seq, jpeg }: &Coming) -> Option<(usize, Bytes)> {
        // What is shorter than before is a frame of another connection.
        if *seq != self.seq || jpeg.len() < self.passed {
            (self.seq, self.passed) = (*seq, 0);
        }
        let at = std::mem::replace(&mut self.passed, jpeg.len());
        (at < jpeg.len()).then(|| (at, jpeg.slice(at..)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_byte_is_passed_on_once_and_every_frame_from_its_start() {
        let mut ahead = Ahead::default();
        let mut rest = |seq, jpeg: &'static [u8]| {
            let jpeg = Bytes::from_static(jpeg);
            ahead.rest(&Coming { seq, jpeg })
        };
        let part = |at, bytes: &'static [u8]| Some((at, Bytes::from_static(bytes)));
        assert_eq!(rest(1, b"ab"), part(0, b"ab"));
        assert_eq!(rest(1, b"ab"), None);
        assert_eq!(rest(1, b"abcd"), part(2, b"cd"));
        assert_eq!(rest(2, b"abcdef"), part(0, b"abcdef"));
        // The connection was lost, and the frame with that number is another one.
        assert_eq!(rest(2, b"xy"), part(0, b"xy"));
    }
}
