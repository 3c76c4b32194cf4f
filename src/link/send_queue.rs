//! What is on its way out. Pure bookkeeping: knows where one message ends and the next begins, so
//! that a write cut anywhere can be finished without putting the robot out of step.
//!
//! Two lanes. *Commands* go first, all that wait in one write. *Speech* goes one small message at a
//! time, when no command waits, at the speed at which it is spoken and while the system holds little
//! of it: in front of a command stands one such message at most, and only if a part of it is out.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::time::Instant;

use super::speech::Speech;
use crate::wire::Command;

/// Bytes of commands that may wait. Only a link that takes nothing gets here.
const MAX_WAITING: usize = 64 * 1024;
/// Speech waits while so many bytes are not acknowledged.
const MAX_UNACKNOWLEDGED: usize = 4 * 1024;
/// How soon to ask again whether they are.
const LOOK_AGAIN: Duration = Duration::from_millis(10);

/// What a newer MOVE does to a message that waits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sort {
    /// A MOVE: the newest one counts.
    Move,
    /// ENGINE: MOVEs before it stay before it.
    Engine,
    Other,
}

impl Sort {
    fn of(command: &Command) -> Sort {
        match command {
            Command::Move { .. } => Sort::Move,
            Command::Engine(_) => Sort::Engine,
            _ => Sort::Other,
        }
    }
}

#[derive(Debug)]
struct Message {
    bytes: Bytes,
    sort: Sort,
    since: Instant,
}

impl Message {
    /// Whether it is still to be written when all ends with these commands: only if there are none,
    /// and if it stops the robot or sends it on its own way.
    fn outlasts(&self, last: &[Command]) -> bool {
        let told = self.sort == Sort::Engine || self.bytes == Command::STOP.to_bytes();
        last.is_empty() && told
    }
}

/// Messages that are not wholly written yet.
#[derive(Debug, Default)]
pub(super) struct SendQueue {
    /// What is left of a message of which a part is out.
    half_out: Bytes,
    commands: VecDeque<Message>,
    /// Bytes of `commands`.
    waiting: usize,
    speech: Speech,
    /// Since when nothing was taken of what is offered.
    stalled: Option<Instant>,
}

impl SendQueue {
    /// Appends commands that belong together; AUDIO goes to the other lane. MOVEs of earlier calls
    /// are forgotten if one of these takes their place. `false`, and nothing done, when too much
    /// waits already.
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
        let (bytes, sort) = (command.to_bytes(), Sort::of(command));
        self.waiting += bytes.len();
        self.commands.push_back(Message { bytes, sort, since });
    }

    /// Forgets the MOVEs in whose place these commands come; since when the oldest of them waited.
    fn supersede(&mut self, commands: &[Command]) -> Option<Instant> {
        let mut sorts = commands.iter().map(Sort::of);
        if sorts.find(|sort| *sort != Sort::Other) != Some(Sort::Move) {
            return None;
        }
        let fixed = |message: &Message| message.sort == Sort::Engine;
        let from = self.commands.iter().rposition(fixed).unwrap_or(0);
        let mut since = None;
        let tail = self.commands.split_off(from);
        for message in tail {
            if message.sort == Sort::Move {
                self.waiting -= message.bytes.len();
                since = since.or(Some(message.since));
            } else {
                self.commands.push_back(message);
            }
        }
        since
    }

    /// Takes samples for the loudspeaker, or none of them if too much speech waits.
    pub(super) fn say(&mut self, samples: &Bytes) -> bool {
        self.speech.push(samples)
    }

    /// Forgets the speech of which no byte is out yet.
    pub(super) fn drop_audio(&mut self) {
        self.speech.clear();
    }

    /// Forgets the messages of which no byte is out yet, and appends these. If there are none to
    /// append, the robot shall go on with what it was told last: then stops and ENGINE stay.
    pub(super) fn replace_unstarted(&mut self, commands: &[Command], now: Instant) {
        self.drop_audio();
        self.commands.retain(|message| message.outlasts(commands));
        self.waiting = self.commands.iter().map(|one| one.bytes.len()).sum();
        self.push(commands, now);
    }

    /// What would be written after [`SendQueue::replace_unstarted`], in two parts: what is left of a
    /// message of which a part is out, and whole messages.
    pub(super) fn after_replacing(&self, commands: &[Command]) -> (&[u8], Vec<u8>) {
        let kept = self.commands.iter();
        let kept = kept.filter(|message| message.outlasts(commands));
        let kept = kept.flat_map(|message| message.bytes.iter().copied());
        let new = commands.iter().flat_map(Command::to_bytes);
        (&self.half_out, kept.chain(new).collect())
    }

    /// What is to be written now, nothing if there is nothing to do: whole messages, but for the rest
    /// of one that is partly out. `unacknowledged` is what the system holds, if it tells; it is asked
    /// only before speech.
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
        let first = self.speech.first().filter(|_| !held);
        first.unwrap_or_default()
    }

    fn urgent(&self) -> usize {
        self.half_out.len() + self.waiting
    }

    fn gather(&self) -> Bytes {
        let mut bytes = BytesMut::with_capacity(self.urgent());
        bytes.extend_from_slice(&self.half_out);
        for message in &self.commands {
            bytes.extend_from_slice(&message.bytes);
        }
        bytes.freeze()
    }

    /// So many bytes of the last [`SendQueue::offer`] are out; nothing was done in between.
    pub(super) fn advance(&mut self, count: usize, now: Instant) {
        if count == 0 {
            return;
        }
        self.stalled = None;
        self.speech.charge(count, now);
        if self.urgent() == 0 {
            self.half_out = self.speech.first().unwrap_or_default();
            self.speech.advance();
        }
        let finished = count.min(self.half_out.len());
        drop(self.half_out.split_to(finished));
        let mut left = count - finished;
        while left > 0
            && let Some(mut message) = self.commands.pop_front()
        {
            self.waiting -= message.bytes.len();
            let out = left.min(message.bytes.len());
            drop(message.bytes.split_to(out));
            left -= out;
            self.half_out = message.bytes;
        }
    }

    /// Nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.urgent() == 0 && self.speech.is_empty()
    }

    /// No command waits, and no message is partly out.
    pub(super) fn is_calm(&self) -> bool {
        self.urgent() == 0
    }

    /// Since when a command has waited, or all has.
    pub(super) fn waits_since(&self) -> Option<Instant> {
        let oldest = self.commands.front().map(|message| message.since);
        oldest.into_iter().chain(self.stalled).min()
    }

    /// When [`SendQueue::offer`] has something to say that it had not at `now`, with nothing pushed.
    pub(super) fn next_offer(&self, now: Instant) -> Option<Instant> {
        let due = self.speech.due(now)?;
        Some(if due > now { due } else { now + LOOK_AGAIN })
    }
}

#[cfg(test)]
mod tests;
