//! The robot's contacts with its station, and what of the station works.

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
    /// Current flows when the contacts touch.
    pub(super) charger_works: bool,
}

impl Contacts {
    /// All works.
    pub(super) fn new(touching: bool) -> Contacts {
        Contacts {
            touching,
            docked: touching,
            beacon: true,
            charger_works: true,
        }
    }

    /// The contacts touch.
    pub(super) fn touching(&self) -> bool {
        self.touching
    }

    /// On the station; while the robot backs out, until it has left.
    pub(super) fn docked(&self) -> bool {
        self.docked
    }

    /// Current flows into the battery.
    pub(super) fn charging(&self) -> bool {
        self.touching && self.charger_works
    }

    /// Whether the contacts touch now that the robot stands at `pose`.
    pub(super) fn touch(&mut self, station: &Station, pose: Pose) {
        self.touching = station.touched(pose, self.touching);
    }

    /// Whether the robot is docked now, if that has changed.
    pub(super) fn take_change(&mut self, docking: &Docking) -> Option<bool> {
        let docked = self.touching || (self.docked && docking.leaving());
        let changed = docked != self.docked;
        self.docked = docked;
        changed.then_some(docked)
    }
}
