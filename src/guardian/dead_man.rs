//! Decides when the guardian writes to the robot, and what: a pure state machine over messages and
//! the time.

use std::time::Duration;

use tokio::time::Instant;

use super::debt::OpenLink;
use super::message::{GuardianMessage, LastWordsData};

/// How long the driving core may be silent before the guardian acts in its place.
pub const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(300);

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
    /// The data to send; kept without a link too.
    words: LastWordsData,
    link: OpenLink,
    beaten: Option<Instant>,
    /// Nothing is written before this time.
    deferred: Option<Instant>,
    /// The data was sent, and no beat has come since.
    written: bool,
}

impl DeadMan {
    pub(super) fn handle(&mut self, message: GuardianMessage, now: Instant) {
        match message {
            GuardianMessage::Watch(words) => self.begin(OpenLink::Ready, words),
            GuardianMessage::Login(words) => self.begin(OpenLink::Login, words),
            GuardianMessage::LastWords(words) => {
                self.written &= self.words == words;
                self.words = words;
            }
            GuardianMessage::Heartbeat => self.written = false,
            GuardianMessage::Release => self.lose_link(),
            GuardianMessage::Route(_) | GuardianMessage::Debt(_) => {}
            GuardianMessage::Wrote | GuardianMessage::Stopped => return,
        }
        self.beaten = Some(now);
    }

    fn begin(&mut self, link: OpenLink, words: LastWordsData) {
        *self = DeadMan {
            words,
            link,
            ..DeadMan::default()
        };
    }

    /// The link is closed or broken. The last words stay: there may be another way to the robot.
    pub(super) fn lose_link(&mut self) {
        self.link = OpenLink::None;
        self.words.rest.clear();
    }

    /// The link may be written to from now on.
    pub(super) fn set_ready(&mut self) {
        self.link = OpenLink::Ready;
    }

    /// Whether there is a link on which the robot obeys only after its first POWER.
    pub(super) fn is_login(&self) -> bool {
        self.link == OpenLink::Login
    }

    /// The robot does not obey yet: writes nothing for the time [`LOOK`].
    pub(super) fn defer(&mut self, now: Instant) {
        self.deferred = Some(now + LOOK);
    }

    /// Whether the core does not beat.
    pub(super) fn is_silent(&self, now: Instant) -> bool {
        self.silent_from().is_none_or(|from| from <= now)
    }

    /// When the core counts as silent if it does not beat before; `None`: it has never beaten.
    pub(super) fn silent_from(&self) -> Option<Instant> {
        Some(self.beaten? + HEARTBEAT_TIMEOUT)
    }

    /// The last words are these until the agent says otherwise, and to be written even if others
    /// were.
    pub(super) fn replace_last(&mut self, last: Vec<u8>) {
        self.words.last = last;
        self.written = false;
    }

    /// The whole messages to send; none if the robot is best left alone.
    pub(super) fn last_words(&self) -> &[u8] {
        &self.words.last
    }

    /// Returns the data to send if the core has been silent for too long; once per silence.
    pub(super) fn poll(&mut self, now: Instant) -> Option<PendingWrite> {
        if self.next_deadline()? > now {
            return None;
        }
        self.take_pending()
    }

    /// The link as the agent leaves it.
    pub(super) fn open_link(&self) -> OpenLink {
        self.link
    }

    /// When [`DeadMan::poll`] has something to return.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        if self.written || !matches!(self.link, OpenLink::Login | OpenLink::Ready) {
            return None;
        }
        let due = self.silent_from()?;
        Some(self.deferred.map_or(due, |at| due.max(at)))
    }

    /// The data to send now, even if it was sent before.
    pub(super) fn take_pending(&mut self) -> Option<PendingWrite> {
        let LastWordsData { rest, last } = &self.words;
        let pending = PendingWrite {
            bytes: [rest.as_slice(), last].concat(),
            closes: !rest.is_empty(),
        };
        self.written = true;
        if pending.closes {
            self.words.rest.clear();
            self.link = OpenLink::Written;
        }
        if pending.bytes.is_empty() {
            None
        } else {
            Some(pending)
        }
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
        assert_eq!(dead_man.poll(now + 9 * HEARTBEAT_TIMEOUT), None);
        assert_eq!(dead_man.open_link(), OpenLink::Written);
        assert_eq!(dead_man.last_words(), b"dock", "for another link");
    }

    #[test]
    fn a_persons_stop_is_written_even_after_the_last_words() {
        let (mut dead_man, now) = guarding(words(b"", b"dock"));
        assert!(!dead_man.is_silent(now));
        let silent = now + HEARTBEAT_TIMEOUT;
        assert!(dead_man.poll(silent).is_some());
        assert!(dead_man.is_silent(silent));
        dead_man.replace_last(b"stop".to_vec());
        assert_eq!(dead_man.poll(silent).unwrap().bytes, b"stop");
    }

    #[test]
    fn empty_last_words_are_not_sent() {
        let (mut dead_man, now) = guarding(words(b"", b"stop"));
        dead_man.handle(GuardianMessage::LastWords(LastWordsData::default()), now);
        assert_eq!(dead_man.poll(now + HEARTBEAT_TIMEOUT), None);
        assert_eq!(dead_man.last_words(), b"");
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
    fn without_a_link_nothing_is_sent_but_the_last_words_are_kept() {
        let mut dead_man = DeadMan::default();
        let now = Instant::now();
        dead_man.handle(GuardianMessage::LastWords(words(b"", b"stop")), now);
        assert_eq!(dead_man.next_deadline(), None);
        assert_eq!(dead_man.last_words(), b"stop");
        let (mut dead_man, now) = guarding(words(b"rest", b"stop"));
        dead_man.handle(GuardianMessage::Release, now);
        assert_eq!(dead_man.poll(now + HEARTBEAT_TIMEOUT), None);
        assert_eq!(dead_man.open_link(), OpenLink::None);
        assert_eq!(dead_man.last_words(), b"stop");
    }
}
