//! Detects a robot whose system still acknowledges data while its program is dead: nothing is
//! received any more, even when no stream is on. It is not known whether a real robot answers when
//! it is asked for its battery level (`PROTOCOL.md`, *Not known*), so silence means something only
//! after the robot has answered once: it is asked after each login, even while it reports. Pure:
//! reads no clock.

use std::time::Duration;

use tokio::time::Instant;

/// The robot is asked for its battery level this long after a login, unless it is known to answer,
/// after this silence, and again after each further one.
const ASK_AFTER: Duration = Duration::from_secs(20);
/// A level that comes within this time after the question counts as the answer.
const ANSWER: Duration = Duration::from_secs(2);
/// The silence that ends the link to a robot that answers, two questions included.
const LONGEST: Duration = Duration::from_secs(60);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SilenceAction {
    /// Ask for the battery level.
    Ask,
    /// The robot is gone, even if its system still acknowledges data.
    Gone(Duration),
}

#[derive(Debug)]
pub(super) struct Silence {
    last_received: Instant,
    /// The login, until the first question after it.
    login: Option<Instant>,
    asked: Option<Instant>,
    answers: bool,
}

impl Silence {
    pub(super) fn new(now: Instant) -> Silence {
        Silence {
            last_received: now,
            login: Some(now),
            asked: None,
            answers: false,
        }
    }

    /// Handles a new login. Whether the robot answers is still known.
    pub(super) fn begin(&mut self, now: Instant) {
        self.last_received = now;
        self.login = Some(now);
        self.asked = None;
    }

    pub(super) fn note_received(&mut self, now: Instant) {
        self.last_received = now;
    }

    pub(super) fn level(&mut self, now: Instant) {
        self.answers |= self.asked.take().is_some_and(|asked| now < asked + ANSWER);
        self.note_received(now);
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
        self.login = None;
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
        let since = match (self.login, self.asked) {
            (Some(login), _) if !self.answers => login,
            (_, Some(asked)) => asked.max(self.last_received),
            (_, None) => self.last_received,
        };
        since + ASK_AFTER
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
        let mut silence = Silence::new(start);
        silence.begin(start);
        (silence, start)
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
    fn a_robot_that_reports_is_asked_once_after_a_login_and_then_known_to_answer() {
        let (mut silence, start) = new();
        for second in 0..20 {
            silence.level(start + second * SECOND);
            assert_eq!(silence.poll(start + second * SECOND), None);
        }
        assert_eq!(
            pass(&mut silence, start, 20, 21),
            [(20, SilenceAction::Ask)]
        );
        silence.level(start + 21 * SECOND);
        silence.begin(start + 30 * SECOND);
        let gone = SilenceAction::Gone(60 * SECOND);
        let expected = [
            (50, SilenceAction::Ask),
            (70, SilenceAction::Ask),
            (90, gone),
        ];
        assert_eq!(pass(&mut silence, start, 30, 91), expected);
    }

    #[test]
    fn a_robot_that_answered_once_is_gone_when_it_stops_answering() {
        let (mut silence, start) = new();
        assert_eq!(pass(&mut silence, start, 0, 21), [(20, SilenceAction::Ask)]);
        silence.level(start + 21 * SECOND);
        let gone = SilenceAction::Gone(60 * SECOND);
        let expected = [
            (41, SilenceAction::Ask),
            (61, SilenceAction::Ask),
            (81, gone),
        ];
        assert_eq!(pass(&mut silence, start, 21, 82), expected);
        silence.begin(start + 82 * SECOND);
        let expected = [
            (102, SilenceAction::Ask),
            (122, SilenceAction::Ask),
            (142, gone),
        ];
        let again = pass(&mut silence, start, 82, 143);
        assert_eq!(again, expected, "known after another login too");
    }

    #[test]
    fn levels_that_come_unasked_give_silence_no_meaning() {
        let (mut silence, start) = new();
        for second in [15, 30, 45, 60] {
            silence.level(start + second * SECOND);
        }
        let verdicts = pass(&mut silence, start, 61, 3000);
        assert!(
            verdicts
                .iter()
                .all(|(_, verdict)| *verdict == SilenceAction::Ask)
        );
    }

    #[test]
    fn any_message_ends_the_silence_and_a_late_level_is_not_an_answer() {
        let (mut silence, start) = new();
        pass(&mut silence, start, 0, 21);
        silence.level(start + 25 * SECOND);
        for second in 26..500 {
            silence.note_received(start + second * SECOND);
            assert_eq!(silence.poll(start + second * SECOND), None);
        }
        let verdicts = pass(&mut silence, start, 500, 700);
        assert!(
            verdicts
                .iter()
                .all(|(_, verdict)| *verdict == SilenceAction::Ask)
        );
    }

    #[test]
    fn a_level_at_the_end_of_the_time_for_an_answer_is_not_an_answer() {
        let (mut silence, start) = new();
        silence.poll(start + 20 * SECOND);
        silence.level(start + 20 * SECOND + ANSWER);
        assert!(!silence.answers);
        silence.poll(start + 60 * SECOND);
        silence.level(start + 60 * SECOND + ANSWER - Duration::from_millis(1));
        assert!(silence.answers);
    }

    #[test]
    fn the_last_deadline_is_the_end_of_the_link() {
        let (mut silence, start) = new();
        silence.poll(start + 20 * SECOND);
        silence.level(start + 21 * SECOND);
        silence.poll(start + 41 * SECOND);
        silence.poll(start + 61 * SECOND + SECOND / 2);
        assert_eq!(silence.next_deadline(), start + 81 * SECOND);
    }

    #[test]
    fn it_is_asked_at_its_deadlines_and_never_before() {
        let (mut silence, start) = new();
        assert_eq!(silence.next_deadline(), start + 20 * SECOND);
        silence.poll(start + 20 * SECOND);
        assert_eq!(silence.next_deadline(), start + 40 * SECOND);
    }
}
