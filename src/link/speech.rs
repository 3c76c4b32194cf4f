//! Queued samples for the speaker: in small messages, bounded, and written no faster than the
//! speed of speech. Data that the robot has acknowledged but not read yet delays the next stop, and
//! no counter of this computer's system shows it: only the pace limits it.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;
use tokio::time::Instant;

use crate::wire::Command;

/// Bytes of samples in one message: 32 ms.
const MESSAGE: usize = 1024;
/// Bytes of samples that may wait: four seconds.
const MAX_BYTES: usize = 128_000;
/// The time per byte sent: 32,000 bytes a second are the speed of speech (16 kHz, 16 bits, mono).
const PER_BYTE: Duration = Duration::from_nanos(31_250);
/// How far ahead of that pace data may be sent, so that a late packet makes no gap.
const LEAD: Duration = Duration::from_millis(200);

/// The queue of speech; see the module.
#[derive(Debug, Default)]
pub(super) struct Speech {
    waiting: VecDeque<Bytes>,
    bytes: usize,
    due: Option<Instant>,
}

impl Speech {
    /// Queues samples; none of them if they do not fit.
    pub(super) fn push(&mut self, samples: &Bytes) -> bool {
        if self.bytes + samples.len() > MAX_BYTES {
            return false;
        }
        self.bytes += samples.len();
        let messages = samples
            .chunks(MESSAGE)
            .map(|chunk| samples.slice_ref(chunk));
        self.waiting.extend(messages);
        true
    }

    /// Drops all queued samples.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.bytes = 0;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// When the first message may be written, `None` if none is queued. A time in the past means
    /// now.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        self.waiting.front().map(|_| self.due.unwrap_or(now))
    }

    /// The first message.
    pub(super) fn first(&self) -> Option<Bytes> {
        let samples = self.waiting.front()?.clone();
        Some(Command::Audio(samples).to_bytes())
    }

    /// Removes the first message, which is being written.
    pub(super) fn advance(&mut self) {
        if let Some(samples) = self.waiting.pop_front() {
            self.bytes -= samples.len();
        }
    }

    /// Notes that `count` bytes of any kind were written.
    pub(super) fn charge(&mut self, count: usize, now: Instant) {
        let earliest = now.checked_sub(LEAD).unwrap_or(now);
        let spent = PER_BYTE.saturating_mul(u32::try_from(count).unwrap_or(u32::MAX));
        self.due = Some(self.due.unwrap_or(earliest).max(earliest) + spent);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn written_samples_make_room_for_as_many() {
        let mut speech = Speech::default();
        assert!(speech.push(&Bytes::from(vec![0; MAX_BYTES])));
        assert!(!speech.push(&Bytes::from(vec![0; 1])));
        speech.advance();
        assert!(!speech.push(&Bytes::from(vec![0; MESSAGE + 1])));
        assert!(speech.push(&Bytes::from(vec![0; MESSAGE])));
    }
}
