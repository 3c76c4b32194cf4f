//! Decides when the guardian writes to the robot, and what: a pure state machine over messages and
//! the time.

use std::time::Duration;

use tokio::time::Instant;

use super::message::{GuardianMessage, LastWordsData};

/// How long the driving core may be silent before the guardian acts in its place.
pub(super) const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(300);

/// How often to check whether the robot obeys.
pub(super) const LOOK: Duration = Duration::from_millis(50);

#[derive(Debug, PartialEq, Eq)]
pub(super) struct PendingWrite {
    pub(super) bytes: Vec<u8>,
    /// The data completes a message that the agent began. The agent, if it resumed, would complete
    /// it again and break the framing, so the link must be closed.
    pub(super) closes: bool,
}

#[derive(Debug, Default)]
pub(super) struct DeadMan {
    /// The data to send; present while there is a link.
    words: Option<LastWordsData>,
    beaten: Option<Instant>,
    login: bool,
    /// Nothing is written before this time.
    deferred: Option<Instant>,
    /// The data was sent, and no beat has come since.
    written: bool,
}

impl DeadMan {
    pub(super) fn handle(&mut self, message: GuardianMessage, now: Instant) {
        match message {
            GuardianMessage::Watch(words) => {
                *self = DeadMan {
                    words: Some(words),
                    ..DeadMan::default()
                };
            }
            GuardianMessage::Login(words) => {
                *self = DeadMan {
                    words: Some(words),
                    login: true,
                    ..DeadMan::default()
                };
            }
            GuardianMessage::LastWords(words) if self.words.is_some() => {
                self.written &= self.words.as_ref() == Some(&words);
                self.words = Some(words);
            }
            GuardianMessage::LastWords(_) | GuardianMessage::Wrote => return,
            GuardianMessage::Heartbeat => self.written = false,
            GuardianMessage::Release => self.words = None,
        }
        self.beaten = Some(now);
    }

    /// Whether there is a link on which the robot obeys only after its first POWER.
    pub(super) fn is_login(&self) -> bool {
        self.login && self.words.is_some()
    }

    /// The robot does not obey yet: writes nothing for the time [`LOOK`].
    pub(super) fn defer(&mut self, now: Instant) {
        self.deferred = Some(now + LOOK);
    }

    /// Returns the data to send if the core has been silent for too long; once per silence.
    pub(super) fn poll(&mut self, now: Instant) -> Option<PendingWrite> {
        if self.next_deadline()? > now {
            return None;
        }
        self.take_pending()
    }

    /// The agent is gone: returns the data to send, even if it was sent before.
    pub(super) fn end(&mut self) -> Option<PendingWrite> {
        self.take_pending()
    }

    /// When [`DeadMan::poll`] has something to return.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        let listening = self.words.is_some() && !self.written;
        if !listening {
            return None;
        }
        let due = self.beaten? + HEARTBEAT_TIMEOUT;
        Some(self.deferred.map_or(due, |at| due.max(at)))
    }

    fn take_pending(&mut self) -> Option<PendingWrite> {
        let LastWordsData { rest, last } = self.words.as_ref()?;
        let pending = PendingWrite {
            bytes: [rest.as_slice(), last].concat(),
            closes: !rest.is_empty(),
        };
        self.written = true;
        if pending.closes {
            self.words = None;
        }
        Some(pending).filter(|pending| !pending.bytes.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn words(rest: &[u8], last: &[u8]) -> LastWordsData {
        LastWordsData {
            rest: rest.to_vec(),
            last: last.to_vec(),
        }
    }

    fn guarding(words: LastWordsData) -> (DeadMan, Instant) {
        let mut dead_man = DeadMan::default();
        let now = Instant::now();
        dead_man.handle(GuardianMessage::Watch(words), now);
        (dead_man, now)
    }

    #[test]
    fn a_core_that_beats_is_left_alone() {
        let (mut dead_man, mut now) = guarding(words(b"", b"stop"));
        for _ in 0..10 {
            now += HEARTBEAT_TIMEOUT - MS;
            assert_eq!(dead_man.poll(now), None);
            dead_man.handle(GuardianMessage::Heartbeat, now);
        }
    }

    #[test]
    fn silence_leads_to_one_write_until_the_next_beat() {
        let (mut dead_man, now) = guarding(words(b"", b"stop"));
        assert_eq!(dead_man.next_deadline(), Some(now + HEARTBEAT_TIMEOUT));
        let pending = dead_man.poll(now + HEARTBEAT_TIMEOUT).unwrap();
        assert_eq!((&*pending.bytes, pending.closes), (&b"stop"[..], false));
        assert_eq!(dead_man.poll(now + 10 * HEARTBEAT_TIMEOUT), None);
        dead_man.handle(GuardianMessage::Heartbeat, now + 10 * HEARTBEAT_TIMEOUT);
        assert!(dead_man.poll(now + 11 * HEARTBEAT_TIMEOUT).is_some());
    }

    #[test]
    fn a_partly_written_message_is_finished_first_and_the_link_closed() {
        let (mut dead_man, now) = guarding(words(b"", b"stop"));
        dead_man.handle(GuardianMessage::LastWords(words(b"rest", b"dock")), now);
        let pending = dead_man.poll(now + HEARTBEAT_TIMEOUT).unwrap();
        assert_eq!((&*pending.bytes, pending.closes), (&b"restdock"[..], true));
        assert_eq!(dead_man.end(), None, "the link is closed");
    }

    #[test]
    fn the_end_of_the_agent_leads_to_a_write_even_after_an_earlier_one() {
        let (mut dead_man, now) = guarding(words(b"", b"stop"));
        assert!(dead_man.poll(now + HEARTBEAT_TIMEOUT).is_some());
        assert!(dead_man.end().is_some());
    }

    #[test]
    fn empty_last_words_are_not_sent() {
        let (mut dead_man, now) = guarding(words(b"", b"stop"));
        dead_man.handle(GuardianMessage::LastWords(LastWordsData::default()), now);
        assert_eq!(dead_man.poll(now + HEARTBEAT_TIMEOUT), None);
        assert_eq!(dead_man.end(), None);
    }

    #[test]
    fn during_a_login_nothing_is_sent_before_the_robot_obeys() {
        let mut dead_man = DeadMan::default();
        let now = Instant::now();
        dead_man.handle(GuardianMessage::Login(words(b"", b"stop")), now);
        assert!(dead_man.is_login());
        let due = now + HEARTBEAT_TIMEOUT;
        dead_man.defer(due);
        assert_eq!(dead_man.poll(due), None);
        assert_eq!(dead_man.next_deadline(), Some(due + LOOK));
        assert!(dead_man.poll(due + LOOK).is_some());
        dead_man.handle(GuardianMessage::Watch(words(b"", b"stop")), now);
        assert!(!dead_man.is_login());
        dead_man.handle(GuardianMessage::Login(words(b"", b"stop")), now);
        dead_man.handle(GuardianMessage::Release, now);
        assert!(!dead_man.is_login());
    }

    #[test]
    fn without_a_link_nothing_is_sent() {
        let mut dead_man = DeadMan::default();
        dead_man.handle(
            GuardianMessage::LastWords(words(b"", b"stop")),
            Instant::now(),
        );
        assert_eq!((dead_man.next_deadline(), dead_man.end()), (None, None));
        let (mut dead_man, now) = guarding(words(b"", b"stop"));
        dead_man.handle(GuardianMessage::Release, now);
        assert_eq!(
            (dead_man.poll(now + HEARTBEAT_TIMEOUT), dead_man.end()),
            (None, None)
        );
    }
}
