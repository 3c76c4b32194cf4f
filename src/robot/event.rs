//! The events that a behaviour receives.

use std::time::Duration;

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::ends::{DockEnd, MotionEnd, SafetyAction};
use super::{Battery, CallId, MotionId, Percent, RobotInfo};

/// An event for a behaviour.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// Logged in, and the first battery level is known.
    Connected {
        /// The robot.
        info: RobotInfo,
        /// Whether it is on its station.
        docked: bool,
    },
    /// The link is lost.
    Disconnected {
        /// The reason, in words.
        reason: String,
    },
    /// The believed level or charging state has changed.
    Battery(Battery),
    /// The watchdog's low threshold was reached.
    BatteryLow(Battery),
    /// The watchdog has released the robot again.
    BatteryOk(Battery),
    /// Charging began or ended, as far as believed.
    Charging {
        /// Whether it charges.
        on: bool,
    },
    /// ENGINE 3: the battery is full.
    Charged,
    /// ENGINE 2: on the station.
    Docked,
    /// ENGINE 1: off the station.
    Undocked,
    /// ENGINE 8: the search failed.
    BaseNotFound,
    /// Microphone: s16 little-endian, mono, 16 kHz.
    Audio(Bytes),
    /// The music has ended.
    SoundFinished,
    /// The watchdog acted.
    Safety {
        /// What it did.
        action: SafetyAction,
        /// Why, in words.
        reason: String,
    },
    /// The watchdog grants the tracks of a robot with a low battery to this behaviour: its motion
    /// requests are accepted for a while.
    DriveGrant {
        /// The longest duration; a stop ends the grant, and so does a second without any motion.
        seconds: Duration,
        /// The limit of each track's power; more is scaled down.
        power: Percent,
    },
    /// An unknown ENGINE byte.
    Engine {
        /// The byte.
        code: u8,
    },
    /// Whether anything moves the robot: a behaviour, the watchdog, a person, or its own search.
    Moving {
        /// Whether it moves.
        on: bool,
    },
    /// The robot was told to make a sound, by any behaviour, person or rule.
    Sounding,
    /// A setpoint has ended.
    MotionEnded {
        /// The setpoint.
        motion: MotionId,
        /// How it ended.
        end: MotionEnd,
    },
    /// A docking has ended.
    DockEnded {
        /// The call.
        call: CallId,
        /// How it ended.
        end: DockEnd,
        /// Attempts made.
        attempts: u32,
        /// Time since the call.
        took: Duration,
    },
    /// An undocking has ended.
    UndockEnded {
        /// The call.
        call: CallId,
        /// How it ended.
        end: DockEnd,
    },
}

impl Event {
    /// Whether it is the last of the events that describe the state after a login.
    pub fn is_welcome(&self) -> bool {
        matches!(self, Event::Connected { .. })
    }

    /// Whether a waiting call depends on it, so that it must never be dropped.
    pub fn is_answer(&self) -> bool {
        use Event::{DockEnded, MotionEnded, UndockEnded};
        matches!(
            self,
            MotionEnded { .. } | DockEnded { .. } | UndockEnded { .. }
        )
    }
}
