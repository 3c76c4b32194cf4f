//! Whether the robot may be searching for its station, from what it was sent and what it reports.

use std::time::Duration;

use tokio::time::Instant;

use super::Watchdog;
use crate::wire::{Command, Engage};

impl Watchdog {
    /// A BASE_FIND_CANCEL counts as delivered when its link has lasted this long after it. A link
    /// is lost earlier if the robot does not accept a command, or does not acknowledge it, each
    /// within `dead_after`, at most 60 s.
    pub(super) const CANCEL_DELIVERY: Duration = Duration::from_secs(130);

    /// Ends the search and stops the tracks.
    pub(super) fn cancel_search(&mut self, now: Instant) {
        self.send(Command::Engine(Engage::CancelDock));
        self.cancel_delivered_at = Some(now + Watchdog::CANCEL_DELIVERY);
        self.halt(now);
    }

    /// Ends a search from before the link was lost or the machine slept, unless the battery is low:
    /// then another search follows.
    pub(super) fn cancel_earlier_search(&mut self, now: Instant) {
        if self.may_search && self.guard.low().is_none() {
            self.cancel_search(now);
        }
    }

    /// The robot's reports show that it does not search.
    pub(super) fn search_ended(&mut self) {
        (self.searching, self.may_search) = (false, false);
    }

    /// Takes a BASE_FIND_CANCEL for delivered when its time has come.
    pub(super) fn confirm_cancel(&mut self, now: Instant) {
        let delivered = self.cancel_delivered_at.take_if(|at| *at <= now);
        self.may_search &= delivered.is_none();
    }
}
