//! Tracks which part of an incoming frame a host has already received.

use bytes::Bytes;

use crate::robot::PartialFrame;

/// The part of the incoming frame that was already passed to a host.
#[derive(Debug, Default)]
pub(super) struct FrameProgress {
    seq: u64,
    passed: usize,
}

impl FrameProgress {
    /// Returns the bytes received since the last call and their offset in the frame; `None` if
    /// there are none.
    pub(super) fn rest(
        &mut self,
        PartialFrame { seq, jpeg }: &PartialFrame,
    ) -> Option<(usize, Bytes)> {
        // Fewer bytes than before: the number belongs to a frame of a new connection.
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
    fn each_byte_is_passed_once_and_each_frame_from_its_start() {
        let mut progress = FrameProgress::default();
        let mut rest = |seq, jpeg: &'static [u8]| {
            let jpeg = Bytes::from_static(jpeg);
            progress.rest(&PartialFrame { seq, jpeg })
        };
        let part = |at, bytes: &'static [u8]| Some((at, Bytes::from_static(bytes)));
        assert_eq!(rest(1, b"ab"), part(0, b"ab"));
        assert_eq!(rest(1, b"ab"), None);
        assert_eq!(rest(1, b"abcd"), part(2, b"cd"));
        assert_eq!(rest(2, b"abcdef"), part(0, b"abcdef"));
        // After a lost connection the same number belongs to a different frame.
        assert_eq!(rest(2, b"xy"), part(0, b"xy"));
    }
}
