//! Detects a robot whose system still acknowledges data while its program is dead: nothing is
//! received any more, even when no stream is on. It is not known whether a real robot answers when
//! it is asked for its battery level (`PROTOCOL.md`, *Not known*), so silence means something only
//! after the robot has answered questions. Pure: reads no clock.

use std::time::Duration;

use tokio::time::Instant;

/// The robot is asked after this silence, and again after each further one.
const ASK_AFTER: Duration = Duration::from_secs(20);
/// The silence that ends the link to a robot that answers, two questions included.
const LONGEST: Duration = Duration::from_secs(60);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SilenceAction {
    Ask,
    /// The robot is gone, even if its system still acknowledges data.
    Gone(Duration),
}

#[derive(Debug)]
pub(super) struct Silence {
    last_received: Instant,
    asked: Option<Instant>,
    answers: bool,
}

impl Silence {
    pub(super) fn new(now: Instant) -> Silence {
        Silence {
            last_received: now,
            asked: None,
            answers: false,
        }
    }

    /// Handles a new login. Whether the robot answers is still known.
    pub(super) fn begin(&mut self, now: Instant) {
        self.last_received = now;
        self.asked = None;
    }

    pub(super) fn note_received(&mut self, now: Instant) {
        self.last_received = now;
    }

    /// The robot is known to answer questions.
    pub(super) fn note_answers(&mut self) {
        self.answers = true;
    }

    pub(super) fn poll(&mut self, now: Instant) -> Option<SilenceAction> {
        let silence = now.saturating_duration_since(self.last_received);
        if self.answers && silence >= LONGEST {
            self.begin(now);
            return Some(SilenceAction::Gone(silence));
        }
        if self.next_question() > now {
            return None;
        }
        self.asked = Some(now);
        Some(SilenceAction::Ask)
    }

    pub(super) fn next_deadline(&self) -> Instant {
        let question = self.next_question();
        if self.answers {
            question.min(self.last_received + LONGEST)
        } else {
            question
        }
    }

    fn next_question(&self) -> Instant {
        let since = self.asked.unwrap_or(self.last_received);
        since.max(self.last_received) + ASK_AFTER
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    /// Lets time pass; returns each action with its time in seconds from the start.
    fn pass(
        silence: &mut Silence,
        start: Instant,
        from: u32,
        until: u32,
    ) -> Vec<(u32, SilenceAction)> {
        let verdict = |second| Some((second, silence.poll(start + second * SECOND)?));
        (from..until).filter_map(verdict).collect()
    }

    fn new() -> (Silence, Instant) {
        let start = Instant::now();
        (Silence::new(start), start)
    }

    #[test]
    fn a_robot_that_never_answered_is_only_asked() {
        let (mut silence, start) = new();
        let verdicts = pass(&mut silence, start, 0, 1000);
        assert_eq!(verdicts.len(), 49);
        assert!(
            verdicts
                .iter()
                .all(|(_, verdict)| *verdict == SilenceAction::Ask)
        );
    }

    #[test]
    fn a_robot_that_answers_is_gone_after_two_questions_also_after_another_login() {
        let (mut silence, start) = new();
        silence.note_answers();
        let gone = SilenceAction::Gone(60 * SECOND);
        for login in [0, 100] {
            silence.begin(start + login * SECOND);
            let expected = [
                (login + 20, SilenceAction::Ask),
                (login + 40, SilenceAction::Ask),
                (login + 60, gone),
            ];
            let verdicts = pass(&mut silence, start, login, login + 61);
            assert_eq!(verdicts, expected);
        }
    }

    #[test]
    fn any_message_ends_the_silence() {
        let (mut silence, start) = new();
        silence.note_answers();
        pass(&mut silence, start, 0, 21);
        for second in 26..500 {
            silence.note_received(start + second * SECOND);
            assert_eq!(silence.poll(start + second * SECOND), None);
        }
    }

    #[test]
    fn the_last_deadline_is_the_end_of_the_link() {
        let (mut silence, start) = new();
        silence.note_answers();
        silence.poll(start + 20 * SECOND);
        silence.poll(start + 41 * SECOND + SECOND / 2);
        assert_eq!(silence.next_deadline(), start + 60 * SECOND);
    }

    #[test]
    fn it_is_asked_at_its_deadlines_and_never_before() {
        let (mut silence, start) = new();
        assert_eq!(silence.next_deadline(), start + 20 * SECOND);
        silence.poll(start + 20 * SECOND);
        assert_eq!(silence.next_deadline(), start + 40 * SECOND);
    }
}
