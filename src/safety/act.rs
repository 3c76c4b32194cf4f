//! What goes into the watchdog and what comes out of it.

use crate::robot::{BehaviourId, EndReason, Event, Intent, Priority};
use crate::wire::{Command, EngineReport, Power};

/// Something that has happened.
#[derive(Debug, Clone, PartialEq)]
pub enum Fact {
    /// Logged in; the tracks were told to stop.
    LinkUp {
        /// On the station, says the login.
        docked: bool,
        /// The first battery level.
        power: Power,
    },
    /// The link is gone.
    LinkDown,
    /// Bytes came from the robot.
    Heard,
    /// A battery level came.
    Power(Power),
    /// An ENGINE message came.
    Engine(EngineReport),
    /// Whether a stream is on that makes the robot send.
    Listening(bool),
    /// A behaviour asks for something that moves the robot.
    Asked {
        /// Who.
        by: BehaviourId,
        /// Its priority.
        priority: Priority,
        /// What. An intent that moves nothing is ignored.
        intent: Intent,
    },
    /// A behaviour's host has shown life.
    Alive(BehaviourId),
    /// A behaviour is no more, for whatever reason.
    Gone(BehaviourId),
    /// Which behaviour the tracks may be lent to between two searches of a low robot; `None`: to none.
    /// Its [`Fact::Gone`] says so too.
    Rescuer(Option<BehaviourId>),
    /// The machine or the program has slept. For how long, and what the robot has done meanwhile, is
    /// not known.
    Suspended,
    /// The run ends: nothing may move any more but a robot with a low battery, by itself.
    Parting,
}

/// What is to be done now. All commands of one batch of acts go out in one write.
#[derive(Debug, Clone, PartialEq)]
pub enum Act {
    /// Send to the robot.
    Send(Command),
    /// Tell one behaviour.
    Tell(BehaviourId, Event),
    /// Tell all behaviours.
    Announce(Event),
    /// End a behaviour's host by SIGKILL, after what is to be sent has been sent.
    Kill(BehaviourId, EndReason),
    /// Close the link and connect anew, after what is to be sent has been tried.
    Reconnect(String),
}

impl Act {
    /// What it sends, if it sends.
    pub fn command(&self) -> Option<Command> {
        match self {
            Act::Send(command) => Some(command.clone()),
            _ => None,
        }
    }
}
