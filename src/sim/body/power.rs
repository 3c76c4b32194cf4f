//! When the robot sends POWER: first after a delay from the login, then on every change and at the
//! end of each period (how often a real robot sends it is not known: `PROTOCOL.md`, *Not known*).
//! The reported level can be configured to lag behind.

use std::collections::VecDeque;
use std::time::Duration;

use crate::wire::Power;

/// Maximum number of levels kept: far more than the changes within the longest delay.
const MAX_LEVELS: usize = 1000;

/// The last reported level, and when the next POWER is due.
#[derive(Debug, Default)]
pub(super) struct PowerReports {
    session: bool,
    last_reported: Option<Power>,
    left: Duration,
    /// How far the reported level lags behind.
    lag: Duration,
    /// The level to report, followed by the newer ones, each with its age.
    levels: VecDeque<(Duration, Power)>,
}

impl PowerReports {
    /// Creates reports that lag behind by `lag`.
    pub(super) fn new(lag: Duration) -> PowerReports {
        PowerReports {
            lag,
            ..PowerReports::default()
        }
    }

    /// Starts the session of a user; the first POWER follows after `delay`.
    pub(super) fn begin_session(&mut self, delay: Duration) {
        (self.session, self.last_reported, self.left) = (true, None, delay);
    }

    /// Ends the session: the user has disconnected.
    pub(super) fn end_session(&mut self) {
        self.session = false;
    }

    /// Advances by `dt`.
    pub(super) fn step(&mut self, dt: Duration) {
        self.left = self.left.saturating_sub(dt);
        for (age, _) in &mut self.levels {
            *age += dt;
        }
    }

    /// Records the battery's current level and returns the level to report.
    pub(super) fn level(&mut self, power: Power) -> Power {
        if self
            .levels
            .back()
            .is_none_or(|(_, newest)| *newest != power)
        {
            self.levels.push_back((Duration::ZERO, power));
        }
        let old =
            |entry: Option<&(Duration, Power)>| entry.is_some_and(|(age, _)| *age >= self.lag);
        while old(self.levels.get(1)) || self.levels.len() > MAX_LEVELS {
            self.levels.pop_front();
        }
        self.levels.front().map_or(power, |(_, level)| *level)
    }

    /// Whether this level must be sent now.
    pub(super) fn due(&self, power: Power) -> bool {
        let changed = self
            .last_reported
            .is_some_and(|last_reported| last_reported != power);
        self.session && (changed || self.left.is_zero())
    }

    /// Records that this level was sent; the next POWER is due after `period` at the latest.
    pub(super) fn sent(&mut self, power: Power, period: Duration) {
        (self.last_reported, self.left) = (Some(power), period);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_reported_when_it_is_old_enough() {
        let power = |percent| Power {
            percent,
            charging: false,
        };
        let second = Duration::from_secs(1);
        let mut reports = PowerReports::new(3 * second);
        assert_eq!(reports.level(power(50)), power(50));
        reports.step(second);
        assert_eq!(reports.level(power(49)), power(50));
        reports.step(2 * second);
        assert_eq!(reports.level(power(48)), power(50));
        reports.step(second);
        assert_eq!(reports.level(power(48)), power(49));
        reports.step(2 * second);
        assert_eq!(reports.level(power(48)), power(48));
        let mut prompt = PowerReports::default();
        for percent in [50, 49, 48] {
            assert_eq!(prompt.level(power(percent)), power(percent));
        }
    }
}
