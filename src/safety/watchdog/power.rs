//! Reactions to the battery's level and to charging.

use tokio::time::Instant;

use super::Watchdog;
use crate::robot::{MotionEnd, SafetyAction};
use crate::safety::{BatteryChange, Charging, DockState};
use crate::wire::Power;

impl Watchdog {
    pub(super) fn power(&mut self, power: Power, now: Instant) {
        let power = Power {
            charging: power.charging && !self.dock_tracker.has_just_left(now),
            ..power
        };
        let was_critical = self.guard.critical();
        let contact = self.dock_tracker.has_contact();
        let change = self.guard.report(power, contact, now);
        let was_docked = self.docked();
        let charges = self.guard.charging() != Charging::No;
        self.dock_tracker.power(charges, now);
        if self.docked() && !was_docked {
            self.end_motion(MotionEnd::Docked);
            self.interrupt_recovery(now);
        }
        self.apply_battery_change(change, now);
        if self.guard.critical() && !was_critical {
            if self.borrower().is_none() {
                self.end_motion(MotionEnd::Safety);
            }
            let reason = format!(
                "battery at {} %: motion is refused except on the way home",
                power.percent
            );
            self.announce(SafetyAction::Hold, reason);
        }
    }

    /// Acts on the charging state, and on a change of the battery's state if there is one.
    pub(super) fn apply_battery_change(&mut self, change: Option<BatteryChange>, now: Instant) {
        let charging = self.charging_here();
        let actions = self.homing.as_mut().map(|homing| match charging {
            Charging::No => vec![],
            Charging::Unconfirmed => homing.docking.wait(),
            Charging::Confirmed => homing.docking.charging(now),
        });
        if charging == Charging::Confirmed {
            self.search_ended();
            self.end_alarm();
        }
        self.execute_dock_actions(actions.unwrap_or_default(), now);
        match change {
            Some(BatteryChange::BecameLow(cause)) => self.became_low(cause, now),
            Some(BatteryChange::Released) => self.released(now),
            None => {}
        }
    }

    /// Whether a single unconfirmed report says that the robot charges: nothing may drive it away
    /// then.
    pub(super) fn may_charge(&self) -> bool {
        self.charging_here() == Charging::Unconfirmed
    }

    /// The believed charging state; [`Charging::No`] once a later report or a doubt has moved the
    /// robot from [`DockState::Charging`] to another state.
    pub(super) fn charging_here(&self) -> Charging {
        match self.place() {
            DockState::Charging => self.guard.charging(),
            _ => Charging::No,
        }
    }
}
