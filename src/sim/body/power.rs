//! When the robot sends POWER: first when it is due after the login, then on every change, and when
//! the period is over (how often a real robot does is not known: `PROTOCOL.md`, *Not known*).

use std::time::Duration;

use crate::wire::Power;

/// What the user was told, and when the next POWER is due.
#[derive(Debug, Default)]
pub(super) struct PowerReports {
    session: bool,
    told: Option<Power>,
    left: Duration,
}

impl PowerReports {
    /// A user has logged in; the first POWER follows after `delay`.
    pub(super) fn begin_session(&mut self, delay: Duration) {
        *self = PowerReports {
            session: true,
            told: None,
            left: delay,
        };
    }

    /// The user has gone.
    pub(super) fn end_session(&mut self) {
        self.session = false;
    }

    /// Lets `dt` pass.
    pub(super) fn step(&mut self, dt: Duration) {
        self.left = self.left.saturating_sub(dt);
    }

    /// Whether this level is to be sent now.
    pub(super) fn due(&self, power: Power) -> bool {
        let changed = self.told.is_some_and(|told| told != power);
        self.session && (changed || self.left.is_zero())
    }

    /// This level was sent; the next POWER is due after `period` at the latest.
    pub(super) fn sent(&mut self, power: Power, period: Duration) {
        (self.told, self.left) = (Some(power), period);
    }
}
