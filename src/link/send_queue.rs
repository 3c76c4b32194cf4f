//! The data to be written. Pure bookkeeping: knows the message boundaries, so that a partial write
//! can be completed without breaking the framing.
//!
//! Three lanes. *Urgent* commands, such as stops and ENGINE, go first, all queued ones in one write.
//! Others, *paced* ones, wait until the robot's program has room for them (see [`Pace`]), and newer
//! ones replace those of their kind. *Speech* goes one small message at a time, when no command is
//! queued, at the speed of speech and while the system's send buffer holds little of it: at most one
//! such message delays a command, and only if it is partly written.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use tokio::time::Instant;

use super::pace::Pace;
use crate::wire::Command;

/// The most bytes of queued commands. Only a link that accepts no data reaches this.
const MAX_WAITING: usize = 64 * 1024;
/// Speech is held back while more than this many bytes are not acknowledged.
const MAX_UNACKNOWLEDGED: usize = 4 * 1024;
/// How soon to check the unacknowledged bytes again.
const RECHECK: Duration = Duration::from_millis(10);

/// How a queued message is treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum CommandKind {
    /// A MOVE that stops the tracks.
    Stop,
    Engine,
    /// A question that the robot's program answers.
    Question,
    /// A question that shows whether what arrives answers the others.
    Control,
    /// Everything else that does not wait.
    Other,
    /// A MOVE that is no stop: waits, and a newer MOVE replaces it.
    Move,
    /// A light, the volume, a sound or a stream, by its type and number: waits, and a newer one for
    /// the same replaces it.
    Output(u8, u8),
}

impl CommandKind {
    fn from_command(command: &Command) -> CommandKind {
        match command {
            Command::Move { left: 0, right: 0 } => CommandKind::Stop,
            Command::Move { .. } => CommandKind::Move,
            Command::Engine(_) => CommandKind::Engine,
            Command::PowerQuery | Command::ConfigQuery => CommandKind::Question,
            Command::Led { led, .. } => CommandKind::Output(0, led.to_byte()),
            Command::Volume(_) => CommandKind::Output(1, 0),
            Command::Play(_) | Command::StopSound => CommandKind::Output(2, 0),
            Command::Stream { stream, .. } => CommandKind::Output(3, stream.to_byte()),
            _ => CommandKind::Other,
        }
    }

    fn is_paced(self) -> bool {
        matches!(self, CommandKind::Move | CommandKind::Output(..))
    }
}

#[derive(Debug)]
struct Message {
    bytes: Bytes,
    kind: CommandKind,
    since: Instant,
}

impl Message {
    fn new(command: &Command, since: Instant) -> Message {
        Message {
            bytes: command.to_bytes(),
            kind: CommandKind::from_command(command),
            since,
        }
    }

    /// Whether it is still to be written when the link ends with these commands: only if there are
    /// none, and if it is an ENGINE or a stop.
    fn is_kept_at_end(&self, last: &[Command]) -> bool {
        last.is_empty() && matches!(self.kind, CommandKind::Engine | CommandKind::Stop)
    }
}

/// Messages that are not completely written.
#[derive(Debug, Default)]
pub(super) struct SendQueue {
    /// The rest of a message that is partly written.
    partly_written: Bytes,
    urgent: VecDeque<Message>,
    waiting: usize,
    paced: VecDeque<Message>,
    speech: Speech,
    /// Since when none of the offered bytes were accepted.
    stalled: Option<Instant>,
    pace: Pace,
    /// The number of bytes written.
    written: u64,
    last_move: Bytes,
    /// When the robot begins to execute it.
    move_begins: Option<Instant>,
    /// A setpoint that moves the robot was written.
    drove: bool,
}

impl SendQueue {
    /// The number of bytes written.
    pub(super) fn written(&self) -> u64 {
        self.written
    }

    /// What is known of the robot's speed.
    pub(super) fn pace(&mut self) -> &mut Pace {
        &mut self.pace
    }

    /// Appends commands; AUDIO goes to the speech lane. Returns `false`, and does nothing, if too
    /// much is queued already.
    pub(super) fn push(&mut self, commands: &[Command], now: Instant) -> bool {
        if self.waiting > MAX_WAITING {
            return false;
        }
        for command in commands {
            match command {
                Command::Audio(samples) => {
                    self.say(samples);
                }
                _ => self.append(Message::new(command, now)),
            }
        }
        true
    }

    fn append(&mut self, message: Message) {
        match message.kind {
            // In place: what is replaced often must not wait longer than the rest.
            kind if kind.is_paced() => {
                match self.paced.iter_mut().find(|waiting| waiting.kind == kind) {
                    Some(waiting) => *waiting = message,
                    None => self.paced.push_back(message),
                }
            }
            CommandKind::Stop => {
                self.take_paced(CommandKind::Move);
                let repeated = self
                    .urgent
                    .back()
                    .is_some_and(|last| last.kind == message.kind);
                if !repeated {
                    self.push_urgent(message);
                }
            }
            CommandKind::Engine => {
                // What a MOVE and an ENGINE do to the robot depends on their order.
                if let Some(earlier) = self.take_paced(CommandKind::Move) {
                    self.push_urgent(earlier);
                }
                self.push_urgent(message);
            }
            _ => self.push_urgent(message),
        }
    }

    fn push_urgent(&mut self, message: Message) {
        self.waiting += message.bytes.len();
        self.urgent.push_back(message);
    }

    fn take_paced(&mut self, kind: CommandKind) -> Option<Message> {
        let at = self.paced.iter().position(|message| message.kind == kind)?;
        self.paced.remove(at)
    }

    /// Queues questions whose answers show that everything queued before is executed. Returns the
    /// number of the last one; `None` if the robot answers no question.
    pub(super) fn ask(&mut self, now: Instant) -> Option<u64> {
        // One POWER may come unasked between the question and its answer.
        let count = match self.pace.question() {
            _ if !self.pace.may_answer() => return None,
            Command::PowerQuery => 2,
            _ => 1,
        };
        for _ in 0..count {
            self.push_urgent(Message::new(&self.pace.question(), now));
        }
        let queued = self
            .urgent
            .iter()
            .filter(|one| one.kind == CommandKind::Question);
        Some(self.pace.next_question() + queued.count() as u64 - 1)
    }

    /// Lets everything go at once that waits for its pace: nothing follows.
    pub(super) fn release_paced(&mut self) {
        while let Some(message) = self.paced.pop_front() {
            self.push_urgent(message);
        }
    }

    /// Queues samples for the speaker; none of them if too much speech is queued.
    pub(super) fn say(&mut self, samples: &Bytes) -> bool {
        self.speech.push(samples)
    }

    pub(super) fn drop_audio(&mut self) {
        self.speech.clear();
    }

    /// Drops the messages of which no byte is written, and appends these commands. Without commands
    /// to append, the robot is to continue what it was last told: then queued stops and ENGINEs are
    /// kept.
    pub(super) fn replace_unstarted(&mut self, commands: &[Command], now: Instant) {
        self.drop_audio();
        self.paced.clear();
        self.urgent
            .retain(|message| message.is_kept_at_end(commands));
        self.waiting = self.urgent.iter().map(|one| one.bytes.len()).sum();
        self.push(commands, now);
    }

    /// The data that would be written after [`SendQueue::replace_unstarted`], in two parts: the
    /// rest of a partly written message, and whole messages.
    pub(super) fn after_replacing(&self, commands: &[Command]) -> (&[u8], Vec<u8>) {
        let kept = self.urgent.iter();
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
        self.pace.poll(now);
        self.ask_while_moving(now);
        let paced = self.admitted(now);
        let commands = self.gather(paced);
        if !commands.is_empty() {
            self.stalled = self.stalled.or(Some(now));
            return commands;
        }
        let due = self.speech.due(now).is_some_and(|due| due <= now);
        if !due || !self.pace.admits(now) {
            self.stalled = None;
            return Bytes::new();
        }
        self.stalled = self.stalled.or(Some(now));
        let held = unacknowledged().is_some_and(|bytes| bytes > MAX_UNACKNOWLEDGED);
        if held {
            return Bytes::new();
        }
        self.speech.first().unwrap_or_default()
    }

    /// How many paced messages may be written now. The first setpoint since the login waits for
    /// nothing: as far as anyone knows, the robot's queue is empty.
    fn admitted(&self, now: Instant) -> usize {
        let moves = |message: &Message| message.kind == CommandKind::Move;
        let first = match self.paced.iter().position(moves) {
            Some(place) if !self.drove => place + 1,
            _ => 0,
        };
        let others = self.pace.admitted(self.urgent.len(), self.paced.len(), now);
        first.max(others)
    }

    /// A question that is due takes the place of a waiting MOVE, or goes before it.
    fn ask_while_moving(&mut self, now: Instant) {
        let waits = |kind| move |message: &Message| message.kind == kind;
        let moves = self.paced.iter().any(waits(CommandKind::Move));
        let asks = self.urgent.iter().any(waits(CommandKind::Question));
        if moves && !asks && self.pace.is_question_due(now) {
            let overdue = self.pace.next_admission(now).is_none();
            if overdue || self.pace.admits(now) {
                if self.pace.is_control_due(now) {
                    self.push_urgent(Message {
                        kind: CommandKind::Control,
                        ..Message::new(&Command::ConfigQuery, now)
                    });
                }
                for _ in 0..self.pace.questions(now) {
                    self.push_urgent(Message::new(&self.pace.question(), now));
                }
            }
        }
    }

    fn gather(&self, paced: usize) -> Bytes {
        let mut bytes = BytesMut::with_capacity(self.urgent());
        bytes.extend_from_slice(&self.partly_written);
        for message in self.urgent.iter().chain(self.paced.iter().take(paced)) {
            bytes.extend_from_slice(&message.bytes);
        }
        bytes.freeze()
    }

    fn urgent(&self) -> usize {
        self.partly_written.len() + self.waiting
    }

    /// `count` bytes of the last [`SendQueue::offer`] were written; nothing may be done between.
    pub(super) fn advance(&mut self, count: usize, now: Instant) {
        if count == 0 {
            return;
        }
        self.stalled = None;
        self.written += count as u64;
        self.speech.charge(count, now);
        if self.urgent() == 0 && self.admitted(now) == 0 {
            self.partly_written = self.speech.first().unwrap_or_default();
            self.speech.advance();
            self.pace.wrote(None, now);
        }
        let finished = count.min(self.partly_written.len());
        drop(self.partly_written.split_to(finished));
        let mut left = count - finished;
        while left > 0
            && let Some(mut message) = self.pop_command()
        {
            if matches!(message.kind, CommandKind::Move | CommandKind::Stop)
                && message.bytes != self.last_move
            {
                self.last_move = message.bytes.clone();
                self.move_begins = Some(self.pace.next_execution(now));
            }
            let ends = self.written - left as u64 + message.bytes.len() as u64;
            let asks = message.kind == CommandKind::Question;
            self.pace.wrote(asks.then_some(ends), now);
            if message.kind == CommandKind::Control {
                self.pace.wrote_control();
            }
            self.drove |= message.kind == CommandKind::Move;
            let out = left.min(message.bytes.len());
            drop(message.bytes.split_to(out));
            left -= out;
            self.partly_written = message.bytes;
        }
    }

    fn pop_command(&mut self) -> Option<Message> {
        match self.urgent.pop_front() {
            Some(message) => {
                self.waiting -= message.bytes.len();
                Some(message)
            }
            None => self.paced.pop_front(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.urgent() == 0 && self.paced.is_empty() && self.speech.is_empty()
    }

    /// Whether a new setpoint waits here or in the robot's queue.
    pub(super) fn is_new_setpoint_waiting(&self, now: Instant) -> bool {
        let is_new = |message: &Message| {
            message.kind == CommandKind::Move && message.bytes != self.last_move
        };
        self.paced.iter().any(is_new) || self.move_begins(now).is_some()
    }

    /// When the robot begins to execute the last setpoint, unless it has begun.
    pub(super) fn move_begins(&self, now: Instant) -> Option<Instant> {
        self.move_begins.filter(|begins| *begins > now)
    }

    /// Whether no command is queued that goes at once, and no message partly written.
    pub(super) fn no_urgent_pending(&self) -> bool {
        self.urgent() == 0
    }

    pub(super) fn is_message_cut(&self) -> bool {
        !self.partly_written.is_empty()
    }

    /// Since when the oldest urgent command is queued or no byte was accepted, whichever is earlier.
    pub(super) fn waits_since(&self) -> Option<Instant> {
        let oldest = self.urgent.front().map(|message| message.since);
        oldest.into_iter().chain(self.stalled).min()
    }

    /// When [`SendQueue::offer`] can return more than at `now`, if nothing is pushed.
    pub(super) fn next_offer(&self, now: Instant) -> Option<Instant> {
        let speech = self.speech.due(now);
        if self.paced.is_empty() && speech.is_none() {
            return None;
        }
        let pace = self.pace.next_admission(now).unwrap_or(now + RECHECK);
        let due = if self.paced.is_empty() {
            pace.max(speech?)
        } else {
            pace
        };
        Some(if due > now { due } else { now + RECHECK })
    }
}

/// Bytes of samples in one message: 32 ms.
const MESSAGE: usize = 1024;
/// Bytes of samples that may wait: four seconds.
const MAX_BYTES: usize = 128_000;
/// The time per byte sent: 32,000 bytes a second are the speed of speech (16 kHz, 16 bits, mono).
const PER_BYTE: Duration = Duration::from_nanos(31_250);
/// How far ahead of that pace data may be sent, so that a late packet makes no gap.
const LEAD: Duration = Duration::from_millis(200);

/// Queued samples for the speaker: in small messages, bounded, and written no faster than the speed
/// of speech. Data that the robot has acknowledged but not read yet delays the next stop, and no
/// counter of this computer's system shows it: only the pace limits it.
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

    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.bytes = 0;
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// When the first message may be written; a time in the past means now.
    pub(super) fn due(&self, now: Instant) -> Option<Instant> {
        self.waiting.front().map(|_| self.due.unwrap_or(now))
    }

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
    use proptest::prelude::*;

    use super::*;
    use crate::wire::{Decoder, Engage, Led};

    const GO: Command = Command::Move {
        left: 50,
        right: 50,
    };
    const GO_BYTES: [u8; 7] = [0x50, 0x4B, 0x05, 0x00, 0x02, 0x32, 0x32];
    const STOP_BYTES: [u8; 7] = [0x50, 0x4B, 0x05, 0x00, 0x02, 0x00, 0x00];
    const DOCK: Command = Command::Engine(Engage::Dock);
    const MS: Duration = Duration::from_millis(1);

    fn samples(length: usize) -> Bytes {
        Bytes::from(vec![7; length])
    }

    /// A queue with the test's own clock and transport.
    struct Rig {
        queue: SendQueue,
        now: Instant,
        out: Vec<u8>,
    }

    impl Rig {
        fn answer(&mut self) {
            let written = self.queue.written();
            self.queue.pace().answer(Duration::ZERO, written, self.now);
        }

        /// With a robot that is known to execute everything at once.
        fn new() -> Rig {
            let mut rig = Rig::with_unknown_robot();
            rig.queue.ask(rig.now);
            rig.drain();
            rig.out.clear();
            for _ in 0..2 {
                rig.answer();
            }
            rig
        }

        fn with_unknown_robot() -> Rig {
            Rig {
                queue: SendQueue::default(),
                now: Instant::now(),
                out: Vec::new(),
            }
        }

        fn push(&mut self, commands: &[Command]) -> bool {
            self.queue.push(commands, self.now)
        }

        /// Writes at most `room` bytes of the offer; returns how many.
        fn write(&mut self, room: usize) -> usize {
            let offer = self.queue.offer(self.now, || Some(0));
            let count = offer.len().min(room);
            self.out.extend_from_slice(&offer[..count]);
            self.queue.advance(count, self.now);
            count
        }

        /// Writes everything on offer without time passing.
        fn drain(&mut self) {
            while self.write(usize::MAX) > 0 {}
        }

        fn written(&self) -> Vec<Command> {
            let mut decoder = Decoder::new();
            let mut input = &self.out[..];
            let mut written = Vec::new();
            while let Some(packet) = decoder.decode(&mut input).unwrap() {
                written.push(Command::parse(packet));
            }
            assert_eq!(decoder.buffered(), 0, "a message is cut");
            written
        }
    }

    proptest! {
        #[test]
        fn a_partly_written_message_is_finished_and_later_motion_dropped(cut in 0usize..8) {
            let mut rig = Rig::new();
            prop_assert!(rig.push(&[GO, GO, GO]));
            rig.write(cut);
            rig.queue.replace_unstarted(&[Command::STOP], rig.now);
            rig.drain();
            let (messages, last) = rig.out.split_at(rig.out.len() - 7);
            prop_assert_eq!(messages, GO_BYTES.repeat(cut.div_ceil(7)));
            prop_assert_eq!(last, STOP_BYTES);
        }
    }

    #[test]
    fn the_queue_is_bounded() {
        let mut rig = Rig::new();
        let fits = [vec![DOCK; 10_921], vec![Command::ConfigQuery; 2]].concat();
        assert!(rig.push(&fits));
        assert_eq!(rig.queue.waiting, MAX_WAITING);
        assert!(rig.push(&[DOCK]), "until the bound is exceeded");
        assert!(!rig.push(&[DOCK]));
        assert!(!rig.queue.say(&samples(128_002)) && rig.queue.say(&samples(128_000)));
        assert!(!rig.queue.say(&samples(2)));
        rig.queue.drop_audio();
        assert!(rig.queue.say(&samples(128_000)));
    }

    #[test]
    fn the_data_for_another_process_begins_with_the_rest_of_a_partly_written_message() {
        let mut rig = Rig::new();
        rig.push(&[GO]);
        rig.write(3);
        rig.push(&[DOCK]);
        let (rest, whole) = rig.queue.after_replacing(&[Command::STOP]);
        assert_eq!((rest, &whole[..]), (&GO_BYTES[3..], &STOP_BYTES[..]));
        let (rest, whole) = rig.queue.after_replacing(&[]);
        assert_eq!((rest, &whole[..]), (&GO_BYTES[3..], &DOCK.to_bytes()[..]));
    }

    #[test]
    fn samples_among_commands_are_speech() {
        let mut rig = Rig::new();
        rig.push(&[Command::Audio(samples(100))]);
        assert!(rig.queue.no_urgent_pending() && !rig.queue.is_empty());
        rig.queue.drop_audio();
        assert!(rig.queue.is_empty());
        rig.push(&[DOCK]);
        assert!(!rig.queue.no_urgent_pending());
    }

    #[test]
    fn stops_and_searches_overtake_other_commands_and_keep_their_order() {
        let mut rig = Rig::new();
        rig.push(&[GO]);
        rig.push(&[Command::STOP, DOCK]);
        rig.push(&[Command::Volume(3)]);
        rig.push(&[GO]);
        rig.push(&[Command::Engine(Engage::CancelDock), Command::STOP]);
        rig.push(&[GO]);
        rig.drain();
        let cancel = Command::Engine(Engage::CancelDock);
        let expected = [
            Command::STOP,
            DOCK,
            GO,
            cancel,
            Command::STOP,
            Command::Volume(3),
            GO,
        ];
        assert_eq!(rig.written(), expected);
    }

    #[test]
    fn a_link_that_accepts_no_motion_is_detected_although_newer_motion_replaces_it() {
        let mut rig = Rig::new();
        let began = rig.now;
        for _ in 0..10 {
            rig.push(&[GO]);
            rig.write(0);
            rig.now += 500 * MS;
        }
        assert_eq!(rig.queue.waits_since(), Some(began));
        rig.drain();
        assert_eq!(rig.queue.waits_since(), None);
    }

    #[test]
    fn commands_go_before_speech_that_is_not_begun() {
        let mut rig = Rig::new();
        rig.queue.say(&samples(4096));
        rig.write(100);
        rig.push(&[Command::STOP, DOCK]);
        rig.drain();
        let written = rig.written();
        assert_eq!(
            written[..3],
            [Command::Audio(samples(1024)), Command::STOP, DOCK]
        );
        assert_eq!(written[3..], vec![Command::Audio(samples(1024)); 3]);
    }

    #[test]
    fn speech_waits_for_acknowledgements_and_a_stalled_link_is_detected() {
        let mut rig = Rig::new();
        rig.queue.say(&samples(1024));
        assert!(rig.queue.offer(rig.now, || Some(4097)).is_empty());
        assert_eq!(rig.queue.waits_since(), Some(rig.now));
        assert_eq!(rig.queue.next_offer(rig.now), Some(rig.now + RECHECK));
        assert_eq!(rig.queue.offer(rig.now, || Some(4096)).len(), 1029);
        assert_eq!(rig.queue.offer(rig.now, || None).len(), 1029);
    }

    #[test]
    fn without_last_words_a_queued_search_is_still_sent() {
        let mut rig = Rig::new();
        rig.push(&[GO]);
        rig.push(&[Command::STOP, DOCK]);
        rig.push(&[GO]);
        rig.queue.replace_unstarted(&[], rig.now);
        rig.drain();
        assert_eq!(rig.written(), [Command::STOP, DOCK]);
    }

    #[test]
    fn speech_is_sent_at_its_own_speed_with_a_small_lead() {
        let mut rig = Rig::new();
        let began = rig.now;
        for _ in 0..60 {
            assert!(rig.queue.say(&samples(32_000)));
            let next = rig.now + 1000 * MS;
            while let Some(look) = rig.queue.next_offer(rig.now).filter(|look| *look < next) {
                rig.drain();
                let passed = (rig.now - began).as_secs_f64();
                let most = 32_000.0 * (passed + 0.2) + 1030.0;
                assert!(
                    rig.out.len() as f64 <= most,
                    "{} after {passed} s",
                    rig.out.len()
                );
                rig.now = look;
            }
            rig.drain();
            rig.now = next;
        }
        let wanted = 60.0 * 32_000.0 - 1029.0;
        assert!(rig.out.len() as f64 >= wanted, "{}", rig.out.len());
    }

    /// A robot whose program takes one message per `period` from its queue, and an idle one at once.
    struct Robot {
        period: Duration,
        free_at: Instant,
        /// When each question will have been executed.
        answers: VecDeque<Instant>,
        moves: usize,
    }

    impl Robot {
        fn new(per_second: f64, now: Instant) -> Robot {
            Robot {
                period: Duration::from_secs_f64(1.0 / per_second),
                free_at: now,
                answers: VecDeque::new(),
                moves: 0,
            }
        }

        fn receive(&mut self, command: &Command, now: Instant) {
            let executed = self.free_at.max(now);
            self.free_at = executed + self.period;
            match command {
                Command::PowerQuery => self.answers.push_back(executed),
                Command::Move { .. } => self.moves += 1,
                _ => {}
            }
        }

        /// How long a stop that is sent now waits for its execution.
        fn age(&self, now: Instant) -> Duration {
            self.free_at.saturating_duration_since(now)
        }
    }

    /// Drives a robot that executes so many messages a second with a new setpoint every 20 ms, beside
    /// lights that flash; returns the ages of its queue in seconds, once it is known, and how many
    /// setpoints a second it has executed.
    fn drive(per_second: f64) -> (Vec<f64>, f64) {
        let mut rig = Rig::with_unknown_robot();
        let mut robot = Robot::new(per_second, rig.now);
        let began = rig.now;
        rig.queue.ask(rig.now);
        let mut ages = Vec::new();
        for step in 0..12_000_u32 {
            rig.now = began + step * 5 * MS;
            while robot.answers.front().is_some_and(|at| *at <= rig.now) {
                robot.answers.pop_front();
                rig.answer();
            }
            if step % 4 == 0 {
                let power = i8::try_from(step / 4 % 80).unwrap() + 1;
                rig.push(&[Command::Move {
                    left: power,
                    right: power,
                }]);
            }
            if step % 200 == 0 {
                let on = step % 400 == 0;
                rig.push(&[Command::Led { led: Led::Left, on }]);
            }
            rig.drain();
            for command in rig.written() {
                robot.receive(&command, rig.now);
            }
            rig.out.clear();
            if step > 400 {
                ages.push(robot.age(rig.now).as_secs_f64());
            }
        }
        ages.sort_by(f64::total_cmp);
        (ages, robot.moves as f64 / 60.0)
    }

    #[test]
    fn the_queue_of_a_slow_robot_stays_young_and_its_setpoints_new() {
        for per_second in [3.0, 5.0, 8.0, 10.0, 20.0, 50.0, 1000.0] {
            let (ages, moves) = drive(per_second);
            let p99 = ages[ages.len() * 99 / 100];
            let limit = if per_second < 5.0 {
                2.0 / per_second
            } else {
                0.3
            };
            assert!(p99 <= limit, "{per_second} a second: {p99} s");
            let least = f64::min(per_second * 0.4, 25.0);
            assert!(
                moves >= least,
                "{per_second} a second: {moves} setpoints a second"
            );
        }
    }

    #[test]
    fn the_first_setpoint_after_a_login_waits_for_nothing_and_the_next_for_their_pace() {
        let mut rig = Rig::with_unknown_robot();
        rig.push(&[Command::STOP]);
        rig.queue.ask(rig.now);
        rig.drain();
        let began = rig.now;
        for step in 0..60_u32 {
            rig.now = began + step * 20 * MS;
            let power = i8::try_from(step).unwrap() + 1;
            rig.push(&[Command::Move {
                left: power,
                right: power,
            }]);
            rig.drain();
            let moves = |command: &&Command| matches!(command, Command::Move { left: 1.., .. });
            let moves = rig.written().iter().filter(moves).count();
            // The robot may need 0.8 s for the login's messages and this one.
            let most = 1 + (step * 20).saturating_sub(500) / 200;
            assert!((1..=most as usize).contains(&moves), "{moves} at {step}");
        }
    }

    #[test]
    fn a_stop_replaces_the_first_setpoint_of_a_login_too() {
        let mut rig = Rig::with_unknown_robot();
        rig.push(&[GO]);
        rig.push(&[Command::STOP]);
        rig.drain();
        assert_eq!(rig.written(), [Command::STOP]);
        rig.push(&[GO]);
        rig.drain();
        rig.push(&[GO]);
        rig.drain();
        assert_eq!(rig.written(), [Command::STOP, GO], "the next one waits");
    }

    #[test]
    fn a_robot_that_answers_nothing_is_sent_what_a_slow_one_can_execute() {
        let mut rig = Rig::with_unknown_robot();
        let began = rig.now;
        rig.queue.ask(rig.now);
        for step in 0..6000_u32 {
            rig.now = began + step * 10 * MS;
            rig.push(&[GO]);
            rig.drain();
        }
        let written = rig.written();
        assert!(
            (200..=300).contains(&written.len()),
            "{} in a minute",
            written.len()
        );
        assert!(!rig.queue.pace().may_answer());
        rig.push(&[Command::STOP]);
        rig.drain();
        assert_eq!(
            rig.written().last(),
            Some(&Command::STOP),
            "a stop never waits"
        );
    }

    #[test]
    fn a_stop_is_executed_when_both_questions_after_it_are_answered() {
        let mut rig = Rig::new();
        rig.push(&[GO]);
        rig.push(&[Command::STOP]);
        let asked = rig.queue.ask(rig.now).unwrap();
        rig.drain();
        rig.answer();
        assert!(
            !rig.queue.pace().is_answered(asked),
            "one may have come unasked"
        );
        rig.answer();
        assert!(rig.queue.pace().is_answered(asked));
        let questions = [Command::PowerQuery, Command::PowerQuery];
        assert_eq!(rig.written()[1..], questions);
    }

    /// A step that changes the queue.
    #[derive(Debug, Clone)]
    enum Step {
        Push(Vec<Command>),
        Say(usize),
        Write(usize),
        Pass(u64),
        DropAudio,
    }

    fn command() -> impl Strategy<Value = Command> {
        prop_oneof![
            (-90i8..=90).prop_map(|power| Command::Move {
                left: power,
                right: power
            }),
            Just(Command::STOP),
            Just(DOCK),
            Just(Command::Engine(Engage::CancelDock)),
            (0u8..=100).prop_map(Command::Volume),
        ]
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            3 => prop::collection::vec(command(), 0..4).prop_map(Step::Push),
            2 => (0usize..40_000).prop_map(Step::Say),
            4 => (0usize..1500).prop_map(Step::Write),
            1 => (0u64..300).prop_map(Step::Pass),
            1 => Just(Step::DropAudio),
        ]
    }

    /// The last command that decides on the tracks: a MOVE or ENGINE.
    fn last_of(commands: &[Command]) -> Option<&Command> {
        let fate =
            |command: &&Command| matches!(command, Command::Move { .. } | Command::Engine(_));
        commands.iter().rev().find(fate)
    }

    proptest! {
        #[test]
        fn no_sequence_cuts_a_message_or_sends_speech_before_a_command(
            steps in prop::collection::vec(step(), 1..80),
        ) {
            let mut rig = Rig::new();
            let mut pushed = Vec::new();
    let mut accepted = 0;
            for step in steps {
                match step {
                    Step::Push(commands) => {
                        let before = rig.out.len();
                        let partly_written = rig.queue.partly_written.len();
                        prop_assert!(partly_written <= 1029);
                        prop_assert!(rig.push(&commands));
                        // If it were written now, nothing but the rest of that message would
                        // precede it.
                        let offer = rig.queue.offer(rig.now, || Some(0));
                        if rig.queue.waiting > 0 {
                            prop_assert!(offer.len() >= partly_written + rig.queue.waiting);
                        }
                        prop_assert_eq!(before, rig.out.len());
                        pushed.extend(commands);
                    }
                    Step::Say(length) => {
                        accepted += usize::from(rig.queue.say(&samples(length))) * length;
                    }
                    Step::Write(room) => {
                        rig.write(room);
                    }
                    Step::Pass(ms) => rig.now += ms as u32 * MS,
                    Step::DropAudio => rig.queue.drop_audio(),
                }
                prop_assert!(rig.queue.waiting <= MAX_WAITING + 100);
            }
            rig.now += Duration::from_secs(60);
            while !rig.queue.is_empty() {
                rig.write(usize::MAX);
                rig.now += 50 * MS;
            }
            let written = rig.written();
            let spoken: usize = written
                .iter()
                .map(|command| if let Command::Audio(samples) = command { samples.len() } else { 0 })
                .sum();
            prop_assert!(spoken <= accepted);
            prop_assert_eq!(last_of(&written), last_of(&pushed));
            let engines = |commands: &[Command]| {
                commands.iter().filter(|command| matches!(command, Command::Engine(_))).cloned().collect::<Vec<_>>()
            };
            prop_assert_eq!(engines(&written), engines(&pushed), "none is lost, none overtakes another");
        }
    }

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
