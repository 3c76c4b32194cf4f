//! What the robot has heard: a bounded journal of commands, so that tests wait for facts instead
//! of sleeping.

use std::collections::VecDeque;
use std::time::Duration;

use crate::wire::Command;

/// Entries kept; older ones are forgotten.
const MAX_ENTRIES: usize = 16_384;
/// Payload bytes kept; older entries are forgotten.
const MAX_BYTES: usize = 4 * 1024 * 1024;

/// One command that reached the robot.
#[derive(Debug, Clone, PartialEq)]
pub struct Heard {
    /// Counts all commands since the start, from 0.
    pub index: usize,
    /// Since the start of the server.
    pub at: Duration,
    /// Counts all reads of all connections: commands that came in one write of the client share
    /// it, as long as the network did not cut that write in two.
    pub write: u64,
    /// Counts the connections, from 0.
    pub client: u64,
    /// What was said.
    pub command: Command,
}

/// The newest commands.
#[derive(Debug, Default)]
pub(crate) struct Journal {
    entries: VecDeque<Heard>,
    next: usize,
    bytes: usize,
}

impl Journal {
    /// Writes a command down; its index is given here.
    pub(crate) fn write(&mut self, at: Duration, write: u64, client: u64, command: Command) {
        self.bytes += weight(&command);
        self.entries.push_back(Heard {
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

    /// The entries from an index on, as far as they are kept.
    pub(crate) fn since(&self, index: usize) -> impl Iterator<Item = &Heard> {
        let forgotten = self.next - self.entries.len();
        self.entries.iter().skip(index.saturating_sub(forgotten))
    }

    /// How many commands there were, forgotten ones included.
    pub(crate) fn count(&self) -> usize {
        self.next
    }
}

/// Bytes that a command keeps alive.
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
    fn the_journal_forgets_the_oldest_and_keeps_counting() {
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
    fn long_payloads_do_not_pile_up() {
        let mut journal = Journal::default();
        for _ in 0..1000 {
            let payload = Bytes::from(vec![0; 60_000]);
            journal.write(Duration::ZERO, 0, 0, Command::Audio(payload));
        }
        assert!(journal.bytes <= MAX_BYTES && journal.since(0).count() > 10);
    }
}
