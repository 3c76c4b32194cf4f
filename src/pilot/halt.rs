//! A person's STOP: while it holds, nothing that moves the robot goes out, whoever wants it, a watchdog
//! that sends a robot with a low battery home included. It holds until a person lets go, through lost
//! links and to the last word.

use tracing::warn;

use super::Pilot;
use super::lost::LinkLost;
use crate::safety::Fact;
use crate::wire::{Command, Engage};

/// What is said when it begins: the tracks rest, and a search ends.
const STOP: [Command; 2] = [Command::STOP, Command::Engine(Engage::CancelDock)];

impl Pilot {
    /// Begins it, or lets go.
    pub(super) fn halt(&mut self, on: bool) -> Result<(), LinkLost> {
        if on {
            if !self.halted {
                warn!("stopped by a person: nothing moves the robot until a person lets go");
            }
            self.halted = true;
            return self.send(&STOP);
        }
        if std::mem::take(&mut self.halted) {
            warn!("a person lets go: the robot may move again");
            // What the watchdog believes was never said: it begins anew, with a stop.
            return self.take(Fact::Suspended);
        }
        Ok(())
    }

    /// What of some commands may go out.
    pub(super) fn held(&self, commands: &[Command]) -> Vec<Command> {
        let still = |command: &Command| match command {
            Command::Move { .. } => Some(Command::STOP),
            Command::Engine(Engage::Dock | Engage::Undock) => None,
            other => Some(other.clone()),
        };
        match self.halted {
            true => commands.iter().filter_map(still).collect(),
            false => commands.to_vec(),
        }
    }
}
