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

    /// The commands to send instead of these: while the STOP is on, each MOVE becomes a stop, and
    /// docking and undocking are dropped.
    pub(super) fn replace_while_halted(&self, commands: &[Command]) -> Vec<Command> {
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
