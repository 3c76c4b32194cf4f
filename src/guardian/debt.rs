//! How a stop is delivered when the agent is gone: on the open link, and if a debt stands and that
//! does not work, by dialling the robot until a stop is executed. A pure state machine over events
//! and the time.

use std::time::Duration;

use tokio::time::Instant;

const DEBT_LIMIT: Duration = Duration::from_secs(10 * 60);
/// How long a link is held open for its last words if no debt stands.
const LINK_LIMIT: Duration = Duration::from_secs(6);
/// How long the open link may take before the robot is dialled beside it.
const LINK_HEAD_START: Duration = Duration::from_secs(2);
/// The shortest time from one dialling to the next.
const DIAL_EVERY: Duration = Duration::from_millis(500);
const CONNECT_LIMIT: Duration = Duration::from_secs(1);
/// How long a robot may take from the login to its first POWER, before which it obeys nothing
/// (`PROTOCOL.md`, *Order after login*); as long as an agent waits by default.
const FIRST_POWER_LIMIT: Duration = Duration::from_secs(10);
/// How long it may take to answer the login, at first, so that a login that was lost is repeated
/// within 2 s of the robot being in reach again. After [`PATIENT_AFTER`] as long as for the first
/// POWER, for a robot that is slow.
const REPLY_LIMIT: Duration = Duration::from_millis(1500);
const PATIENT_AFTER: Duration = Duration::from_secs(60);
/// How long a robot that has acknowledged the stop may take to answer the questions behind it.
const ANSWER_LIMIT: Duration = Duration::from_secs(3);
/// How long the robot may take to close its half of a link whose other half is closed: until then
/// its program may still have to read the stop.
const CLOSING_LIMIT: Duration = Duration::from_secs(10);
/// The same if it was left nothing but what the agent wrote.
const SHORT_CLOSING_LIMIT: Duration = Duration::from_secs(3);
/// One unasked POWER may come between the questions and their answers.
pub(super) const QUESTIONS: u32 = 2;

/// The link on which the agent was last connected.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) enum OpenLink {
    #[default]
    None,
    /// The robot has accepted a login, but obeys only after its first POWER.
    Login,
    Ready,
    /// Nothing more can or need be written on it.
    Written,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DebtEvent {
    /// So many POWER messages were received on the open link; once the last words are written, only
    /// those received when the robot's system had acknowledged them.
    LinkPowers(u32),
    LinkClosed,
    LinkBroken,
    Connected,
    Accepted,
    /// It has sent its first POWER after that.
    LoggedIn,
    /// So many POWER messages were received on the dialled connection after that.
    DialledPowers(u32),
    /// The robot refuses the login: somebody else uses it, or it believes in an old session.
    InUse,
    /// The dialled connection is refused or broken.
    DialFailed,
}

/// Whether the robot's system has acknowledged everything written.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Acknowledged {
    pub(super) link: bool,
    pub(super) dialled: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DebtAct {
    WriteOnLink,
    /// Close the write half of the link when everything is written, and read on.
    HalfCloseLink,
    Dial,
    LogIn,
    WriteOnDialled,
    HangUp,
    End(Outcome),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// The robot's program has answered questions that it was asked after the stop.
    Executed,
    /// The robot's system has acknowledged the stop; its program answers no questions.
    Acknowledged,
    /// There is no link any more, and no debt for which to dial.
    NothingOwed,
    GaveUp,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Link {
    None,
    FirstPower { until: Instant },
    WriteDue,
    Asked { acknowledged: Option<Instant> },
    CloseDue { limit: Duration },
    Closing { until: Instant },
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Dialling {
    /// Not yet, or never without a debt.
    Off,
    Pausing {
        until: Instant,
    },
    Connecting {
        until: Instant,
    },
    LoginDue,
    LoggingIn {
        until: Instant,
    },
    FirstPower {
        until: Instant,
    },
    WriteDue,
    Asked {
        until: Instant,
    },
    HangUpDue,
}

#[derive(Debug, Clone)]
pub(super) struct Debt {
    owed: bool,
    began: Instant,
    limit: Instant,
    link: Link,
    /// Answers on the open link, and on the dialled connection.
    link_answers: u32,
    dialled_answers: u32,
    dialling: Dialling,
    dial_from: Instant,
    outcome: Option<Outcome>,
}

impl Debt {
    /// Begins when the agent is gone. `words`: there are last words; without them nothing is owed.
    pub(super) fn begin(link: OpenLink, words: bool, owed: bool, now: Instant) -> Debt {
        let owed = owed && words;
        let link = match link {
            OpenLink::None => Link::None,
            _ if !words => Link::CloseDue {
                limit: SHORT_CLOSING_LIMIT,
            },
            OpenLink::Login => Link::FirstPower {
                until: now + FIRST_POWER_LIMIT,
            },
            OpenLink::Ready => Link::WriteDue,
            OpenLink::Written => Link::CloseDue {
                limit: CLOSING_LIMIT,
            },
        };
        let mut limit = if owed { DEBT_LIMIT } else { LINK_LIMIT };
        if matches!(link, Link::FirstPower { .. }) {
            limit += FIRST_POWER_LIMIT;
        }
        let head_start = match link {
            Link::None => Duration::ZERO,
            _ => LINK_HEAD_START,
        };
        Debt {
            owed,
            began: now,
            limit: now + limit,
            link,
            link_answers: 0,
            dialled_answers: 0,
            dialling: Dialling::Off,
            dial_from: now + head_start,
            outcome: None,
        }
    }

    pub(super) fn handle(&mut self, event: DebtEvent, now: Instant) {
        match event {
            DebtEvent::LinkPowers(0) | DebtEvent::DialledPowers(0) => {}
            DebtEvent::LinkPowers(count) => match self.link {
                Link::FirstPower { .. } => self.link = Link::WriteDue,
                Link::Asked { .. } | Link::Closing { .. } => {
                    self.link_answers += count;
                    self.end_if(self.link_answers >= QUESTIONS, Outcome::Executed);
                }
                Link::None | Link::WriteDue | Link::CloseDue { .. } => {}
            },
            DebtEvent::LinkClosed | DebtEvent::LinkBroken => {
                let read = matches!(self.link, Link::Closing { .. });
                self.end_if(
                    read && event == DebtEvent::LinkClosed,
                    Outcome::Acknowledged,
                );
                self.link = Link::None;
                self.dial_from = self.dial_from.min(now);
            }
            DebtEvent::Connected if matches!(self.dialling, Dialling::Connecting { .. }) => {
                self.dialling = Dialling::LoginDue;
            }
            DebtEvent::Accepted if matches!(self.dialling, Dialling::LoggingIn { .. }) => {
                let until = now + FIRST_POWER_LIMIT;
                self.dialling = Dialling::FirstPower { until };
            }
            DebtEvent::LoggedIn if matches!(self.dialling, Dialling::FirstPower { .. }) => {
                self.dialling = Dialling::WriteDue;
            }
            DebtEvent::DialledPowers(count) => {
                if matches!(self.dialling, Dialling::Asked { .. }) {
                    self.dialled_answers += count;
                    self.end_if(self.dialled_answers >= QUESTIONS, Outcome::Executed);
                }
            }
            DebtEvent::DialFailed => {
                if !matches!(self.dialling, Dialling::Off | Dialling::Pausing { .. }) {
                    self.dialling = Dialling::HangUpDue;
                }
            }
            DebtEvent::Connected | DebtEvent::Accepted | DebtEvent::LoggedIn | DebtEvent::InUse => {
            }
        }
    }

    fn end_if(&mut self, ended: bool, outcome: Outcome) {
        if ended {
            self.outcome.get_or_insert(outcome);
        }
    }

    /// What to do now; to be called until it returns `None`.
    pub(super) fn poll(&mut self, acknowledged: Acknowledged, now: Instant) -> Option<DebtAct> {
        let act = self
            .poll_link(acknowledged.link, now)
            .or_else(|| self.poll_dialling(acknowledged.dialled, now));
        let nothing_left = !self.owed && self.link == Link::None;
        self.end_if(nothing_left, Outcome::NothingOwed);
        self.end_if(self.limit <= now, Outcome::GaveUp);
        self.outcome.map(DebtAct::End).or(act)
    }

    fn poll_link(&mut self, acknowledged: bool, now: Instant) -> Option<DebtAct> {
        if let Link::FirstPower { until } = self.link
            && until <= now
        {
            self.link = Link::WriteDue;
        }
        match &mut self.link {
            Link::WriteDue => {
                self.link = Link::Asked { acknowledged: None };
                return Some(DebtAct::WriteOnLink);
            }
            Link::Asked { acknowledged: at } if acknowledged => {
                let at = *at.get_or_insert(now);
                if at + ANSWER_LIMIT <= now {
                    let until = now + CLOSING_LIMIT;
                    self.link = Link::Closing { until };
                    return Some(DebtAct::HalfCloseLink);
                }
            }
            Link::CloseDue { limit } => {
                let until = now + *limit;
                self.link = Link::Closing { until };
                return Some(DebtAct::HalfCloseLink);
            }
            Link::Closing { until } if *until <= now => {
                self.link = Link::None;
                self.dial_from = self.dial_from.min(now);
                self.end_if(acknowledged, Outcome::Acknowledged);
            }
            _ => {}
        }
        None
    }

    fn poll_dialling(&mut self, acknowledged: bool, now: Instant) -> Option<DebtAct> {
        match self.dialling {
            Dialling::Off if self.owed && self.dial_from <= now => self.dial(now),
            Dialling::Pausing { until } if until <= now => self.dial(now),
            Dialling::LoginDue => {
                let patient = self.began + PATIENT_AFTER <= now;
                let limit = if patient {
                    FIRST_POWER_LIMIT
                } else {
                    REPLY_LIMIT
                };
                let until = now + limit;
                self.dialling = Dialling::LoggingIn { until };
                Some(DebtAct::LogIn)
            }
            Dialling::WriteDue => {
                let until = now + ANSWER_LIMIT;
                self.dialling = Dialling::Asked { until };
                self.dialled_answers = 0;
                Some(DebtAct::WriteOnDialled)
            }
            Dialling::Asked { until } if until <= now && acknowledged => {
                self.end_if(true, Outcome::Acknowledged);
                None
            }
            Dialling::Connecting { until }
            | Dialling::LoggingIn { until }
            | Dialling::FirstPower { until }
            | Dialling::Asked { until }
                if until <= now =>
            {
                self.hang_up(now)
            }
            Dialling::HangUpDue => self.hang_up(now),
            _ => None,
        }
    }

    fn dial(&mut self, now: Instant) -> Option<DebtAct> {
        let until = now + CONNECT_LIMIT;
        self.dialling = Dialling::Connecting { until };
        self.dial_from = now;
        Some(DebtAct::Dial)
    }

    fn hang_up(&mut self, now: Instant) -> Option<DebtAct> {
        let until = now.max(self.dial_from + DIAL_EVERY);
        self.dialling = Dialling::Pausing { until };
        Some(DebtAct::HangUp)
    }

    /// When [`Debt::poll`] has something to do, but for acknowledgements.
    pub(super) fn next_deadline(&self) -> Instant {
        let link = match self.link {
            Link::FirstPower { until } | Link::Closing { until } => until,
            Link::Asked { acknowledged } => acknowledged.map_or(self.limit, |at| at + ANSWER_LIMIT),
            Link::None | Link::WriteDue | Link::CloseDue { .. } => self.limit,
        };
        let dialling = match self.dialling {
            Dialling::Off if self.owed => self.dial_from,
            Dialling::Pausing { until }
            | Dialling::Connecting { until }
            | Dialling::LoggingIn { until }
            | Dialling::FirstPower { until }
            | Dialling::Asked { until } => until,
            _ => self.limit,
        };
        self.limit.min(link).min(dialling)
    }

    /// Whether the robot has accepted a login whose first POWER is still to come on the open link.
    pub(super) fn waits_for_first_power(&self) -> bool {
        matches!(self.link, Link::FirstPower { .. })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{HashSet, VecDeque};

    use super::*;

    const NOT_YET: Acknowledged = Acknowledged {
        link: false,
        dialled: false,
    };
    const ALL: Acknowledged = Acknowledged {
        link: true,
        dialled: true,
    };

    /// All that is to do now.
    fn acts(debt: &mut Debt, acknowledged: Acknowledged, now: Instant) -> Vec<DebtAct> {
        let mut acts = Vec::new();
        while let Some(act) = debt.poll(acknowledged, now) {
            acts.push(act);
            if matches!(act, DebtAct::End(_)) {
                break;
            }
        }
        acts
    }

    #[test]
    fn on_an_open_link_two_answers_after_the_write_pay() {
        let now = Instant::now();
        let mut debt = Debt::begin(OpenLink::Ready, true, true, now);
        assert_eq!(acts(&mut debt, NOT_YET, now), [DebtAct::WriteOnLink]);
        debt.handle(DebtEvent::LinkPowers(1), now);
        assert_eq!(acts(&mut debt, ALL, now), []);
        debt.handle(DebtEvent::LinkPowers(1), now);
        let executed = [DebtAct::End(Outcome::Executed)];
        assert_eq!(acts(&mut debt, ALL, now), executed);
    }

    #[test]
    fn a_login_in_progress_is_written_to_after_its_first_power() {
        let now = Instant::now();
        let mut debt = Debt::begin(OpenLink::Login, true, false, now);
        assert_eq!(acts(&mut debt, ALL, now), []);
        debt.handle(DebtEvent::LinkPowers(1), now);
        assert_eq!(acts(&mut debt, ALL, now), [DebtAct::WriteOnLink]);
    }

    #[test]
    fn a_silent_link_is_dialled_beside_and_a_broken_one_at_once() {
        let now = Instant::now();
        let mut silent = Debt::begin(OpenLink::Ready, true, true, now);
        let mut broken = silent.clone();
        acts(&mut silent, NOT_YET, now);
        assert_eq!(silent.next_deadline(), now + LINK_HEAD_START);
        let later = now + LINK_HEAD_START;
        assert_eq!(acts(&mut silent, NOT_YET, later), [DebtAct::Dial]);
        broken.handle(DebtEvent::LinkBroken, now);
        assert_eq!(acts(&mut broken, NOT_YET, now), [DebtAct::Dial]);
    }

    #[test]
    fn a_refused_login_is_tried_again_half_a_second_after_the_last() {
        let now = Instant::now();
        let mut debt = Debt::begin(OpenLink::None, true, true, now);
        assert_eq!(acts(&mut debt, NOT_YET, now), [DebtAct::Dial]);
        debt.handle(DebtEvent::Connected, now);
        assert_eq!(acts(&mut debt, NOT_YET, now), [DebtAct::LogIn]);
        debt.handle(DebtEvent::DialFailed, now);
        assert_eq!(acts(&mut debt, NOT_YET, now), [DebtAct::HangUp]);
        assert_eq!(debt.next_deadline(), now + DIAL_EVERY);
        let again = acts(&mut debt, NOT_YET, now + DIAL_EVERY);
        assert_eq!(again, [DebtAct::Dial]);
    }

    #[test]
    fn a_robot_that_answers_no_question_counts_as_paid_once_it_has_acknowledged() {
        let mut now = Instant::now();
        let mut debt = Debt::begin(OpenLink::None, true, true, now);
        acts(&mut debt, NOT_YET, now);
        debt.handle(DebtEvent::Connected, now);
        acts(&mut debt, NOT_YET, now);
        debt.handle(DebtEvent::Accepted, now);
        debt.handle(DebtEvent::LoggedIn, now);
        assert_eq!(acts(&mut debt, NOT_YET, now), [DebtAct::WriteOnDialled]);
        let mut unreached = debt.clone();
        now += ANSWER_LIMIT;
        let acknowledged = [DebtAct::End(Outcome::Acknowledged)];
        assert_eq!(acts(&mut debt, ALL, now), acknowledged);
        let again = [DebtAct::HangUp, DebtAct::Dial];
        assert_eq!(acts(&mut unreached, NOT_YET, now), again);
    }

    #[test]
    fn without_last_words_or_a_debt_nobody_dials() {
        let now = Instant::now();
        for (words, owed) in [(false, true), (true, false)] {
            let mut debt = Debt::begin(OpenLink::None, words, owed, now);
            let nothing = [DebtAct::End(Outcome::NothingOwed)];
            assert_eq!(acts(&mut debt, NOT_YET, now), nothing);
        }
    }

    /// The state, with times counted from now.
    fn key(debt: &Debt, now: Instant) -> String {
        let left = |until: Instant| until.saturating_duration_since(now).as_millis();
        let link = match debt.link {
            Link::FirstPower { until } | Link::Closing { until } => left(until),
            Link::Asked { acknowledged } => acknowledged.map_or(0, |at| left(at + ANSWER_LIMIT)),
            _ => 0,
        };
        let dialling = match debt.dialling {
            Dialling::Pausing { until }
            | Dialling::Connecting { until }
            | Dialling::LoggingIn { until }
            | Dialling::FirstPower { until }
            | Dialling::Asked { until } => left(until),
            _ => 0,
        };
        let states = (
            std::mem::discriminant(&debt.link),
            std::mem::discriminant(&debt.dialling),
        );
        let from = left(debt.dial_from + DIAL_EVERY);
        let answers = (debt.link_answers.min(2), debt.dialled_answers.min(2));
        format!("{states:?} {link} {dialling} {from} {answers:?}")
    }

    /// Left alone from here, somebody dials, or the debt is paid, within this time: the longest
    /// login, and what comes before and after it.
    const SOON: Duration = Duration::from_secs(14);

    fn is_pursued(mut debt: Debt, mut now: Instant) -> bool {
        let until = now + SOON;
        while now <= until {
            let acts = acts(&mut debt, NOT_YET, now);
            let pursues = |act: &DebtAct| {
                matches!(
                    act,
                    DebtAct::Dial
                        | DebtAct::End(Outcome::Executed | Outcome::Acknowledged | Outcome::GaveUp)
                )
            };
            if acts.iter().any(pursues) {
                return true;
            }
            now = debt.next_deadline().max(now + Duration::from_millis(1));
        }
        false
    }

    #[test]
    fn a_debt_implies_that_somebody_dials_in_every_state() {
        let start = Instant::now();
        let links = [
            OpenLink::None,
            OpenLink::Login,
            OpenLink::Ready,
            OpenLink::Written,
        ];
        let begin = |link| (Debt::begin(link, true, true, start), start);
        let mut open: VecDeque<(Debt, Instant)> = links.into_iter().map(begin).collect();
        let mut seen = HashSet::new();
        let events = [
            DebtEvent::LinkPowers(1),
            DebtEvent::LinkClosed,
            DebtEvent::LinkBroken,
            DebtEvent::Connected,
            DebtEvent::Accepted,
            DebtEvent::LoggedIn,
            DebtEvent::DialledPowers(1),
            DebtEvent::DialFailed,
        ];
        while let Some((debt, now)) = open.pop_front() {
            if !seen.insert(key(&debt, now)) || seen.len() > 20_000 {
                continue;
            }
            assert!(is_pursued(debt.clone(), now), "{debt:?} at {now:?}");
            let mut follow = |mut debt: Debt, acknowledged, now| {
                let acts = acts(&mut debt, acknowledged, now);
                match acts.last() {
                    Some(DebtAct::End(outcome)) => {
                        let paid = [Outcome::Executed, Outcome::Acknowledged];
                        assert!(paid.contains(outcome), "{outcome:?} in {debt:?}");
                    }
                    _ => open.push_back((debt, now)),
                }
            };
            for acknowledged in [NOT_YET, ALL] {
                let due = debt.next_deadline();
                follow(debt.clone(), acknowledged, now);
                follow(debt.clone(), acknowledged, due.max(now));
                for event in events {
                    let mut next = debt.clone();
                    next.handle(event, now);
                    follow(next, acknowledged, now);
                }
            }
        }
        assert!(seen.len() > 100, "{} states", seen.len());
        println!("{} states", seen.len());
    }

    #[test]
    fn a_debt_that_cannot_be_paid_ends_after_ten_minutes() {
        let start = Instant::now();
        let mut debt = Debt::begin(OpenLink::None, true, true, start);
        let mut now = start;
        let mut dialled = 0;
        loop {
            let acts = acts(&mut debt, NOT_YET, now);
            dialled += acts.iter().filter(|act| **act == DebtAct::Dial).count();
            if acts.contains(&DebtAct::End(Outcome::GaveUp)) {
                break;
            }
            now = debt.next_deadline();
        }
        assert_eq!(now - start, DEBT_LIMIT);
        assert!(dialled >= 500, "{dialled}");
    }
}
