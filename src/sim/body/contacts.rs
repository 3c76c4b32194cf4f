//! The robot's charging contacts, and which parts of the station work.

use super::docking::Docking;
use crate::sim::geometry::Pose;
use crate::sim::world::station::Station;

/// Contacts, charger and beacon.
#[derive(Debug)]
pub(super) struct Contacts {
    touching: bool,
    docked: bool,
    /// The station's infrared beacon is on.
    pub(super) beacon: bool,
    /// The station charges when the contacts touch.
    pub(super) charger_works: bool,
}

impl Contacts {
    /// Creates contacts with a working charger and beacon.
    pub(super) fn new(touching: bool) -> Contacts {
        Contacts {
            touching,
            docked: touching,
            beacon: true,
            charger_works: true,
        }
    }

    /// Whether the contacts touch.
    pub(super) fn touching(&self) -> bool {
        self.touching
    }

    /// Whether the robot is docked; while it backs out, true until it has left the station.
    pub(super) fn docked(&self) -> bool {
        self.docked
    }

    /// Whether current flows into the battery.
    pub(super) fn charging(&self) -> bool {
        self.touching && self.charger_works
    }

    /// Updates whether the contacts touch, for a robot at `pose`.
    pub(super) fn update(&mut self, station: &Station, pose: Pose) {
        self.touching = station.touched(pose, self.touching);
    }

    /// Returns whether the robot is docked, if that has changed since the last call.
    pub(super) fn take_change(&mut self, docking: &Docking) -> Option<bool> {
        let docked = self.touching || (self.docked && docking.leaving());
        let changed = docked != self.docked;
        self.docked = docked;
        changed.then_some(docked)
    }
}
