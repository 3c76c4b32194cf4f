//! What a script knows of the robot.

use tokio::time::Instant;

use crate::robot::{Battery, Event, RobotInfo};

/// What the script knows of the robot, from the events it was told.
#[derive(Debug, Default)]
pub(in crate::script) struct Known {
    pub(in crate::script) info: Option<RobotInfo>,
    pub(in crate::script) connected: bool,
    pub(in crate::script) docked: bool,
    pub(in crate::script) battery: Option<(Battery, Instant)>,
    /// Something moves the robot, be it this script or not.
    pub(in crate::script) moving: bool,
}

impl Known {
    pub(in crate::script) fn note(&mut self, event: &Event, now: Instant) {
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

/// Whether an event says that the robot has moved by itself.
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
