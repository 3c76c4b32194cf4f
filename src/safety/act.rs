//! The inputs and outputs of the watchdog, and what the robot is sent if the agent dies.

use std::time::Duration;

use crate::robot::{BehaviourId, EndReason, Event};
use crate::wire::{Command, Engage, EngineReport, Power};

/// An input: something that has happened, besides the requests of behaviours.
#[derive(Debug, Clone, PartialEq)]
pub enum Fact {
    /// Logged in; the tracks were told to stop.
    LinkUp {
        /// Whether the login says that the robot is on its station.
        docked: bool,
        power: Power,
    },
    LinkDown,
    BytesReceived,
    Power(Power),
    Engine(EngineReport),
    /// The time that the robot's program takes for one message.
    Pace(Duration),
    /// Whether a stream is on that makes the robot send data.
    Streaming(bool),
    /// A behaviour's host has sent a sign of life.
    Alive(BehaviourId),
    /// A behaviour has ended, for whatever reason.
    Gone(BehaviourId),
    /// The behaviour that the tracks may be granted to between two searches of a robot with a low
    /// battery, if there is one. Its [`Fact::Gone`] also revokes this.
    Rescuer(Option<BehaviourId>),
    /// The machine or the program was suspended. What the robot has done meanwhile is not known.
    Suspended,
    /// The program, or the whole machine, stood still for a moment.
    Stalled {
        gap: Duration,
        /// The guardian has sent the last words meanwhile.
        guardian_wrote: bool,
    },
    /// Whether a person's STOP holds: what the watchdog sends does not reach the robot.
    StoppedByPerson(bool),
    /// Whether a guardian process answers, which stops the robot if this program no longer can.
    Guarded(bool),
    /// The run ends: nothing may move any more, except a robot with a low battery that searches on
    /// its own.
    RunEnding,
}

/// An output: something to do now. All commands of one batch of acts go out in one write.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    Send(Command),
    Tell(BehaviourId, Event),
    Announce(Event),
    /// End a behaviour's host with SIGKILL, after the batch's commands have been sent.
    Kill(BehaviourId, EndReason),
    /// Close the link and reconnect, after trying to send the batch's commands.
    Reconnect(String),
}

impl Act {
    pub fn command(&self) -> Option<Command> {
        match self {
            Act::Send(command) => Some(command.clone()),
            _ => None,
        }
    }
}

/// What is sent when the link, the agent or the machine fails: the writer and the guardian hold the
/// latest ones from the watchdog (see [`Watchdog::last_words`](super::Watchdog::last_words)). The
/// default, before anything is known, is a stop.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LastWords {
    /// Stop the tracks, end a search for the station, which a MOVE alone may not end, and stop the
    /// tracks again.
    #[default]
    Stop,
    /// Stop the tracks and search for the station: the battery is low.
    StopAndDock,
    /// Nothing: what the robot does on its own is best, and any MOVE would end that.
    Nothing,
}

impl LastWords {
    pub fn commands(self) -> Vec<Command> {
        match self {
            LastWords::Stop => vec![
                Command::STOP,
                Command::Engine(Engage::CancelDock),
                Command::STOP,
            ],
            LastWords::StopAndDock => vec![Command::STOP, Command::Engine(Engage::Dock)],
            LastWords::Nothing => vec![],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_last_words_begin_with_a_stop() {
        assert_eq!(LastWords::default(), LastWords::Stop);
        let find = Command::Engine(Engage::Dock);
        let end = Command::Engine(Engage::CancelDock);
        let stop = [Command::STOP, end, Command::STOP];
        assert_eq!(LastWords::Stop.commands(), stop);
        assert_eq!(LastWords::StopAndDock.commands(), [Command::STOP, find]);
        assert_eq!(LastWords::Nothing.commands(), []);
    }
}
