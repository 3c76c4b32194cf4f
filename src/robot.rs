//! The words that cross between tasks and processes: what a behaviour may ask ([`Intent`]), what it
//! is told ([`Event`], [`Frame`]), how things end, and the quantities they speak of. Data only: no
//! rule, no socket, no VM.

mod bus;
pub mod channel;
mod finding;
mod occurrence;
mod param;
mod quantity;
mod streams;
mod stroke;

pub use bus::{Bus, Happening, Heard, Listener};
pub use finding::{Finding, Findings, Lookout};
pub use occurrence::{Occurrence, Remark, WatchdogState};
pub use param::{Console, Knob, Knobs, ParamValue, Turned};
pub use quantity::{Percent, Seconds, TrackPower, float_within, whole_within};
pub use streams::{Streams, Use};
pub use stroke::Stroke;

use std::time::Duration;

use bytes::Bytes;
use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use crate::wire::{Command, Led, Power, Sound, Stream};

/// One behaviour of a run; numbers are given in the order of the command line or config.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct BehaviourId(pub u16);

/// One setpoint that a behaviour asked for; counts up within the behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MotionId(pub u64);

/// One docking or undocking that a behaviour asked for; counts up within the behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CallId(pub u64);

/// Who wins when several behaviours want to drive: the larger number.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize,
)]
pub struct Priority(pub i16);

/// What both tracks are to do.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setpoint {
    /// Left track.
    pub left: TrackPower,
    /// Right track.
    pub right: TrackPower,
}

impl Setpoint {
    /// Both tracks at rest.
    pub const STOP: Setpoint = Setpoint {
        left: TrackPower::STOP,
        right: TrackPower::STOP,
    };

    /// From percent of full power, each -100..=100; `None` beyond.
    pub fn from_percent(left: f64, right: f64) -> Option<Setpoint> {
        let (left, right) = (
            TrackPower::from_percent(left)?,
            TrackPower::from_percent(right)?,
        );
        Some(Setpoint { left, right })
    }

    /// Both tracks at rest?
    pub fn is_stop(self) -> bool {
        self == Setpoint::STOP
    }

    /// The message that sets it.
    pub fn command(self) -> Command {
        Command::Move {
            left: self.left.get(),
            right: self.right.get(),
        }
    }
}

/// The battery, as far as it is believed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Battery {
    /// Level.
    pub percent: Percent,
    /// On the charger.
    pub charging: bool,
    /// Minutes until it is empty, if it goes on as of late. `None` until known, and while it charges.
    pub minutes_left: Option<f32>,
}

impl Battery {
    /// As one report says it, with nothing learnt of it yet.
    pub fn reported(power: Power) -> Battery {
        Battery {
            percent: Percent::saturating(power.percent),
            charging: power.charging,
            minutes_left: None,
        }
    }

    /// The level or the sign differs.
    pub fn is_news_after(&self, before: &Battery) -> bool {
        (self.percent, self.charging) != (before.percent, before.charging)
    }
}

/// Who the robot is, from the login.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RobotInfo {
    /// Such as `SPYKEE0001`.
    pub uid: String,
    /// The robot's name.
    pub name: String,
    /// Such as `1.0.22`.
    pub firmware: String,
    /// `host:port` of the connection.
    pub address: String,
    /// The embedded simulator.
    pub simulated: bool,
}

/// What a behaviour asks. Nothing here reaches the robot unless arbiter and watchdog agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Intent {
    /// Drive. Holds until changed or released; with a duration it ends by itself. Answered by one
    /// [`Event::MotionEnded`], also when another motion of the same behaviour replaces it.
    Move {
        /// Names this setpoint; larger than that of every earlier one.
        motion: MotionId,
        /// What the tracks are to do.
        setpoint: Setpoint,
        /// How long; `None`: until changed.
        duration: Option<Duration>,
    },
    /// The task that owned a setpoint has ended. Nothing happens if it is not the current one.
    Release {
        /// The setpoint.
        motion: MotionId,
    },
    /// Stop the tracks, always.
    Stop,
    /// Switch a light.
    Led {
        /// Which.
        led: Led,
        /// On or off.
        on: bool,
    },
    /// Play a sound.
    Play(Sound),
    /// Stop the music.
    StopSound,
    /// Set the volume.
    Volume(Percent),
    /// Samples for the speaker: s16 little-endian, mono, 16 kHz.
    Say(Vec<u8>),
    /// Want a stream, or no longer. It is on while any behaviour wants it.
    Stream {
        /// Which.
        stream: Stream,
        /// Wanted.
        on: bool,
    },
    /// Go to the station. Answered by [`Event::DockEnded`].
    Dock {
        /// Names this call.
        call: CallId,
        /// Times and tries.
        plan: DockPlan,
    },
    /// Leave the station. Answered by [`Event::UndockEnded`].
    Undock {
        /// Names this call.
        call: CallId,
        /// How long to wait for the robot's word that it has left.
        timeout: Duration,
    },
    /// Give up a docking under way; it ends as [`DockEnd::Cancelled`].
    CancelDock,
}

/// Times and tries of one docking (`API.md`, `robot.dock`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct DockPlan {
    /// The longest search of one try.
    pub timeout: Duration,
    /// Tries after the first.
    pub retries: u32,
    /// How long charging may take to begin once the robot says that it is on its station.
    pub charge_timeout: Duration,
}

impl DockPlan {
    /// The defaults.
    pub const DEFAULT: DockPlan = DockPlan {
        timeout: Duration::from_secs(180),
        retries: 2,
        charge_timeout: Duration::from_secs(30),
    };
}

impl Default for DockPlan {
    fn default() -> DockPlan {
        DockPlan::DEFAULT
    }
}

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
    /// An ENGINE byte that nobody knows.
    Engine {
        /// The byte.
        code: u8,
    },
    /// Whether anything moves the robot: a behaviour, the watchdog, a person, or its own search.
    Moving {
        /// It moves.
        on: bool,
    },
    /// The robot was told to make a sound, by whomever.
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

/// One camera frame, as it came.
#[derive(Debug, Clone)]
pub struct Frame {
    /// Counts the frames of a run from 1; gaps are frames that a slow reader missed.
    pub seq: u64,
    /// When its last byte arrived.
    pub at: Instant,
    /// The JPEG.
    pub jpeg: Bytes,
}

/// A frame of which a part has come.
#[derive(Debug, Clone)]
pub struct Coming {
    /// The number that it will have.
    pub seq: u64,
    /// Its first bytes.
    pub jpeg: Bytes,
}

/// What the camera shows.
#[derive(Debug, Clone, Default)]
pub struct Pictures {
    /// The newest frame.
    pub newest: Option<Frame>,
    /// The one on its way.
    pub coming: Option<Coming>,
}

/// Declares an enum whose values have names that scripts, logs and people read.
macro_rules! named {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
        pub enum $name {
            $($(#[$variant_doc])* #[doc = concat!(" (`", $text, "`)")] #[serde(rename = $text)] $variant,)+
        }

        impl $name {
            /// Every value.
            pub const ALL: &'static [$name] = &[$($name::$variant,)+];

            /// The word that scripts and logs use.
            pub fn name(self) -> &'static str {
                match self { $($name::$variant => $text,)+ }
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.name())
            }
        }
    };
}

named! {
    /// How a setpoint ended (`API.md`, *robot: motion*).
    MotionEnd {
        /// Its time was over, or its task let go of it.
        Done = "done",
        /// A behaviour of higher priority drives, or a newer setpoint took its place.
        Preempted = "preempted",
        /// The watchdog refuses motion.
        Safety = "safety",
        /// The robot stands on its station.
        Docked = "docked",
        /// The pictures say that the robot did not move.
        Blocked = "blocked",
        /// There is no link.
        Disconnected = "disconnected",
        /// Stopped by the behaviour itself.
        Cancelled = "cancelled",
    }
}

named! {
    /// How docking or undocking ended (`API.md`, *robot: dock*).
    DockEnd {
        /// On the station and charging; or off it, for undocking.
        Done = "done",
        /// Was on the station already; nothing was sent.
        AlreadyDocked = "already_docked",
        /// Undocking off the station; nothing was sent.
        NotDocked = "not_docked",
        /// The robot did not find its station in any try.
        BaseNotFound = "base_not_found",
        /// The last try took too long.
        Timeout = "timeout",
        /// On the station, but charging did not begin.
        NotCharging = "not_charging",
        /// Given up by a behaviour.
        Cancelled = "cancelled",
        /// A behaviour of higher priority drives or docks.
        Preempted = "preempted",
        /// The link was lost.
        Disconnected = "disconnected",
        /// The watchdog refuses it.
        Safety = "safety",
    }
}

named! {
    /// Why a behaviour ended (`API.md`, *A script's life*).
    EndReason {
        /// Nothing was left to do, or `script.stop`.
        Done = "done",
        /// The script failed.
        Error = "error",
        /// The script did not wait within its time budget.
        Cpu = "cpu",
        /// The script wanted more memory than it may have.
        Memory = "memory",
        /// Ended by a person.
        Cancelled = "cancelled",
        /// Ended by the watchdog.
        Safety = "safety",
        /// To be started anew from its changed file.
        Reload = "reload",
        /// The whole run ends.
        Shutdown = "shutdown",
    }
}

impl EndReason {
    /// One sentence for the log.
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
            EndReason::Reload => "the script is loaded anew",
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
