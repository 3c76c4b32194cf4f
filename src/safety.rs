//! The rules that keep the robot from harm, as pure state machines: facts, requests and the time go
//! in, acts come out. Nothing here blocks, reads the clock, or knows a socket or a script's VM.
//!
//! [`Watchdog`] combines all parts; each part can be read alone: [`Arbiter`] (which behaviour
//! drives), [`Tracks`] (the setpoint sent, and how often), [`PowerGauge`] (what POWER says of the
//! energy), [`BatteryMonitor`] (which battery
//! reports count, and when the level is low), [`DockTracker`] (whether the robot is docked, and on
//! what evidence), [`Docking`] (one docking with its retries), [`Homing`] (the way home of a robot
//! with a low battery), [`DriveGrant`] and [`BlindMove`] (how it reaches another place to search
//! from), [`Rescue`] (which behaviour may drive it), [`Leases`] (which hosts are alive),
//! [`LastWords`] (what the robot is sent if the agent dies), [`Limits`] (every number).

mod act;
mod arbiter;
mod battery;
mod blind_move;
mod debounce;
mod dock_state;
mod docking;
mod drive_grant;
mod gauge;
mod homing;
mod leases;
mod limits;
mod recharge;
mod watchdog;

pub use act::{Act, Fact, LastWords};
pub use arbiter::{Arbiter, Tracks};
pub use battery::{BatteryChange, BatteryMonitor, Charging, LowCause};
pub use blind_move::BlindMove;
pub use dock_state::{Contradiction, DockState, DockTracker};
pub use docking::{DockAction, Docking};
pub use drive_grant::{DriveGrant, capped};
pub use gauge::{MotorLoad, PowerGauge, PowerMeaning};
pub use homing::{ALARM, Homing, HomingStep};
pub use leases::{HostLife, Leases};
pub use limits::{Limits, LimitsError, Rescue};
pub use recharge::{AfterRecharge, Recharge};
pub use watchdog::{DockReport, Watchdog};

pub use crate::robot::WatchdogState;
