//! How fast the robot's program executes what it is sent. It takes messages from a queue, and may be
//! slower than they are sent (`PROTOCOL.md`, *Told by people who drove real ones*): what the queue
//! holds delays a stop. So the program is asked questions that it answers in turn; the time to the
//! answer is the age of its queue. Motion, lights, sounds and speech are written only as fast as
//! they are executed. Pure: reads no clock.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::Bytes;
use tokio::time::Instant;

use crate::wire::{Command, Report};

/// The time for one message that is assumed until it is measured, and of a robot that answers no
/// question.
const CAUTIOUS: Duration = Duration::from_millis(200);
const SHORTEST: Duration = Duration::from_millis(1);
const LONGEST: Duration = Duration::from_secs(2);
/// How old the robot's queue may get, where its speed allows that: 0.3 s with the message that is
/// being executed.
const MAX_AGE: Duration = Duration::from_millis(250);
/// The shortest time between two questions while the robot moves.
const QUESTION_INTERVAL: Duration = Duration::from_millis(500);
/// A question that was not answered for this long is asked again. The answer then counts for all
/// earlier questions: a robot may answer several with one message.
const ASK_AGAIN: Duration = Duration::from_secs(1);
/// A robot that has never answered, and does not answer a question for this long, is asked another
/// kind of question, then none.
const FIRST_ANSWER: Duration = Duration::from_secs(2);
/// A robot that has answered, and does not answer for this long, is asked no more.
const LAST_ANSWER: Duration = Duration::from_secs(10);
/// The delay of an answer that the network alone may cause.
const JITTER: Duration = Duration::from_millis(50);
/// How often the speed of a robot that is not fast is measured while it moves.
const MEASURE_INTERVAL: Duration = Duration::from_secs(60);
/// The time for one message of a robot that need not be measured again.
const FAST: Duration = Duration::from_millis(30);
/// A robot that sends POWER so often unasked ...
const MANY_UNASKED: u32 = 4;
/// ... within this time is asked another kind of question: its answers cannot be told from the rest.
const UNASKED_SPAN: Duration = Duration::from_millis(500);
/// The most questions whose answers are awaited.
const MAX_QUESTIONS: usize = 16;
/// The time from the answer to the first control question to the next one; then twice as long ...
const CONTROL_PAUSE: Duration = Duration::from_secs(2);
/// ... up to this.
const MAX_CONTROL_PAUSE: Duration = Duration::from_secs(16);

/// Whether the robot's program answers questions, and how fast it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Executes {
    /// It was not asked long enough.
    Unknown,
    /// It answers: the time that it takes for one message.
    Every(Duration),
    /// It answers no question: what it has executed cannot be known.
    NoAnswer,
}

/// The delays of what is sent, as last measured.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Delays {
    /// From the arrival of a message at the robot to its execution.
    pub robot: Duration,
    /// There and back through the network, as the system measures it.
    pub network: Duration,
}

#[derive(Debug, Clone)]
struct Question {
    number: u64,
    at: Instant,
    /// The number of messages written up to this one.
    written: u64,
    /// The number of bytes written up to its last one.
    ends: u64,
    /// When it was expected to be executed, from `at` on.
    expected: Duration,
}

#[derive(Debug, Clone, Copy)]
struct Answered {
    at: Instant,
    written: u64,
}

/// POWER that nobody has asked for.
#[derive(Debug, Clone, Copy)]
struct Unasked {
    since: Instant,
    count: u32,
}

/// Checks whether POWER that arrives is an answer: some robots send it with each motion, and do not
/// answer POWER. CONFIG never comes unasked, but it is long, so it is asked rarely, between questions
/// for POWER: the robot answers in turn.
#[derive(Debug, Clone)]
struct Control {
    /// The number of messages written up to the one that is not answered.
    written: Option<u64>,
    due: Option<Instant>,
    pause: Duration,
}

#[derive(Debug, Clone)]
pub(super) struct Pace {
    question: Command,
    control: Control,
    /// The first key of the robot's settings.
    first_key: Option<Bytes>,
    unasked: Option<Unasked>,
    /// The number of questions that a later answer has settled: their own may still come.
    settled: usize,
    /// Whether it answers questions; `None`: not known yet.
    answers: Option<bool>,
    seen: u32,
    period: Duration,
    measured: bool,
    measured_at: Option<Instant>,
    /// When it will have executed everything that was written.
    busy_until: Option<Instant>,
    /// The number of messages written.
    written: u64,
    /// Questions without an answer, in order.
    open: VecDeque<Question>,
    /// The number of questions written.
    asked: u64,
    last_answer: Option<Answered>,
    delays: Option<Delays>,
    /// What was written up to this question is executed.
    answered_up_to: Option<u64>,
}

impl Default for Pace {
    fn default() -> Pace {
        Pace {
            question: Command::PowerQuery,
            control: Control {
                written: None,
                due: None,
                pause: CONTROL_PAUSE,
            },
            first_key: None,
            unasked: None,
            settled: 0,
            answers: None,
            seen: 0,
            period: CAUTIOUS,
            measured: false,
            measured_at: None,
            busy_until: None,
            written: 0,
            open: VecDeque::new(),
            asked: 0,
            last_answer: None,
            delays: None,
            answered_up_to: None,
        }
    }
}

impl Pace {
    /// The message that is the question at present.
    pub(super) fn question(&self) -> Command {
        self.question.clone()
    }

    /// Notes that a message was written, or its first byte. `question`: it is a question, and this is
    /// the number of bytes written up to its last one.
    pub(super) fn wrote(&mut self, question: Option<u64>, now: Instant) {
        self.written += 1;
        let busy_until = self.free_at(now) + self.spacing();
        self.busy_until = Some(busy_until);
        if let Some(ends) = question {
            if self.open.len() >= MAX_QUESTIONS {
                self.open.pop_front();
            }
            self.open.push_back(Question {
                number: self.asked,
                at: now,
                written: self.written,
                ends,
                expected: busy_until.saturating_duration_since(now),
            });
            self.asked += 1;
        }
    }

    /// Notes that the message just written is the control question.
    pub(super) fn wrote_control(&mut self) {
        self.control.written = Some(self.written);
    }

    /// Notes a report; returns whether an answer to the present question begins with it.
    pub(super) fn is_answer(&mut self, report: &Report, now: Instant) -> bool {
        match (&self.question, report) {
            (Command::PowerQuery, Report::Power(_)) => true,
            (Command::PowerQuery, Report::Config(settings)) => {
                if self.begins_settings(settings) {
                    self.control_answered(now);
                }
                false
            }
            (Command::ConfigQuery, Report::Config(settings)) => self.begins_settings(settings),
            _ => false,
        }
    }

    /// The robot sends its settings in several messages: the one with the first key is the first.
    fn begins_settings(&mut self, settings: &Bytes) -> bool {
        let end = settings.iter().position(|byte| *byte == b'=');
        let key = settings.slice(..end.unwrap_or(settings.len()));
        match &self.first_key {
            Some(first) => *first == key,
            None => {
                self.first_key = Some(Bytes::copy_from_slice(&key));
                true
            }
        }
    }

    fn control_answered(&mut self, now: Instant) {
        let Some(written) = self.control.written.take() else {
            return;
        };
        // A later question cannot be answered before this one.
        if self.last_answer.is_some_and(|last| last.written > written) {
            self.distrust_power();
        }
        self.control.due = Some(now + self.control.pause);
        self.control.pause = (self.control.pause * 2).min(MAX_CONTROL_PAUSE);
    }

    /// Whether to ask the control question before the next one.
    pub(super) fn is_control_due(&self, now: Instant) -> bool {
        self.question == Command::PowerQuery
            && self.control.written.is_none()
            && self.control.due.is_none_or(|due| now >= due)
    }

    /// Notes the beginning of an answer; `network` is the time that the network needs there and back.
    /// The robot's system has acknowledged so many bytes: what it has sent before a question arrived
    /// there answers an earlier one, or none. A POWER that comes unasked after that counts as an
    /// answer: ask twice where that matters.
    pub(super) fn answer(&mut self, network: Duration, acknowledged: u64, now: Instant) {
        if self.open.is_empty() {
            self.note_unasked(now);
        }
        let arrived = self.open.partition_point(|one| one.ends <= acknowledged);
        let asked = self.open.range(..arrived);
        let again = asked.clone().next().map(|oldest| oldest.at + ASK_AGAIN);
        let asked_again = asked.last().is_some_and(|newest| Some(newest.at) >= again);
        let count = if asked_again { arrived } else { arrived.min(1) };
        let Some(question) = self.open.drain(..count).next_back() else {
            return;
        };
        if asked_again {
            self.settled = count - 1;
        }
        self.seen += 1;
        // A single POWER may have come unasked.
        if self.seen > 1 || self.question == Command::ConfigQuery {
            self.answers = Some(true);
        }
        let age = now.saturating_duration_since(question.at);
        let delay = age.saturating_sub(network);
        self.delays = Some(Delays {
            robot: delay,
            network,
        });
        self.measure(&question, delay, now);
        self.last_answer = Some(Answered {
            at: now,
            written: question.written,
        });
        self.answered_up_to = Some(question.number);
        // The question itself may still be under execution.
        let behind = self.written - question.written + 1;
        let behind = u32::try_from(behind).unwrap_or(u32::MAX);
        self.busy_until = Some(now + self.spacing().saturating_mul(behind));
    }

    fn note_unasked(&mut self, now: Instant) {
        if self.question != Command::PowerQuery {
            return;
        }
        if self.settled > 0 {
            self.settled -= 1;
            return;
        }
        let unasked = match self.unasked {
            Some(Unasked { since, count }) if now < since + UNASKED_SPAN => Unasked {
                since,
                count: count + 1,
            },
            _ => Unasked {
                since: now,
                count: 1,
            },
        };
        self.unasked = Some(unasked);
        if unasked.count >= MANY_UNASKED {
            self.distrust_power();
        }
    }

    /// From now on asks for what the robot does not send by itself.
    fn distrust_power(&mut self) {
        self.question = Command::ConfigQuery;
        self.answers = None;
        self.forget_speed();
    }

    /// What was measured is not believed any more.
    fn forget_speed(&mut self) {
        self.open.clear();
        self.seen = 0;
        self.last_answer = None;
        self.period = self.period.max(CAUTIOUS);
        self.measured = false;
    }

    /// If it was busy from the last answer to this one, the time between them is that of the messages
    /// between them. Otherwise a late answer shows that it is slower than assumed.
    fn measure(&mut self, question: &Question, delay: Duration, now: Instant) {
        let busy_since = self.last_answer.filter(|last| last.at >= question.at);
        if let Some(last) = busy_since {
            let messages = u32::try_from(question.written - last.written).unwrap_or(u32::MAX);
            let sample = now.saturating_duration_since(last.at) / messages.max(1);
            self.period = if self.measured {
                (self.period + sample) / 2
            } else {
                sample
            };
            self.measured = true;
            self.measured_at = Some(now);
        } else if delay > question.expected + question.expected / 4 + JITTER {
            let slower = delay.as_secs_f64() / question.expected.as_secs_f64();
            self.period = self.period.mul_f64(slower.min(3.0));
        }
        self.period = self.period.clamp(SHORTEST, LONGEST);
    }

    /// Whether another message may be written that can wait.
    pub(super) fn admits(&self, now: Instant) -> bool {
        self.next_admission(now).is_some_and(|at| at <= now)
    }

    /// When the next message may be written that can wait; `None`: not before an answer.
    pub(super) fn next_admission(&self, now: Instant) -> Option<Instant> {
        if self.is_overdue(now) {
            return None;
        }
        let spacing = self.spacing();
        let limit = MAX_AGE.max(spacing + spacing / 3);
        let admission = self.free_at(now) + spacing;
        Some(admission.checked_sub(limit).map_or(now, |at| at.max(now)))
    }

    /// How many of `waiting` messages may be written at once, after `urgent` ones.
    pub(super) fn admitted(&self, urgent: usize, waiting: usize, now: Instant) -> usize {
        if waiting == 0 {
            return 0;
        }
        let mut model = self.clone();
        for _ in 0..urgent {
            model.wrote(None, now);
        }
        let mut count = 0;
        while count < waiting && model.admits(now) {
            model.wrote(None, now);
            count += 1;
        }
        count
    }

    /// Whether it is time for another question, while the robot moves.
    pub(super) fn is_question_due(&self, now: Instant) -> bool {
        if self.answers == Some(false) {
            return false;
        }
        let interval = match self.open.back() {
            Some(_) => ASK_AGAIN,
            None => QUESTION_INTERVAL.max(self.period * 5),
        };
        let last = self.open.back().map(|open| open.at);
        let last = last.or(self.last_answer.map(|last| last.at));
        match last {
            Some(at) => now >= at + interval,
            // It was asked another kind of question, in vain.
            None => self.asked > 0 && self.answers.is_none(),
        }
    }

    /// How many questions to ask now, while the robot moves: two in a row measure its speed, which
    /// may seem lower than it is after a disturbance.
    pub(super) fn questions(&self, now: Instant) -> usize {
        let old = self
            .measured_at
            .is_none_or(|at| now >= at + MEASURE_INTERVAL);
        if old && self.period > FAST && self.free_at(now) <= now {
            2
        } else {
            1
        }
    }

    /// Advances the time: gives up asking a robot that does not answer.
    pub(super) fn poll(&mut self, now: Instant) {
        let patience = if self.answers == Some(true) {
            LAST_ANSWER
        } else {
            FIRST_ANSWER
        };
        let waits = |open: &Question| now >= open.at + patience;
        if !self.open.front().is_some_and(waits) {
            return;
        }
        self.settled = self.open.len();
        self.forget_speed();
        if self.answers.is_none() && self.question == Command::PowerQuery {
            self.question = Command::ConfigQuery;
        } else {
            self.question = Command::PowerQuery;
            self.answers = Some(false);
        }
    }

    /// Since when a robot that answers has left the oldest question unanswered, if that is longer
    /// than its speed explains.
    pub(super) fn overdue_since(&self) -> Option<Instant> {
        let oldest = self.open.front()?;
        (self.answers == Some(true)).then_some(oldest.at + oldest.expected)
    }

    fn is_overdue(&self, now: Instant) -> bool {
        self.overdue_since()
            .is_some_and(|since| now >= since + ASK_AGAIN)
    }

    /// Whether it is worth asking.
    pub(super) fn may_answer(&self) -> bool {
        self.answers != Some(false)
    }

    /// The number of the question that is written next.
    pub(super) fn next_question(&self) -> u64 {
        self.asked
    }

    /// Whether what was written before this question is executed.
    pub(super) fn is_answered(&self, number: u64) -> bool {
        self.answered_up_to
            .is_some_and(|answered| answered >= number)
    }

    /// Whether its program answers, and how fast it is.
    pub(super) fn executes(&self) -> Executes {
        match self.answers {
            None => Executes::Unknown,
            Some(true) => Executes::Every(self.period),
            Some(false) => Executes::NoAnswer,
        }
    }

    pub(super) fn delays(&self) -> Option<Delays> {
        self.delays
    }

    /// The time planned for one message: a little longer than measured, so that the queue shrinks.
    fn spacing(&self) -> Duration {
        self.period + self.period / 10
    }

    /// When it will begin to execute what is written now, as far as its speed is known.
    pub(super) fn next_execution(&self, now: Instant) -> Instant {
        if self.measured {
            self.free_at(now)
        } else {
            now
        }
    }

    fn free_at(&self, now: Instant) -> Instant {
        self.busy_until.map_or(now, |busy| busy.max(now))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn ask(pace: &mut Pace, now: Instant) {
        pace.wrote(Some(0), now);
    }

    fn answer(pace: &mut Pace, now: Instant) {
        pace.answer(Duration::ZERO, 0, now);
    }

    #[test]
    fn a_robot_that_sends_power_unasked_is_asked_what_it_does_not_send_by_itself() {
        let start = Instant::now();
        let mut pace = Pace::default();
        for round in 0..4 {
            ask(&mut pace, start + 600 * round * MS);
            answer(&mut pace, start + (600 * round + 10) * MS);
        }
        assert!(matches!(pace.executes(), Executes::Every(_)));
        for burst in 0..4 {
            answer(&mut pace, start + (2000 + 20 * burst) * MS);
        }
        assert_eq!(pace.question(), Command::ConfigQuery);
        assert_eq!(pace.executes(), Executes::Unknown);
        let now = start + 2100 * MS;
        assert!(pace.is_question_due(now));
        ask(&mut pace, now);
        answer(&mut pace, now + 400 * MS);
        assert!(matches!(pace.executes(), Executes::Every(period) if period >= CAUTIOUS));
    }

    /// As after an outage: the robot's system repeats what it could not deliver, before the questions
    /// that were asked meanwhile have arrived.
    #[test]
    fn what_the_robot_sent_before_a_question_arrived_is_no_answer_to_it() {
        let start = Instant::now();
        for again in [500, 1500, 4000] {
            let mut pace = Pace::default();
            pace.wrote(Some(10), start);
            let number = pace.next_question();
            pace.wrote(Some(20), start + again * MS);
            for _old in 0..3 {
                pace.answer(Duration::ZERO, 10, start + 5000 * MS);
                assert!(!pace.is_answered(number), "{again} ms");
            }
            pace.answer(Duration::ZERO, 20, start + 5100 * MS);
            assert!(pace.is_answered(number));
            assert_eq!(pace.question(), Command::PowerQuery);
        }
    }

    fn settings(text: &'static str) -> Report {
        Report::Config(Bytes::from_static(text.as_bytes()))
    }

    #[test]
    fn power_before_the_answer_to_an_earlier_question_is_no_answer() {
        let start = Instant::now();
        for unasked in [false, true] {
            let mut pace = Pace::default();
            ask(&mut pace, start);
            answer(&mut pace, start + 100 * MS);
            assert!(pace.is_control_due(start));
            pace.wrote(None, start + 200 * MS);
            pace.wrote_control();
            assert!(!pace.is_control_due(start + 200 * MS));
            ask(&mut pace, start + 200 * MS);
            if unasked {
                answer(&mut pace, start + 300 * MS);
            }
            assert!(!pace.is_answer(&settings("name=Spykee"), start + 600 * MS));
            assert!(!pace.is_answer(&settings("channel=6"), start + 600 * MS));
            let asks_config = pace.question() == Command::ConfigQuery;
            assert_eq!(asks_config, unasked);
            assert_eq!(pace.is_control_due(start + 3000 * MS), !unasked);
        }
    }

    #[test]
    fn settings_in_several_messages_are_one_answer() {
        let mut pace = Pace {
            question: Command::ConfigQuery,
            ..Pace::default()
        };
        let now = Instant::now();
        let mut begins = |text| pace.is_answer(&settings(text), now);
        let answer = ["name=Spykee&volume=70", "channel=6&ssid=SPYKEE", "version"];
        for _answer in 0..3 {
            assert_eq!(answer.map(&mut begins), [true, false, false]);
        }
        assert!(begins("name=Anna&volume=70"));
        let power = Report::Power(crate::wire::Power::from_byte(50));
        assert!(!pace.is_answer(&power, now));
    }

    #[test]
    fn a_level_every_five_seconds_and_late_answers_change_nothing() {
        let start = Instant::now();
        let mut pace = Pace::default();
        for second in 0..60 {
            answer(&mut pace, start + 5000 * second * MS);
        }
        let now = start + 300_000 * MS;
        for question in 0..8 {
            ask(&mut pace, now + 1000 * question * MS);
        }
        for late in 0..8 {
            answer(&mut pace, now + (9000 + late) * MS);
        }
        assert_eq!(pace.question(), Command::PowerQuery);
    }
}
