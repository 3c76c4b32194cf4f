//! A stop that is owed: from the first byte of a command that may move the robot until its program
//! has executed a later stop. While it is owed, somebody keeps dialling: the agent while it lives,
//! the guardian after it. Pure: reads no clock.

use std::time::Duration;

use tokio::time::Instant;

use crate::link::Confirmation;
use crate::robot::StopConfirmation;
use crate::wire::{Command, Engage};

/// How long the robot stands before it is asked whether it has executed the stop: a behaviour that
/// stops often drives on sooner, and each question takes a slow robot's time.
const ASK_AFTER: Duration = Duration::from_millis(500);
/// How long a robot stands by itself before it is sent a stop.
const STOP_AFTER: Duration = Duration::from_secs(1);
/// A stop that is not confirmed for this long counts as not confirmed, until it is.
const NOT_CONFIRMED_AFTER: Duration = Duration::from_secs(2);
/// How often to check whether it is confirmed.
const RECHECK: Duration = Duration::from_millis(50);

fn stops(command: &Command) -> bool {
    matches!(
        command,
        Command::Move { left: 0, right: 0 } | Command::Engine(Engage::CancelDock)
    )
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Nothing may move.
    Paid,
    /// The robot may be moving, and no stop was sent since; since when it is believed to stand.
    Moving { still_since: Option<Instant> },
    /// A stop was sent.
    Stopped { at: Instant, ask_at: Instant },
    /// The robot was asked whether it has executed the stop.
    Asked { stopped: Instant, at: Instant },
}

/// The state of the debt.
#[derive(Debug, Clone)]
pub(super) struct Debt {
    stage: Stage,
    /// How the last one was paid.
    paid: StopConfirmation,
}

impl Default for Debt {
    fn default() -> Debt {
        Debt {
            stage: Stage::Paid,
            paid: StopConfirmation::None,
        }
    }
}

/// What to do about it now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum DebtAction {
    /// Ask the robot's program whether it has executed the stop.
    Ask,
    /// Send a stop: the robot stands by itself, as after it has left its station.
    Stop,
    /// A stop was executed, or acknowledged by a robot that does not say more.
    Paid(StopConfirmation),
}

impl Debt {
    /// Whether a stop is owed: the robot may be moving.
    pub(super) fn is_owed(&self) -> bool {
        self.stage != Stage::Paid
    }

    /// Whether the robot was asked, so that a [`Confirmation`] counts.
    pub(super) fn is_asked(&self) -> bool {
        matches!(self.stage, Stage::Asked { .. })
    }

    /// Handles commands that are about to be written.
    pub(super) fn handle(&mut self, commands: &[Command], now: Instant) {
        let last = commands
            .iter()
            .rfind(|command| matches!(command, Command::Move { .. } | Command::Engine(_)));
        match last {
            Some(last) if stops(last) => self.stopped(now, ASK_AFTER),
            Some(_) => {
                self.stage = Stage::Moving { still_since: None };
                self.paid = StopConfirmation::None;
            }
            None => {}
        }
    }

    /// A stop that matters: its execution is asked for at once.
    pub(super) fn ask_at_once(&mut self, now: Instant) {
        self.stopped(now, Duration::ZERO);
    }

    fn stopped(&mut self, now: Instant, ask_after: Duration) {
        let ask_at = now + ask_after;
        self.stage = match self.stage {
            Stage::Paid if !ask_after.is_zero() => return,
            Stage::Paid | Stage::Moving { .. } => Stage::Stopped { at: now, ask_at },
            Stage::Stopped { at, ask_at: due } => Stage::Stopped {
                at,
                ask_at: due.min(ask_at),
            },
            Stage::Asked { stopped, .. } if ask_after.is_zero() => Stage::Stopped {
                at: stopped,
                ask_at,
            },
            asked @ Stage::Asked { .. } => asked,
        };
    }

    /// The robot is known to stand, on its station.
    pub(super) fn forgive(&mut self) {
        self.stage = Stage::Paid;
    }

    /// Handles a lost link: what was on its way may be lost, so the next login's stop counts.
    pub(super) fn link_lost(&mut self) {
        if self.is_owed() {
            self.stage = Stage::Moving { still_since: None };
        }
    }

    /// Advances the time; the link is up. `moving`: the robot is believed to move; `confirmation` is
    /// that of the last question.
    pub(super) fn poll(
        &mut self,
        moving: bool,
        confirmation: Confirmation,
        now: Instant,
    ) -> Option<DebtAction> {
        match self.stage {
            Stage::Moving { still_since } if !moving => {
                let since = still_since.unwrap_or(now);
                self.stage = Stage::Moving {
                    still_since: Some(since),
                };
                (now >= since + STOP_AFTER).then_some(DebtAction::Stop)
            }
            Stage::Moving { .. } => {
                self.stage = Stage::Moving { still_since: None };
                None
            }
            Stage::Stopped { at, ask_at } if ask_at <= now => {
                self.stage = Stage::Asked {
                    stopped: at,
                    at: now,
                };
                Some(DebtAction::Ask)
            }
            Stage::Asked { stopped, at } => {
                self.paid = match confirmation {
                    Confirmation::Executed => StopConfirmation::Executed,
                    Confirmation::Acknowledged => StopConfirmation::Acknowledged,
                    Confirmation::NotYet | Confirmation::Received => StopConfirmation::None,
                };
                if self.paid != StopConfirmation::None {
                    self.stage = Stage::Paid;
                    return Some(DebtAction::Paid(self.paid));
                }
                // The robot may be one that answers another question, or none.
                if now < at + NOT_CONFIRMED_AFTER {
                    return None;
                }
                self.stage = Stage::Asked { stopped, at: now };
                Some(DebtAction::Ask)
            }
            _ => None,
        }
    }

    /// When [`Debt::poll`] has something to do, besides at each answer of the robot.
    pub(super) fn next_deadline(&self, now: Instant) -> Option<Instant> {
        match self.stage {
            Stage::Stopped { ask_at, .. } => Some(ask_at),
            Stage::Asked { .. } => Some(now + RECHECK),
            Stage::Moving { still_since } => Some(still_since? + STOP_AFTER),
            Stage::Paid => None,
        }
    }

    /// What is known of the last stop; `online`: the link is up.
    pub(super) fn confirmation(&self, online: bool, now: Instant) -> StopConfirmation {
        let late = |since: Instant| now >= since + NOT_CONFIRMED_AFTER;
        match self.stage {
            Stage::Paid => self.paid,
            Stage::Moving { .. } if online => StopConfirmation::None,
            Stage::Stopped { at: since, .. } | Stage::Asked { stopped: since, .. }
                if online && !late(since) =>
            {
                StopConfirmation::Sending
            }
            Stage::Moving { .. } | Stage::Stopped { .. } | Stage::Asked { .. } => {
                StopConfirmation::NotConfirmed
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    const DOCK: Command = Command::Engine(Engage::Dock);
    const GO: Command = Command::Move {
        left: 20,
        right: 20,
    };
    const ASK: Option<DebtAction> = Some(DebtAction::Ask);

    #[test]
    fn a_stop_is_owed_from_the_first_motion_until_a_later_stop_is_executed() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[Command::STOP], now);
        assert!(!debt.is_owed());
        debt.handle(&[GO], now);
        assert!(debt.is_owed());
        assert_eq!(debt.poll(true, Confirmation::Executed, now), None);
        debt.handle(&[Command::STOP], now);
        assert_eq!(
            debt.poll(true, Confirmation::Executed, now),
            None,
            "asks later"
        );
        let later = now + ASK_AFTER;
        assert_eq!(debt.poll(true, Confirmation::Executed, later), ASK);
        assert_eq!(debt.poll(true, Confirmation::NotYet, later), None);
        assert_eq!(debt.confirmation(true, later), StopConfirmation::Sending);
        let paid = Some(DebtAction::Paid(StopConfirmation::Executed));
        assert_eq!(debt.poll(true, Confirmation::Executed, later), paid);
        assert!(!debt.is_owed());
        assert_eq!(debt.confirmation(true, later), StopConfirmation::Executed);
    }

    #[test]
    fn motion_after_the_question_is_owed_a_stop_of_its_own() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[GO], now);
        debt.ask_at_once(now);
        assert_eq!(debt.poll(true, Confirmation::NotYet, now), ASK);
        debt.handle(&[Command::STOP, Command::Engine(Engage::Dock)], now);
        assert_eq!(debt.poll(true, Confirmation::Executed, now), None);
        assert!(debt.is_owed());
    }

    #[test]
    fn a_robot_that_answers_nothing_is_paid_when_its_system_has_acknowledged_it() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[GO], now);
        debt.ask_at_once(now);
        let received = Confirmation::Received;
        assert_eq!(debt.poll(true, received, now), ASK);
        assert_eq!(debt.poll(true, received, now), None);
        let due = debt.next_deadline(now).unwrap();
        let paid = Some(DebtAction::Paid(StopConfirmation::Acknowledged));
        assert_eq!(debt.poll(true, Confirmation::Acknowledged, due), paid);
    }

    #[test]
    fn a_robot_that_stands_by_itself_is_sent_a_stop_after_a_while() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[Command::Engine(Engage::Undock)], now);
        let unknown = Confirmation::NotYet;
        assert_eq!(debt.poll(true, unknown, now), None);
        assert_eq!(debt.poll(false, unknown, now), None);
        let due = debt.next_deadline(now).unwrap();
        assert_eq!(due, now + STOP_AFTER);
        assert_eq!(debt.poll(false, unknown, due), Some(DebtAction::Stop));
        debt.handle(&[Command::STOP], due);
        let later = due + ASK_AFTER;
        assert_eq!(debt.poll(false, unknown, later), ASK);
    }

    #[test]
    fn a_lost_link_leaves_the_debt_and_the_stop_unconfirmed() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[GO], now);
        debt.ask_at_once(now);
        debt.link_lost();
        assert!(debt.is_owed());
        assert_eq!(
            debt.confirmation(false, now),
            StopConfirmation::NotConfirmed
        );
        debt.forgive();
        assert!(!debt.is_owed());
    }

    /// A run with its debt, and what the guardian has been told. The guardian's own exploration
    /// (`guardian/debt.rs`) shows that one that knows of a debt dials.
    #[derive(Debug, Clone)]
    struct Joint {
        run: Run,
        link: Link,
        released: bool,
        stop: bool,
        low: bool,
        debt: Debt,
        /// Whether it knows that a stop is owed; `None`: it is being replaced.
        guardian: Option<bool>,
    }

    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
    enum Run {
        Alive,
        Ending,
        Over,
    }

    #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
    enum Link {
        Up,
        Pausing,
        Dialling,
    }

    #[derive(Debug, Clone, Copy)]
    enum Happens {
        Drives,
        Stands,
        Asks,
        Answers,
        LinkLost,
        PauseOver,
        LoginFails,
        LoggedIn,
        Release,
        Connect,
        Stop,
        Reset,
        Low,
        Charges,
        GuardianDies,
        GuardianStarts,
        Ends,
        TimeOver,
        Killed,
    }

    const HAPPENS: [Happens; 19] = [
        Happens::Drives,
        Happens::Stands,
        Happens::Asks,
        Happens::Answers,
        Happens::LinkLost,
        Happens::PauseOver,
        Happens::LoginFails,
        Happens::LoggedIn,
        Happens::Release,
        Happens::Connect,
        Happens::Stop,
        Happens::Reset,
        Happens::Low,
        Happens::Charges,
        Happens::GuardianDies,
        Happens::GuardianStarts,
        Happens::Ends,
        Happens::TimeOver,
        Happens::Killed,
    ];

    impl Joint {
        fn begin() -> Joint {
            Joint {
                run: Run::Alive,
                link: Link::Dialling,
                released: false,
                stop: false,
                low: false,
                debt: Debt::default(),
                guardian: Some(false),
            }
        }

        fn key(&self) -> impl Eq + std::hash::Hash + use<> {
            let stage = std::mem::discriminant(&self.debt.stage);
            let run = (self.run, self.link, self.released, self.stop, self.low);
            (run, stage, self.guardian)
        }

        fn send(&mut self, commands: &[Command], now: Instant) {
            if self.link == Link::Up {
                self.debt.handle(commands, now);
            }
        }

        /// The state after this; the same if it cannot happen.
        fn after(&self, happens: Happens, now: Instant) -> Joint {
            let mut next = self.clone();
            let up = self.link == Link::Up;
            let alive = self.run == Run::Alive;
            match happens {
                _ if self.run == Run::Over => {}
                Happens::Drives if alive && !self.stop && self.guardian.is_some() => {
                    next.send(&[if self.low { DOCK } else { GO }], now);
                }
                Happens::Stands => next.send(&[Command::STOP], now),
                Happens::Asks | Happens::Answers if up => {
                    let confirmation = match happens {
                        Happens::Answers => Confirmation::Executed,
                        _ => Confirmation::NotYet,
                    };
                    next.debt.poll(false, Confirmation::NotYet, now);
                    let later = now + Duration::from_secs(3);
                    if next.debt.poll(false, confirmation, later) == Some(DebtAction::Stop) {
                        next.send(&[Command::STOP], now);
                    }
                }
                Happens::LinkLost if up => {
                    next.link = Link::Pausing;
                    next.debt.link_lost();
                }
                Happens::PauseOver if self.link == Link::Pausing && !self.released => {
                    next.link = Link::Dialling;
                }
                Happens::LoginFails if self.link == Link::Dialling => next.link = Link::Pausing,
                Happens::LoggedIn if self.link == Link::Dialling => {
                    next.link = Link::Up;
                    next.send(&[Command::STOP], now);
                }
                Happens::Release if up && alive && !self.low && !self.debt.is_owed() => {
                    next.released = true;
                    next.link = Link::Pausing;
                }
                Happens::Connect => next.released = false,
                Happens::Stop => {
                    next.stop = true;
                    next.send(&[Command::STOP], now);
                    if up {
                        next.debt.ask_at_once(now);
                    }
                }
                Happens::Reset => next.stop = false,
                Happens::Low => next.low = true,
                Happens::Charges => next.low = false,
                Happens::GuardianDies => {
                    next.guardian = None;
                    next.send(&[Command::STOP], now);
                }
                Happens::GuardianStarts => next.guardian = Some(false),
                Happens::Ends if alive => {
                    next.run = Run::Ending;
                    next.send(&[Command::STOP], now);
                }
                // Without a guardian both are a second fault.
                Happens::TimeOver if self.run == Run::Ending && self.guardian.is_some() => {
                    next.run = Run::Over;
                }
                Happens::Killed if self.guardian.is_some() => next.run = Run::Over,
                _ => {}
            }
            // The pilot tells it each change before the first byte is written.
            if self.run != Run::Over && next.guardian.is_some() {
                next.guardian = Some(next.debt.is_owed());
            }
            next
        }

        /// Whether a debt implies that somebody dials, or that a stop can be sent on the link.
        fn is_pursued(&self) -> bool {
            !self.debt.is_owed()
                || match self.run {
                    Run::Alive | Run::Ending => self.link == Link::Up || !self.released,
                    Run::Over => self.guardian == Some(true),
                }
        }
    }

    #[test]
    fn a_debt_implies_that_somebody_dials_in_every_joint_state() {
        let now = Instant::now();
        let mut open = vec![Joint::begin()];
        let mut seen = HashSet::new();
        let mut owed_at_the_end = 0;
        while let Some(joint) = open.pop() {
            if !seen.insert(joint.key()) {
                continue;
            }
            assert!(joint.is_pursued(), "{joint:?}");
            owed_at_the_end += u32::from(joint.run == Run::Over && joint.debt.is_owed());
            open.extend(HAPPENS.map(|happens| joint.after(happens, now)));
        }
        assert!(seen.len() > 100, "{} states", seen.len());
        assert!(owed_at_the_end > 10, "{owed_at_the_end}");
    }
}
