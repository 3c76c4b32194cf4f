//! Detects a robot whose system still acknowledges data while its program is dead: nothing is
//! received any more, even when no stream is on. It is not known how often a real robot reports its
//! battery level, or whether it answers when asked (`PROTOCOL.md`, *Not known*), so silence means
//! something only after the robot has shown that it reports. Pure: reads no clock.

use std::time::Duration;

use tokio::time::Instant;

/// After this silence the robot is asked for its battery level, and again after each further one.
const ASK_AFTER: Duration = Duration::from_secs(20);
/// A level that comes within this time after the question counts as the answer.
const ANSWER: Duration = Duration::from_secs(2);
/// The shortest silence that ends a link, two questions included.
const SHORTEST: Duration = Duration::from_secs(60);
/// A robot that reports its level regularly is gone after this many missed reports.
const MISSED: u32 = 6;
/// This many intervals between levels decide whether they come regularly.
const PAUSES: usize = 4;

/// What to do about a silence.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum SilenceAction {
    /// Ask for the battery level.
    Ask,
    /// The robot is gone, even if its system still acknowledges data.
    Gone(Duration),
}

/// Evaluates the silence; see the module.
#[derive(Debug)]
pub(super) struct Silence {
    last_received: Instant,
    asked: Option<Instant>,
    level: Option<Instant>,
    pauses: Vec<Duration>,
    answers: bool,
}

impl Silence {
    /// Begins without knowledge of the robot.
    pub(super) fn new(now: Instant) -> Silence {
        Silence {
            last_received: now,
            asked: None,
            level: None,
            pauses: Vec::new(),
            answers: false,
        }
    }

    /// Handles a new login. What is known of the robot is kept.
    pub(super) fn begin(&mut self, now: Instant) {
        (self.last_received, self.asked, self.level) = (now, None, Some(now));
    }

    /// Notes that something was received from the robot.
    pub(super) fn note_received(&mut self, now: Instant) {
        self.last_received = now;
    }

    /// Notes a battery level.
    pub(super) fn level(&mut self, now: Instant) {
        let answer = self.asked.take().is_some_and(|asked| now < asked + ANSWER);
        self.answers |= answer;
        if let Some(before) = self.level.replace(now)
            && !answer
        {
            self.pauses.push(now.saturating_duration_since(before));
            let old = self.pauses.len().saturating_sub(PAUSES);
            self.pauses.drain(..old);
        }
        self.note_received(now);
    }

    /// Returns what to do if the silence is too long.
    pub(super) fn poll(&mut self, now: Instant) -> Option<SilenceAction> {
        let silence = now.saturating_duration_since(self.last_received);
        if self.limit().is_some_and(|limit| silence >= limit) {
            self.begin(now);
            return Some(SilenceAction::Gone(silence));
        }
        if self.next_question() > now {
            return None;
        }
        self.asked = Some(now);
        Some(SilenceAction::Ask)
    }

    /// When [`Silence::poll`] has something to return.
    pub(super) fn next_deadline(&self) -> Instant {
        let gone = self.limit().map(|limit| self.last_received + limit);
        gone.into_iter()
            .fold(self.next_question(), |next, gone| next.min(gone))
    }

    fn next_question(&self) -> Instant {
        let since = self
            .asked
            .map_or(self.last_received, |asked| asked.max(self.last_received));
        since + ASK_AFTER
    }

    /// The silence that ends the link; `None` for a robot whose silence means nothing.
    fn limit(&self) -> Option<Duration> {
        if self.answers {
            return Some(SHORTEST);
        }
        let (shortest, longest) = (self.pauses.iter().min()?, self.pauses.iter().max()?);
        let regular = self.pauses.len() == PAUSES && *longest <= *shortest * 2;
        regular.then(|| SHORTEST.max(*longest * MISSED))
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
    fn a_robot_that_reported_regularly_is_gone_when_it_stops_reporting() {
        let (mut silence, start) = new();
        for turn in 1..=4 {
            silence.level(start + 15 * turn * SECOND);
        }
        let verdicts = pass(&mut silence, start, 61, 200);
        let gone = (60 + 90, SilenceAction::Gone(90 * SECOND));
        assert_eq!(
            verdicts.iter().find(|one| one.1 != SilenceAction::Ask),
            Some(&gone)
        );
    }

    #[test]
    fn irregular_levels_give_silence_no_meaning() {
        let (mut silence, start) = new();
        for second in [15, 100, 103, 160, 300] {
            silence.level(start + second * SECOND);
        }
        let verdicts = pass(&mut silence, start, 301, 3000);
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
