//! The inputs and outputs of the watchdog.

use crate::robot::{BehaviourId, EndReason, Event, Intent, Priority};
use crate::wire::{Command, EngineReport, Power};

/// An input: something that has happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Fact {
    /// Logged in; the tracks were told to stop.
    LinkUp {
        /// Whether the login says that the robot is on its station.
        docked: bool,
        /// The first battery level.
        power: Power,
    },
    /// The link is lost.
    LinkDown,
    /// Bytes came from the robot.
    BytesReceived,
    /// A battery level was received.
    Power(Power),
    /// An ENGINE message was received.
    Engine(EngineReport),
    /// Whether a stream is on that makes the robot send data.
    Streaming(bool),
    /// A behaviour requests something that moves the robot.
    Asked {
        /// The behaviour.
        by: BehaviourId,
        /// Its priority.
        priority: Priority,
        /// The request. An intent that moves nothing is ignored.
        intent: Intent,
    },
    /// A behaviour's host has sent a sign of life.
    Alive(BehaviourId),
    /// A behaviour has ended, for whatever reason.
    Gone(BehaviourId),
    /// The behaviour that the tracks may be lent to between two searches of a robot with a low
    /// battery, if there is one. Its [`Fact::Gone`] also revokes this.
    Rescuer(Option<BehaviourId>),
    /// The machine or the program was suspended or hung. For how long, and what the robot has done
    /// meanwhile, is not known.
    Suspended,
    /// The run ends: nothing may move any more, except a robot with a low battery that searches on
    /// its own.
    RunEnding,
}

/// An output: something to do now. All commands of one batch of acts go out in one write.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// Send a command to the robot.
    Send(Command),
    /// Send an event to one behaviour.
    Tell(BehaviourId, Event),
    /// Send an event to all behaviours.
    Announce(Event),
    /// End a behaviour's host with SIGKILL, after the batch's commands have been sent.
    Kill(BehaviourId, EndReason),
    /// Close the link and reconnect, after trying to send the batch's commands.
    Reconnect(String),
}

impl Act {
    /// The command, if this act sends one.
    pub fn command(&self) -> Option<Command> {
        match self {
            Act::Send(command) => Some(command.clone()),
            _ => None,
        }
    }
}
