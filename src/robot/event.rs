//! What a behaviour is told.

use std::time::Duration;

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::ends::{DockEnd, MotionEnd, SafetyAction};
use super::stroke::Stroke;
use super::{Battery, CallId, MotionId, Percent, RobotInfo};

/// What a behaviour is told.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// Logged in, and the first battery level is known.
    Connected {
        /// Who.
        info: RobotInfo,
        /// On the station.
        docked: bool,
    },
    /// The link is gone.
    Disconnected {
        /// In words.
        reason: String,
    },
    /// The believed level or sign changed.
    Battery(Battery),
    /// The watchdog's low threshold was reached.
    BatteryLow(Battery),
    /// The watchdog has released the robot again.
    BatteryOk(Battery),
    /// Charging began or ended, and that is believed.
    Charging {
        /// On the charger.
        on: bool,
    },
    /// ENGINE 3: the battery is full.
    Charged,
    /// ENGINE 2: on the station.
    Docked,
    /// ENGINE 1: has left the station.
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
    /// The watchdog lends the tracks of a low robot to this behaviour: its motion is obeyed for a while.
    Loan {
        /// How long at most; a stop ends it, and so does a second without any motion.
        seconds: Duration,
        /// The most power of each track; more is scaled down.
        power: Percent,
        /// Since the battery has become low.
        low_for: Duration,
        /// How the robot came from its station to where it stood then, if that is known and nothing has
        /// moved it since but one search.
        way: Option<Vec<Stroke>>,
    },
    /// An unknown ENGINE byte.
    Engine {
        /// The byte.
        code: u8,
    },
    /// Whether anything moves the robot: a behaviour, the watchdog, a person, or its own search.
    Moving {
        /// It moves.
        on: bool,
    },
    /// The robot was told to make a sound, by any behaviour, person or rule.
    Sounding,
    /// A setpoint is over.
    MotionEnded {
        /// Which.
        motion: MotionId,
        /// How.
        end: MotionEnd,
    },
    /// A docking is over.
    DockEnded {
        /// Which.
        call: CallId,
        /// How.
        end: DockEnd,
        /// Tries made.
        attempts: u32,
        /// From the call until now.
        took: Duration,
    },
    /// An undocking is over.
    UndockEnded {
        /// Which.
        call: CallId,
        /// How.
        end: DockEnd,
    },
}

impl Event {
    /// Whether it is the last of those that say how things stand after a login.
    pub fn is_welcome(&self) -> bool {
        matches!(self, Event::Connected { .. })
    }

    /// Whether a waiting call hangs on it, so that it must never be dropped.
    pub fn is_answer(&self) -> bool {
        use Event::{DockEnded, MotionEnded, UndockEnded};
        matches!(
            self,
            MotionEnded { .. } | DockEnded { .. } | UndockEnded { .. }
        )
    }
}
