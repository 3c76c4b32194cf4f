//! The data to be written. Pure bookkeeping: knows the message boundaries, so that a partial write
//! can be completed without breaking the framing.
//!
//! Two lanes. *Commands* go first, all queued ones in one write. *Speech* goes one small message at
//! a time, when no command is queued, at the speed of speech and while the system's send buffer
//! holds little of it: at most one such message delays a command, and only if it is partly written.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::time::Instant;

use super::speech::Speech;
use crate::wire::Command;

/// The most bytes of queued commands. Only a link that accepts no data reaches this.
const MAX_WAITING: usize = 64 * 1024;
/// Speech is held back while more than this many bytes are not acknowledged.
const MAX_UNACKNOWLEDGED: usize = 4 * 1024;
/// How soon to check the unacknowledged bytes again.
const RECHECK: Duration = Duration::from_millis(10);

/// How a queued message is treated when a newer MOVE arrives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CommandKind {
    /// A MOVE: replaced by the newer one.
    Move,
    /// ENGINE: the MOVEs before it are kept, and stay before it.
    Engine,
    Other,
}

impl CommandKind {
    fn from_command(command: &Command) -> CommandKind {
        match command {
            Command::Move { .. } => CommandKind::Move,
            Command::Engine(_) => CommandKind::Engine,
            _ => CommandKind::Other,
        }
    }
}

#[derive(Debug)]
struct Message {
    bytes: Bytes,
    kind: CommandKind,
    since: Instant,
}

impl Message {
    /// Whether it is still to be written when the link ends with these commands: only if there are
    /// none, and if it is an ENGINE or a stop.
    fn is_kept_at_end(&self, last: &[Command]) -> bool {
        let lasting = self.kind == CommandKind::Engine || self.bytes == Command::STOP.to_bytes();
        last.is_empty() && lasting
    }
}

/// Messages that are not completely written.
#[derive(Debug, Default)]
pub(super) struct SendQueue {
    /// The rest of a message that is partly written.
    partly_written: Bytes,
    commands: VecDeque<Message>,
    /// The number of bytes in `commands`.
    waiting: usize,
    speech: Speech,
    /// Since when none of the offered bytes were accepted.
    stalled: Option<Instant>,
}

impl SendQueue {
    /// Appends commands that belong together; AUDIO goes to the speech lane. Queued MOVEs of
    /// earlier calls are dropped if one of these replaces them. Returns `false`, and does nothing,
    /// if too much is queued already.
    pub(super) fn push(&mut self, commands: &[Command], now: Instant) -> bool {
        if self.waiting > MAX_WAITING {
            return false;
        }
        let since = self.supersede(commands).unwrap_or(now);
        for command in commands {
            match command {
                Command::Audio(samples) => {
                    self.say(samples);
                }
                _ => self.append(command, since),
            }
        }
        true
    }

    fn append(&mut self, command: &Command, since: Instant) {
        let bytes = command.to_bytes();
        let kind = CommandKind::from_command(command);
        self.waiting += bytes.len();
        self.commands.push_back(Message { bytes, kind, since });
    }

    /// Drops the queued MOVEs that these commands replace; returns since when the oldest of them
    /// was queued.
    fn supersede(&mut self, commands: &[Command]) -> Option<Instant> {
        let mut kinds = commands.iter().map(CommandKind::from_command);
        if kinds.find(|kind| *kind != CommandKind::Other) != Some(CommandKind::Move) {
            return None;
        }
        let fixed = |message: &Message| message.kind == CommandKind::Engine;
        let from = self.commands.iter().rposition(fixed).unwrap_or(0);
        let mut since = None;
        let tail = self.commands.split_off(from);
        for message in tail {
            if message.kind == CommandKind::Move {
                self.waiting -= message.bytes.len();
                since = since.or(Some(message.since));
            } else {
                self.commands.push_back(message);
            }
        }
        since
    }

    /// Queues samples for the speaker; none of them if too much speech is queued.
    pub(super) fn say(&mut self, samples: &Bytes) -> bool {
        self.speech.push(samples)
    }

    /// Drops the speech of which no byte is written.
    pub(super) fn drop_audio(&mut self) {
        self.speech.clear();
    }

    /// Drops the messages of which no byte is written, and appends these commands. Without commands
    /// to append, the robot is to continue what it was last told: then queued stops and ENGINEs are
    /// kept.
    pub(super) fn replace_unstarted(&mut self, commands: &[Command], now: Instant) {
        self.drop_audio();
        self.commands
            .retain(|message| message.is_kept_at_end(commands));
        self.waiting = self.commands.iter().map(|one| one.bytes.len()).sum();
        self.push(commands, now);
    }

    /// The data that would be written after [`SendQueue::replace_unstarted`], in two parts: the
    /// rest of a partly written message, and whole messages.
    pub(super) fn after_replacing(&self, commands: &[Command]) -> (&[u8], Vec<u8>) {
        let kept = self.commands.iter();
        let kept = kept.filter(|message| message.is_kept_at_end(commands));
        let kept = kept.flat_map(|message| message.bytes.iter().copied());
        let new = commands.iter().flat_map(Command::to_bytes);
        (&self.partly_written, kept.chain(new).collect())
    }

    /// The bytes to write now, empty if there are none: whole messages, except for the rest of a
    /// partly written one. `unacknowledged` is the amount of data in the system's send buffer, if
    /// known; it is called only before speech.
    pub(super) fn offer(
        &mut self,
        now: Instant,
        unacknowledged: impl FnOnce() -> Option<usize>,
    ) -> Bytes {
        let due = self.speech.due(now).is_some_and(|due| due <= now);
        let speaks = self.urgent() == 0 && due;
        if self.urgent() == 0 && !speaks {
            self.stalled = None;
            return Bytes::new();
        }
        self.stalled = self.stalled.or(Some(now));
        if !speaks {
            return self.gather();
        }
        let held = unacknowledged().is_some_and(|bytes| bytes > MAX_UNACKNOWLEDGED);
        if held {
            return Bytes::new();
        }
        self.speech.first().unwrap_or_default()
    }

    fn urgent(&self) -> usize {
        self.partly_written.len() + self.waiting
    }

    fn gather(&self) -> Bytes {
        let mut bytes = BytesMut::with_capacity(self.urgent());
        bytes.extend_from_slice(&self.partly_written);
        for message in &self.commands {
            bytes.extend_from_slice(&message.bytes);
        }
        bytes.freeze()
    }

    /// Notes that `count` bytes of the last [`SendQueue::offer`] were written; nothing may be done
    /// in between.
    pub(super) fn advance(&mut self, count: usize, now: Instant) {
        if count == 0 {
            return;
        }
        self.stalled = None;
        self.speech.charge(count, now);
        if self.urgent() == 0 {
            self.partly_written = self.speech.first().unwrap_or_default();
            self.speech.advance();
        }
        let finished = count.min(self.partly_written.len());
        drop(self.partly_written.split_to(finished));
        let mut left = count - finished;
        while left > 0
            && let Some(mut message) = self.commands.pop_front()
        {
            self.waiting -= message.bytes.len();
            let out = left.min(message.bytes.len());
            drop(message.bytes.split_to(out));
            left -= out;
            self.partly_written = message.bytes;
        }
    }

    /// Whether nothing is queued.
    pub(super) fn is_empty(&self) -> bool {
        self.urgent() == 0 && self.speech.is_empty()
    }

    /// Whether no command is queued and no message partly written.
    pub(super) fn no_command_pending(&self) -> bool {
        self.urgent() == 0
    }

    /// Whether a message is partly written.
    pub(super) fn is_message_cut(&self) -> bool {
        !self.partly_written.is_empty()
    }

    /// Since when the oldest command has been queued, or no bytes were accepted, whichever is
    /// earlier.
    pub(super) fn waits_since(&self) -> Option<Instant> {
        let oldest = self.commands.front().map(|message| message.since);
        oldest.into_iter().chain(self.stalled).min()
    }

    /// When [`SendQueue::offer`] can return more than at `now`, if nothing is pushed.
    pub(super) fn next_offer(&self, now: Instant) -> Option<Instant> {
        let due = self.speech.due(now)?;
        Some(if due > now { due } else { now + RECHECK })
    }
}

#[cfg(test)]
mod tests;
