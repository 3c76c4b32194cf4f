//! A bounded journal of the commands that the robot has received, which lets tests wait for events
//! instead of sleeping.

use std::collections::VecDeque;
use std::time::Duration;

use crate::wire::Command;

/// Maximum number of entries; older ones are dropped.
const MAX_ENTRIES: usize = 16_384;
/// Maximum total of payload bytes; older entries are dropped.
const MAX_BYTES: usize = 4 * 1024 * 1024;

/// One command that reached the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct ReceivedCommand {
    /// Index of the command since the start, from 0.
    pub index: usize,
    /// Time since the start of the server.
    pub at: Duration,
    /// Index of the read, counted over all connections. Commands of one client write share it,
    /// unless the network split that write.
    pub write: u64,
    /// Index of the connection, from 0.
    pub client: u64,
    /// The command.
    pub command: Command,
}

/// The most recent commands.
#[derive(Debug, Default)]
pub(crate) struct Journal {
    entries: VecDeque<ReceivedCommand>,
    next: usize,
    bytes: usize,
}

impl Journal {
    /// Adds a command and assigns its index.
    pub(crate) fn write(&mut self, at: Duration, write: u64, client: u64, command: Command) {
        self.bytes += weight(&command);
        self.entries.push_back(ReceivedCommand {
            index: self.next,
            at,
            write,
            client,
            command,
        });
        self.next += 1;
        while self.entries.len() > MAX_ENTRIES || self.bytes > MAX_BYTES {
            let Some(oldest) = self.entries.pop_front() else {
                break;
            };
            self.bytes -= weight(&oldest.command);
        }
    }

    /// Returns the entries from an index on, as far as they have been kept.
    pub(crate) fn since(&self, index: usize) -> impl Iterator<Item = &ReceivedCommand> {
        let forgotten = self.next - self.entries.len();
        self.entries.iter().skip(index.saturating_sub(forgotten))
    }

    /// Returns the number of commands, including dropped ones.
    pub(crate) fn count(&self) -> usize {
        self.next
    }
}

/// Returns the number of payload bytes that a command keeps in memory.
fn weight(command: &Command) -> usize {
    match command {
        Command::Audio(payload)
        | Command::Mute(payload)
        | Command::ConfigSet(payload)
        | Command::MotorSpeed(payload) => payload.len(),
        Command::File(chunk) => chunk.content().len(),
        Command::Unknown(packet) => packet.payload.len(),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;

    #[test]
    fn the_journal_drops_the_oldest_entries_and_keeps_counting() {
        let mut journal = Journal::default();
        for _ in 0..MAX_ENTRIES + 10 {
            journal.write(Duration::ZERO, 0, 0, Command::None);
        }
        assert_eq!(journal.count(), MAX_ENTRIES + 10);
        assert_eq!(journal.since(0).next().unwrap().index, 10);
        assert_eq!(journal.since(MAX_ENTRIES).count(), 10);
        assert_eq!(journal.since(usize::MAX).count(), 0);
    }

    #[test]
    fn long_payloads_do_not_accumulate() {
        let mut journal = Journal::default();
        for _ in 0..1000 {
            let payload = Bytes::from(vec![0; 60_000]);
            journal.write(Duration::ZERO, 0, 0, Command::Audio(payload));
        }
        assert!(journal.bytes <= MAX_BYTES && journal.since(0).count() > 10);
    }
}
