//! Publishes on the bus. Nothing here waits for a listener.

use super::{Pilot, Status};
use crate::robot::{Battery, BehaviourId, DockEnd, Event, Occurrence, RobotInfo};

impl Pilot {
    pub(super) fn publish_link_up(&self, info: &RobotInfo, docked: bool) {
        let robot = info.clone();
        self.bus.publish(Occurrence::LinkUp { robot, docked });
    }

    pub(super) fn publish_link_down(&self, reason: &str) {
        let reason = reason.to_owned();
        self.bus.publish(Occurrence::LinkDown { reason });
    }

    /// The battery with the estimate of the minutes left.
    pub(super) fn battery(&self) -> Option<Battery> {
        Some(Battery {
            minutes_left: self.minutes_left.estimate(),
            ..self.watchdog.battery()?
        })
    }

    pub(super) fn publish_battery(&self) {
        if let Some(battery) = self.battery() {
            self.bus.publish(Occurrence::Battery(battery));
        }
    }

    pub(super) fn publish_safety(&self, event: &Event) {
        if let Event::Safety { action, reason } = event {
            let (action, reason) = (*action, reason.clone());
            self.bus.publish(Occurrence::Safety { action, reason });
        }
    }

    /// Publishes an undocking that was tried; a refused one is not published, since a script may
    /// request thousands of them.
    pub(super) fn publish_undocking(&self, by: BehaviourId, event: &Event) {
        let Event::UndockEnded { end, .. } = event else {
            return;
        };
        if let (DockEnd::Done | DockEnd::Timeout, Some(by)) = (*end, self.seats.name(by)) {
            let (by, end) = (by.to_owned(), *end);
            self.bus.publish(Occurrence::Undock { by, end });
        }
    }

    pub(super) fn publish_docking(&mut self) {
        let Some(report) = self.watchdog.take_dock_report() else {
            return;
        };
        let by = report.by.and_then(|by| self.seats.name(by));
        self.bus.publish(Occurrence::Dock {
            by: by.map(str::to_owned),
            end: report.outcome.end,
            attempts: report.outcome.attempts,
            seconds: report.outcome.took.as_secs_f64(),
        });
    }

    /// Publishes the watchdog's state if it differs from that in the last status.
    pub(super) fn publish_status(&self, newest: &Status) {
        let before = *self.status.borrow();
        let essence = |status: &Status| (status.safety, status.low, status.docked);
        if essence(&before) != essence(newest) {
            let (state, low, docked) = essence(newest);
            self.bus
                .publish(Occurrence::Watchdog { state, low, docked });
        }
    }
}
