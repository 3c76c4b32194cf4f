//! A stop that is owed: from the first byte of a command that may move the robot until its program
//! has executed a later stop. While it is owed, somebody keeps dialling: the agent while it lives,
//! the guardian after it. Pure: reads no clock.

use std::time::Duration;

use tokio::time::Instant;

use crate::link::Executes;
use crate::robot::StopConfirmation;
use crate::wire::{Command, Engage};

/// How long the robot stands before it is asked whether it has executed the stop: a behaviour that
/// stops often may drive on at once.
const ASK_AFTER: Duration = Duration::from_millis(100);
/// How long a robot stands by itself before it is sent a stop.
const STOP_AFTER: Duration = Duration::from_secs(1);
/// A stop that is not confirmed for this long counts as not confirmed, until it is.
const NOT_CONFIRMED_AFTER: Duration = Duration::from_secs(2);
/// How long the program of a robot that answers no question may take for what its system has
/// acknowledged.
const UNSEEN_EXECUTION: Duration = Duration::from_secs(1);
/// How often to check whether its system has acknowledged it.
const RECHECK: Duration = Duration::from_millis(50);

/// What a batch of commands does to the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Effect {
    Motion,
    Stop,
}

fn effect(command: &Command) -> Option<Effect> {
    match command {
        Command::Move { left: 0, right: 0 } | Command::Engine(Engage::CancelDock) => {
            Some(Effect::Stop)
        }
        Command::Move { .. } | Command::Engine(_) => Some(Effect::Motion),
        _ => None,
    }
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
#[derive(Debug)]
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

/// What the watchdog believes of the robot, and the link knows of the last question.
#[derive(Debug, Clone, Copy)]
pub(super) struct Answered {
    /// The robot moves.
    pub(super) moving: bool,
    pub(super) executes: Executes,
    /// Its answer has come.
    pub(super) executed: bool,
    /// The robot's system has acknowledged everything.
    pub(super) acknowledged: bool,
}

impl Debt {
    /// Whether a stop is owed: the robot may be moving.
    pub(super) fn is_owed(&self) -> bool {
        self.stage != Stage::Paid
    }

    /// Handles commands that are about to be written.
    pub(super) fn handle(&mut self, commands: &[Command], now: Instant) {
        match commands.iter().filter_map(effect).next_back() {
            Some(Effect::Motion) => {
                self.stage = Stage::Moving { still_since: None };
                self.paid = StopConfirmation::None;
            }
            Some(Effect::Stop) => self.stopped(now, ASK_AFTER),
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

    /// Advances the time; the link is up.
    pub(super) fn poll(&mut self, answered: Answered, now: Instant) -> Option<DebtAction> {
        match self.stage {
            Stage::Moving { still_since } if !answered.moving => {
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
                let unseen = answered.executes == Executes::NoAnswer
                    && answered.acknowledged
                    && now >= at + UNSEEN_EXECUTION;
                if answered.executed || unseen {
                    self.stage = Stage::Paid;
                    self.paid = if answered.executed {
                        StopConfirmation::Executed
                    } else {
                        StopConfirmation::Acknowledged
                    };
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
    pub(super) fn next_deadline(&self, executes: Executes, now: Instant) -> Option<Instant> {
        match self.stage {
            Stage::Stopped { ask_at, .. } => Some(ask_at),
            Stage::Asked { at, .. } if executes == Executes::NoAnswer => {
                Some((at + UNSEEN_EXECUTION).max(now + RECHECK))
            }
            Stage::Asked { at, .. } => Some((at + NOT_CONFIRMED_AFTER).max(now + RECHECK)),
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
    use super::*;

    const GO: Command = Command::Move {
        left: 20,
        right: 20,
    };
    const EXECUTES: Executes = Executes::Every(Duration::from_millis(1));

    fn answered(executes: Executes, executed: bool) -> Answered {
        Answered {
            moving: true,
            executes,
            executed,
            acknowledged: true,
        }
    }

    #[test]
    fn a_stop_is_owed_from_the_first_motion_until_a_later_stop_is_executed() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[Command::STOP], now);
        assert!(!debt.is_owed());
        debt.handle(&[GO], now);
        assert!(debt.is_owed());
        assert_eq!(debt.poll(answered(EXECUTES, true), now), None);
        debt.handle(&[Command::STOP], now);
        assert_eq!(debt.poll(answered(EXECUTES, true), now), None, "asks later");
        let later = now + ASK_AFTER;
        assert_eq!(
            debt.poll(answered(EXECUTES, true), later),
            Some(DebtAction::Ask)
        );
        assert_eq!(debt.poll(answered(EXECUTES, false), later), None);
        assert_eq!(debt.confirmation(true, later), StopConfirmation::Sending);
        let paid = Some(DebtAction::Paid(StopConfirmation::Executed));
        assert_eq!(debt.poll(answered(EXECUTES, true), later), paid);
        assert!(!debt.is_owed());
        assert_eq!(debt.confirmation(true, later), StopConfirmation::Executed);
    }

    #[test]
    fn motion_after_the_question_is_owed_a_stop_of_its_own() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[GO], now);
        debt.ask_at_once(now);
        assert_eq!(
            debt.poll(answered(EXECUTES, false), now),
            Some(DebtAction::Ask)
        );
        debt.handle(&[Command::STOP, Command::Engine(Engage::Dock)], now);
        assert_eq!(debt.poll(answered(EXECUTES, true), now), None);
        assert!(debt.is_owed());
    }

    #[test]
    fn a_robot_that_answers_nothing_is_paid_when_its_system_has_acknowledged_it() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[GO], now);
        debt.ask_at_once(now);
        let silent = answered(Executes::NoAnswer, false);
        assert_eq!(debt.poll(silent, now), Some(DebtAction::Ask));
        assert_eq!(debt.poll(silent, now), None);
        let due = debt.next_deadline(Executes::NoAnswer, now).unwrap();
        let paid = Some(DebtAction::Paid(StopConfirmation::Acknowledged));
        assert_eq!(debt.poll(silent, due), paid);
    }

    #[test]
    fn a_robot_that_stands_by_itself_is_sent_a_stop_after_a_while() {
        let mut debt = Debt::default();
        let now = Instant::now();
        debt.handle(&[Command::Engine(Engage::Undock)], now);
        let leaves = answered(EXECUTES, false);
        assert_eq!(debt.poll(leaves, now), None);
        let stands = Answered {
            moving: false,
            ..leaves
        };
        assert_eq!(debt.poll(stands, now), None);
        let due = debt.next_deadline(EXECUTES, now).unwrap();
        assert_eq!(due, now + STOP_AFTER);
        assert_eq!(debt.poll(stands, due), Some(DebtAction::Stop));
        debt.handle(&[Command::STOP], due);
        assert_eq!(debt.poll(stands, due + ASK_AFTER), Some(DebtAction::Ask));
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
}
