//! What a behaviour can request, and the events that it receives.

use std::time::Duration;

use bytes::Bytes;
use serde::{Deserialize, Serialize};

use super::{Battery, CallId, MotionId, Percent, RobotInfo, Setpoint};
use crate::wire::{Led, Sound, Stream};

/// A request of a behaviour. None reaches the robot unless arbiter and watchdog agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Intent {
    /// Drive. Holds until changed or released; with a duration it ends automatically. Answered by
    /// one [`Event::MotionEnded`], also when another motion of the same
    /// behaviour replaces it.
    Move {
        /// The setpoint's number; larger than that of every earlier one.
        motion: MotionId,
        setpoint: Setpoint,
        /// The duration; `None`: until changed.
        duration: Option<Duration>,
    },
    /// The task that owned a setpoint has ended. Has no effect if the setpoint is not the current
    /// one.
    Release {
        motion: MotionId,
    },
    /// End the motions and dockings of this behaviour and of all with equal or lower priority. Of
    /// the watchdog's own way home it ends only a grant to this behaviour.
    Stop,
    Led {
        led: Led,
        on: bool,
    },
    Play(Sound),
    StopSound,
    Volume(Percent),
    /// Samples for the speaker: s16 little-endian, mono, 16 kHz.
    Say(Vec<u8>),
    /// Request a stream, or no longer. It is on while any behaviour requests it.
    Stream {
        stream: Stream,
        on: bool,
    },
    /// Go to the station. Answered by [`Event::DockEnded`].
    Dock {
        call: CallId,
        plan: DockPlan,
    },
    /// Leave the station. Answered by [`Event::UndockEnded`].
    Undock {
        call: CallId,
        /// How long to wait for the robot's confirmation that it has left.
        timeout: Duration,
    },
    /// Cancel a docking under way; it ends as [`DockEnd::Cancelled`]. From the rescue behaviour: the search
    /// under way finds nothing here.
    CancelDock,
}

impl Intent {
    pub fn drives(&self) -> bool {
        matches!(
            self,
            Intent::Move { .. } | Intent::Dock { .. } | Intent::Undock { .. }
        )
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DockPlan {
    /// The longest search of one attempt.
    pub timeout: Duration,
    pub retries: u32,
    /// How long charging may take to begin once the robot reports that it is on its station.
    pub charge_timeout: Duration,
}

impl DockPlan {
    pub const DEFAULT: DockPlan = DockPlan {
        timeout: Duration::from_secs(180),
        retries: 2,
        charge_timeout: Duration::from_secs(30),
    };

    /// The docking that a person orders, or the service for an idle robot: the rescue behaviour may
    /// drive the robot elsewhere between two searches, and that may take some of them.
    pub const ORDERED: DockPlan = DockPlan {
        retries: 8,
        ..DockPlan::DEFAULT
    };
}

impl Default for DockPlan {
    fn default() -> DockPlan {
        DockPlan::DEFAULT
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Event {
    /// Logged in, and the first battery level is known.
    Connected {
        info: RobotInfo,
        docked: bool,
    },
    Disconnected {
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
    SoundFinished,
    Safety {
        action: SafetyAction,
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
        code: u8,
    },
    /// Whether anything moves the robot: a behaviour, the watchdog, a person, or its own search.
    Moving {
        on: bool,
    },
    /// The robot was told to make a sound, by any behaviour, person or rule.
    Sounding,
    /// A timed setpoint waits until the robot's queue has room for it; its time has not begun.
    MotionWaiting {
        motion: MotionId,
        /// Whether it waits; `false`: it has begun.
        on: bool,
    },
    MotionEnded {
        motion: MotionId,
        end: MotionEnd,
    },
    DockEnded {
        call: CallId,
        outcome: DockOutcome,
    },
    UndockEnded {
        call: CallId,
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
        use Event::{DockEnded, MotionEnded, MotionWaiting, UndockEnded};
        matches!(
            self,
            MotionWaiting { .. } | MotionEnded { .. } | DockEnded { .. } | UndockEnded { .. }
        )
    }
}

/// Declares an enum whose values have names for scripts, logs and people.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $text:literal,)+ }) => {
        #[derive(
            Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
            schemars::JsonSchema,
        )]
        $(#[$doc])*
        pub enum $name {
            $($(#[$variant_doc])* #[doc = concat!(" (`", $text, "`)")] #[serde(rename = $text)] $variant,)+
        }

        impl $name {
            pub const ALL: &'static [$name] = &[$($name::$variant,)+];

            /// The name in scripts and logs.
            pub fn name(self) -> &'static str {
                match self { $($name::$variant => $text,)+ }
            }

            pub fn from_name(name: &str) -> Option<$name> {
                $name::ALL.iter().copied().find(|one| one.name() == name)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

pub(crate) use named;

named! {
    /// How a setpoint ended.
    MotionEnd {
        /// Its time was over, or its task released it.
        Done = "done",
        /// A behaviour of higher priority drives, or a newer setpoint replaced it.
        Preempted = "preempted",
        /// The watchdog refuses motion.
        Safety = "safety",
        /// The robot stands on its station.
        Docked = "docked",
        /// According to the camera, the robot did not move.
        Blocked = "blocked",
        /// There is no link.
        Disconnected = "disconnected",
        /// Stopped by the behaviour itself.
        Cancelled = "cancelled",
    }
}

named! {
    /// How docking or undocking ended.
    DockEnd {
        /// On the station and charging; or off it, for undocking.
        Done = "done",
        /// The robot was on the station already; nothing was sent.
        AlreadyDocked = "already_docked",
        /// Undocking off the station; nothing was sent.
        NotDocked = "not_docked",
        /// The robot did not find its station in any attempt.
        BaseNotFound = "base_not_found",
        /// The last attempt took too long.
        Timeout = "timeout",
        /// On the station, but charging did not begin.
        NotCharging = "not_charging",
        /// Cancelled by a behaviour.
        Cancelled = "cancelled",
        /// A behaviour of higher priority drives or docks.
        Preempted = "preempted",
        /// The link was lost.
        Disconnected = "disconnected",
        /// The watchdog refuses it.
        Safety = "safety",
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DockOutcome {
    pub end: DockEnd,
    pub attempts: u32,
    pub took: Duration,
}

impl DockOutcome {
    pub fn without_attempt(end: DockEnd) -> DockOutcome {
        DockOutcome {
            end,
            attempts: 0,
            took: Duration::ZERO,
        }
    }
}

named! {
    /// Why a behaviour ended.
    EndReason {
        /// Nothing was left to do, or `script.stop`.
        Done = "done",
        /// The script failed.
        Error = "error",
        /// The script did not yield within its time budget.
        Cpu = "cpu",
        /// The script exceeded its memory limit.
        Memory = "memory",
        /// Ended by a person.
        Cancelled = "cancelled",
        /// Ended by the watchdog.
        Safety = "safety",
        /// To be restarted from its changed file.
        Reload = "reload",
        /// The whole run ends.
        Shutdown = "shutdown",
    }
}

impl EndReason {
    pub fn sentence(self) -> &'static str {
        match self {
            EndReason::Done => "the script has finished",
            EndReason::Error => "the script failed",
            EndReason::Cpu => {
                "the script ran too long without waiting: put task.wait() into its loops"
            }
            EndReason::Memory => "the script wanted more memory than it may have",
            EndReason::Cancelled => "the script was ended from outside",
            EndReason::Safety => "the watchdog ended the script",
            EndReason::Reload => "the script is reloaded",
            EndReason::Shutdown => "the run ends",
        }
    }
}

named! {
    /// What the watchdog did.
    SafetyAction {
        /// Stopped the tracks.
        Stop = "stop",
        /// Sent the robot to its station.
        Dock = "dock",
        /// Refuses motion from now on.
        Hold = "hold",
        /// Allows motion again.
        Release = "release",
        /// Sounds the alarm: docking failed.
        Alarm = "alarm",
        /// Ended a behaviour.
        Kill = "kill",
        /// Closed a dead link.
        Reconnect = "reconnect",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn intents_from_a_broken_host_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
            let _ = postcard::from_bytes::<Intent>(&bytes);
        }
    }
}
