//! A person's STOP: while it holds, nothing that moves the robot goes out, even for a watchdog
//! that sends a robot with a low battery home included. It holds until a person lets go, through lost
//! links and to the last word.

use std::time::Duration;

use tokio::time::Instant;
use tracing::warn;

use super::Pilot;
use super::lost::LinkLost;
use crate::safety::Fact;
use crate::wire::{Command, Engage};

/// What is said when it begins: the tracks rest, and a search ends.
const STOP: [Command; 2] = [Command::STOP, Command::Engine(Engage::CancelDock)];
/// Who says STOP again and again is heard so often.
const AGAIN: Duration = Duration::from_millis(200);

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Halt {
    on: bool,
    /// When it was said last.
    said: Option<Instant>,
}

impl Halt {
    pub(super) fn is_on(&self) -> bool {
        self.on
    }
}

impl Pilot {
    /// Begins it, or lets go.
    pub(super) fn halt(&mut self, on: bool) -> Result<(), LinkLost> {
        let was = std::mem::replace(&mut self.halt.on, on);
        match (was, on) {
            (false, true) => {
                warn!("stopped by a person: nothing moves the robot until a person releases it");
                self.say_halt()
            }
            (true, true) => {
                let lately = |at: Instant| at.elapsed() < AGAIN;
                if self.halt.said.is_some_and(lately) {
                    return Ok(());
                }
                self.say_halt()
            }
            (true, false) => {
                warn!("released by a person: the robot may move again");
                // What the watchdog believes was never said: it begins anew, with a stop.
                self.take(Fact::Suspended)
            }
            (false, false) => Ok(()),
        }
    }

    fn say_halt(&mut self) -> Result<(), LinkLost> {
        self.halt.said = Some(Instant::now());
        self.send(&STOP)
    }

    /// What of some commands may go out.
    pub(super) fn held(&self, commands: &[Command]) -> Vec<Command> {
        let still = |command: &Command| match command {
            Command::Move { .. } => Some(Command::STOP),
            Command::Engine(Engage::Dock | Engage::Undock) => None,
            other => Some(other.clone()),
        };
        if self.halt.on {
            commands.iter().filter_map(still).collect()
        } else {
            commands.to_vec()
        }
    }
}
