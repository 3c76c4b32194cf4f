//! The data types that tasks and processes exchange: what a behaviour can request ([`Intent`]),
//! what it receives ([`Event`], [`Frame`]), results, and the quantities in them. Data only: no
//! rule, no socket, no VM.

mod agent_event;
pub mod channel;
mod event;
mod frame;
mod param;
mod quantity;
mod stop_confirmation;

pub use agent_event::{
    AgentEvent, Bus, BusMessage, HostReport, Listener, TimedEvent, WatchdogState,
};
pub(crate) use event::named;
pub use event::{
    DockEnd, DockOutcome, DockPlan, EndReason, Event, Intent, MotionEnd, SafetyAction,
};
pub use frame::{Detection, Detections, Frame, Pictures, Streams, Use, ViewerChannel};
pub use param::{DeclaredParam, DeclaredParams, ParamBoard, ParamChange, ParamValue};
pub use quantity::{Percent, Seconds, TrackPower};
use serde::{Deserialize, Serialize};
pub use stop_confirmation::{STOP_HOLDS, StopConfirmation, StopKept, StopOutcome};

use crate::wire::{Command, Power};

/// A behaviour of a run; numbers are assigned in the order of the command line or config.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct BehaviourId(pub u16);

/// A setpoint that a behaviour asked for; counts up within the behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct MotionId(pub u64);

/// A docking or undocking that a behaviour asked for; counts up within the behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct CallId(pub u64);

/// Decides which behaviour drives when several want to: the one with the larger number.
#[derive(
    Debug,
    Clone,
    Copy,
    Default,
    PartialEq,
    Eq,
    Hash,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    schemars::JsonSchema,
)]
#[schemars(inline)]
pub struct Priority(pub i16);

/// The power of both tracks.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Setpoint {
    pub left: TrackPower,
    pub right: TrackPower,
}

impl Setpoint {
    pub const STOP: Setpoint = Setpoint {
        left: TrackPower::STOP,
        right: TrackPower::STOP,
    };

    /// From percent of full power, each -100..=100; `None` outside of that range.
    pub fn from_percent(left: f64, right: f64) -> Option<Setpoint> {
        let left = TrackPower::from_percent(left)?;
        let right = TrackPower::from_percent(right)?;
        Some(Setpoint { left, right })
    }

    pub fn is_stop(self) -> bool {
        self == Setpoint::STOP
    }

    /// The mean power of both tracks, 0..=1.
    pub fn effort(self) -> f64 {
        let sum = f64::from(self.left.get()).abs() + f64::from(self.right.get()).abs();
        sum / (2.0 * f64::from(TrackPower::MAX))
    }

    /// The message that sets it.
    pub fn command(self) -> Command {
        Command::Move {
            left: self.left.get(),
            right: self.right.get(),
        }
    }
}

/// The battery, as far as its reports are believed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct Battery {
    /// Level. `None` if it is not known, as may happen while it charges.
    pub percent: Option<Percent>,
    /// On the charger.
    pub charging: bool,
    /// Minutes until it is empty, at the recent average rate. `None` until known, and while it
    /// charges.
    pub minutes_left: Option<f32>,
}

impl Battery {
    /// The state in a single report, with nothing learnt yet.
    pub fn reported(power: Power) -> Battery {
        Battery {
            percent: power.level().and_then(Percent::new),
            charging: power.charging,
            minutes_left: None,
        }
    }

    pub fn level(&self) -> String {
        match self.percent {
            Some(percent) => percent.to_string(),
            None => "unknown level".to_owned(),
        }
    }

    /// Whether the level or the charging state differs.
    pub fn is_news_after(&self, before: &Battery) -> bool {
        (self.percent, self.charging) != (before.percent, before.charging)
    }
}

/// The robot's identity, from the login.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
pub struct RobotInfo {
    /// Such as `SPYKEE0001`.
    pub uid: String,
    /// The robot's name.
    pub name: String,
    /// Such as `1.0.22`.
    pub firmware: String,
    /// `host:port` of the connection.
    pub address: String,
    /// Whether it is the embedded simulator.
    pub simulated: bool,
}
