//! When the guardian speaks, and what: a pure state machine over notes and the time.

use std::time::Duration;

use tokio::time::Instant;

use super::note::{Note, Words};

/// How long the driving core may be silent before the guardian speaks in its place.
pub(super) const HEARTBEAT_TIMEOUT: Duration = Duration::from_millis(300);

/// What the guardian is to write now.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Speech {
    /// The bytes.
    pub(super) bytes: Vec<u8>,
    /// They end a message that the agent began: the agent, should it wake up, would end it again and
    /// put the robot out of step, so that the link must be closed for it.
    pub(super) closes: bool,
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Guard {
    /// There is a link; what to say on it.
    words: Option<Words>,
    beaten: Option<Instant>,
    /// The words were said, and no beat has come since.
    said: bool,
}

impl Guard {
    /// A note came.
    pub(super) fn take(&mut self, note: Note, now: Instant) {
        match note {
            Note::Guard(words) => {
                *self = Guard {
                    words: Some(words),
                    ..Guard::default()
                };
            }
            Note::Words(words) if self.words.is_some() => {
                self.said &= self.words.as_ref() == Some(&words);
                self.words = Some(words);
            }
            Note::Words(_) => return,
            Note::Beat => self.said = false,
            Note::Release => self.words = None,
        }
        self.beaten = Some(now);
    }

    /// Time passes: what to say if the core has been silent for too long; once for each silence.
    pub(super) fn poll(&mut self, now: Instant) -> Option<Speech> {
        if self.next_deadline()? > now {
            return None;
        }
        self.speak()
    }

    /// The agent is gone: what is to be said in any case.
    pub(super) fn end(&mut self) -> Option<Speech> {
        self.speak()
    }

    /// When [`Guard::poll`] has something to say.
    pub(super) fn next_deadline(&self) -> Option<Instant> {
        let listening = self.words.is_some() && !self.said;
        self.beaten
            .filter(|_| listening)
            .map(|beaten| beaten + HEARTBEAT_TIMEOUT)
    }

    fn speak(&mut self) -> Option<Speech> {
        let Words { rest, last } = self.words.as_ref()?;
        let speech = Speech {
            bytes: [rest.as_slice(), last].concat(),
            closes: !rest.is_empty(),
        };
        self.said = true;
        if speech.closes {
            self.words = None;
        }
        Some(speech).filter(|speech| !speech.bytes.is_empty())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn words(rest: &[u8], last: &[u8]) -> Words {
        Words {
            rest: rest.to_vec(),
            last: last.to_vec(),
        }
    }

    fn guarding(words: Words) -> (Guard, Instant) {
        let (mut guard, now) = (Guard::default(), Instant::now());
        guard.take(Note::Guard(words), now);
        (guard, now)
    }

    #[test]
    fn a_core_that_beats_is_left_alone() {
        let (mut guard, mut now) = guarding(words(b"", b"stop"));
        for _ in 0..10 {
            now += HEARTBEAT_TIMEOUT - MS;
            assert_eq!(guard.poll(now), None);
            guard.take(Note::Beat, now);
        }
    }

    #[test]
    fn silence_is_answered_once_until_the_next_beat() {
        let (mut guard, now) = guarding(words(b"", b"stop"));
        assert_eq!(guard.next_deadline(), Some(now + HEARTBEAT_TIMEOUT));
        let speech = guard.poll(now + HEARTBEAT_TIMEOUT).unwrap();
        assert_eq!((&*speech.bytes, speech.closes), (&b"stop"[..], false));
        assert_eq!(guard.poll(now + 10 * HEARTBEAT_TIMEOUT), None);
        guard.take(Note::Beat, now + 10 * HEARTBEAT_TIMEOUT);
        assert!(guard.poll(now + 11 * HEARTBEAT_TIMEOUT).is_some());
    }

    #[test]
    fn a_message_that_is_half_out_is_finished_first_and_the_link_closed() {
        let (mut guard, now) = guarding(words(b"", b"stop"));
        guard.take(Note::Words(words(b"rest", b"dock")), now);
        let speech = guard.poll(now + HEARTBEAT_TIMEOUT).unwrap();
        assert_eq!((&*speech.bytes, speech.closes), (&b"restdock"[..], true));
        assert_eq!(guard.end(), None, "the link is closed");
    }

    #[test]
    fn the_end_of_the_agent_is_answered_at_once_even_if_the_words_were_said() {
        let (mut guard, now) = guarding(words(b"", b"stop"));
        assert!(guard.poll(now + HEARTBEAT_TIMEOUT).is_some());
        assert!(guard.end().is_some());
    }

    #[test]
    fn a_robot_that_is_best_left_alone_is_told_nothing() {
        let (mut guard, now) = guarding(words(b"", b"stop"));
        guard.take(Note::Words(Words::default()), now);
        assert_eq!(guard.poll(now + HEARTBEAT_TIMEOUT), None);
        assert_eq!(guard.end(), None);
    }

    #[test]
    fn without_a_link_there_is_nothing_to_say() {
        let mut guard = Guard::default();
        guard.take(Note::Words(words(b"", b"stop")), Instant::now());
        assert_eq!((guard.next_deadline(), guard.end()), (None, None));
        let (mut guard, now) = guarding(words(b"", b"stop"));
        guard.take(Note::Release, now);
        assert_eq!(
            (guard.poll(now + HEARTBEAT_TIMEOUT), guard.end()),
            (None, None)
        );
    }
}
