//! A person's STOP: while it is on, no command that moves the robot is sent, not even when the
//! watchdog would send a robot with a low battery home. It stays on until a person releases it,
//! across lost links: each login repeats it. It also applies to the last words.

use std::time::Duration;

use tokio::time::Instant;
use tracing::warn;

use super::Pilot;
use super::lost::LinkLost;
use crate::safety::Fact;
use crate::wire::{Command, Engage};

/// The commands that begin it: the tracks stop, and a search ends.
const STOP: [Command; 2] = [Command::STOP, Command::Engine(Engage::CancelDock)];
/// The shortest interval between repeated STOPs that are sent.
const AGAIN: Duration = Duration::from_millis(200);

/// The state of a person's STOP; see the module.
#[derive(Debug, Default)]
pub(super) struct Halt {
    on: bool,
    /// When it was last sent.
    last_sent: Option<Instant>,
}

impl Halt {
    pub(super) fn is_on(&self) -> bool {
        self.on
    }
}

impl Pilot {
    /// Sets or releases it.
    pub(super) fn halt(&mut self, on: bool) -> Result<(), LinkLost> {
        let was = std::mem::replace(&mut self.halt.on, on);
        match (was, on) {
            (false, true) => {
                warn!("stopped by a person: nothing moves the robot until a person releases it");
                self.send_halt()
            }
            (true, true) => {
                let lately = |at: Instant| at.elapsed() < AGAIN;
                if self.halt.last_sent.is_some_and(lately) {
                    return Ok(());
                }
                self.send_halt()
            }
            (true, false) => {
                warn!("released by a person: the robot may move again");
                // The robot's state differs from what the watchdog assumes: the watchdog starts
                // over, with a stop.
                self.take(Fact::Suspended)
            }
            (false, false) => Ok(()),
        }
    }

    /// Sends it again if it is on: the robot may not have received it over an earlier link.
    pub(super) fn repeat_halt(&mut self) -> Result<(), LinkLost> {
        if self.halt.on {
            self.send_halt()
        } else {
            Ok(())
        }
    }

    fn send_halt(&mut self) -> Result<(), LinkLost> {
        self.halt.last_sent = Some(Instant::now());
        self.send(&STOP)
    }

    /// The commands to send instead of these.
    pub(super) fn replace_while_halted(&self, commands: &[Command]) -> Vec<Command> {
        if self.halt.on {
            commands.iter().filter_map(while_halted).collect()
        } else {
            commands.to_vec()
        }
    }
}

/// What is sent instead of a command while the STOP is on: a stop for each MOVE, the end of a search
/// for its begin, and nothing for an undocking.
fn while_halted(command: &Command) -> Option<Command> {
    match command {
        Command::Move { .. } => Some(Command::STOP),
        Command::Engine(Engage::Dock) => Some(Command::Engine(Engage::CancelDock)),
        Command::Engine(Engage::Undock) => None,
        other => Some(other.clone()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::safety::LastWords;

    /// The robot may not have received the STOP, and a stop of the tracks alone may not end a
    /// search.
    #[test]
    fn last_words_that_would_begin_a_search_end_it() {
        let sent = LastWords::StopAndDock.commands();
        let sent: Vec<Command> = sent.iter().filter_map(while_halted).collect();
        assert_eq!(sent, STOP);
    }
}
