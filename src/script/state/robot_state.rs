//! What a script knows about the robot.

use tokio::time::Instant;

use crate::robot::{Battery, Event, RobotInfo};

/// The state of the robot as known from the events that the script has received.
#[derive(Debug, Default)]
pub(in crate::script) struct RobotState {
    pub(in crate::script) info: Option<RobotInfo>,
    pub(in crate::script) connected: bool,
    pub(in crate::script) docked: bool,
    pub(in crate::script) battery: Option<(Battery, Instant)>,
    /// Whether something moves the robot, this script or something else.
    pub(in crate::script) moving: bool,
}

impl RobotState {
    pub(in crate::script) fn record(&mut self, event: &Event, now: Instant) {
        match event {
            Event::Connected { info, docked } => {
                self.info = Some(info.clone());
                self.connected = true;
                self.docked = *docked;
            }
            Event::Disconnected { .. } => self.connected = false,
            Event::Battery(battery) | Event::BatteryLow(battery) | Event::BatteryOk(battery) => {
                self.battery = Some((*battery, now));
                self.docked |= battery.charging;
            }
            Event::Charging { on } => self.docked |= on,
            Event::Docked => self.docked = true,
            Event::Undocked => self.docked = false,
            Event::Moving { on } => self.moving = *on,
            _ => {}
        }
    }
}

/// Whether an event shows that the robot moves or may have moved.
pub(in crate::script) fn shows_motion(event: &Event) -> bool {
    matches!(
        event,
        Event::Moving { .. }
            | Event::Connected { .. }
            | Event::Docked
            | Event::Undocked
            | Event::BaseNotFound
    )
}
