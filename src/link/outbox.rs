//! What is on its way out. Pure bookkeeping: knows where one message ends and the next begins, so
//! that a write cut anywhere can be finished without putting the robot out of step.

use bytes::BytesMut;

use crate::wire::{Command, HEADER_LEN, MAX_PACKET_LEN};

/// The most that may wait. Only a link that takes nothing gets here.
const MAX_WAITING: usize = 4 * MAX_PACKET_LEN;

/// Messages that are not wholly written yet. Begins at a message's first byte, also when a part of
/// that message is already out.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    bytes: BytesMut,
    written: usize,
}

impl Outbox {
    /// Appends messages; `false`, and nothing done, when too much waits already.
    pub(super) fn push(&mut self, commands: &[Command]) -> bool {
        if self.bytes.len() > MAX_WAITING {
            return false;
        }
        commands
            .iter()
            .for_each(|command| command.emit(&mut self.bytes));
        true
    }

    /// Forgets the messages of which no byte is out yet, and appends one.
    pub(super) fn replace_unstarted(&mut self, command: &Command) {
        self.bytes.truncate(self.end_of_started());
        command.emit(&mut self.bytes);
    }

    /// What is to be written next.
    pub(super) fn rest(&self) -> &[u8] {
        &self.bytes[self.written..]
    }

    /// So many bytes of [`Outbox::rest`] are out.
    pub(super) fn advance(&mut self, count: usize) {
        self.written = (self.written + count).min(self.bytes.len());
        if self.written == self.bytes.len() {
            *self = Outbox::default();
        }
    }

    /// Where the message ends that is partly out; 0 if none is.
    fn end_of_started(&self) -> usize {
        let mut end = 0;
        while end < self.written {
            let length = &self.bytes[end + HEADER_LEN - 2..end + HEADER_LEN];
            end += HEADER_LEN + usize::from(u16::from_be_bytes([length[0], length[1]]));
        }
        end
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const GO: Command = Command::Move {
        left: 50,
        right: 50,
    };
    const GO_BYTES: [u8; 7] = [0x50, 0x4B, 0x05, 0x00, 0x02, 0x32, 0x32];
    const STOP_BYTES: [u8; 7] = [0x50, 0x4B, 0x05, 0x00, 0x02, 0x00, 0x00];

    proptest! {
        #[test]
        fn a_message_cut_anywhere_is_finished_and_later_motion_forgotten(cut in 0usize..21) {
            let mut outbox = Outbox::default();
            prop_assert!(outbox.push(&[GO, GO, GO]));
            outbox.advance(cut);
            outbox.replace_unstarted(&Command::STOP);
            let whole = [&GO_BYTES.repeat(3)[..cut], outbox.rest()].concat();
            let (messages, last) = whole.split_at(whole.len() - 7);
            prop_assert_eq!(messages, GO_BYTES.repeat(cut.div_ceil(7)));
            prop_assert_eq!(last, STOP_BYTES);
        }
    }

    #[test]
    fn what_is_wholly_out_is_forgotten() {
        let mut outbox = Outbox::default();
        outbox.push(&[GO]);
        outbox.advance(7);
        assert!(outbox.rest().is_empty());
        outbox.replace_unstarted(&Command::STOP);
        assert_eq!(outbox.rest(), STOP_BYTES);
    }

    #[test]
    fn what_waits_is_bounded() {
        let mut outbox = Outbox::default();
        let pushes = (0..1_000_000).take_while(|_| outbox.push(&[GO])).count();
        assert!(pushes < 1_000_000);
        assert!(outbox.rest().len() <= MAX_WAITING + GO_BYTES.len());
    }
}
