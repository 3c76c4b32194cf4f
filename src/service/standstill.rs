//! Notices that the robot stands although a behaviour runs that drives, and why: the history's answer
//! to "why did it stand still at 3 am". Pure.

use std::collections::BTreeSet;
use std::time::Duration;

use tokio::time::Instant;

use crate::pilot::Status;
use crate::robot::{STOP_HOLDS, WatchdogState};

/// A robot that stands for this long for the same reason is worth a row.
const LONG: Duration = Duration::from_secs(300);

#[derive(Debug, Default)]
pub(super) struct Standstill {
    running: BTreeSet<String>,
    /// Whether the robot has driven while these behaviours run.
    driven: bool,
    /// Why it stands, and since when, until that is told.
    reason: Option<String>,
    since: Option<Instant>,
}

impl Standstill {
    /// Returns why the robot stands, once it has done so for [`LONG`]. `waits_for_runs`: some of what
    /// runs is not always on, so people expect that it does something.
    pub(super) fn poll(
        &mut self,
        status: &Status,
        running: &BTreeSet<String>,
        waits_for_runs: bool,
        now: Instant,
    ) -> Option<String> {
        if self.running != *running {
            *self = Standstill {
                running: running.clone(),
                ..Standstill::default()
            };
        }
        let reason = reason(status);
        // A search alone is the service's own: a guard on its station needs no row.
        self.driven |= !status.actuators.tracks.is_stop();
        let expected = !running.is_empty() && (waits_for_runs || self.driven);
        if !expected || reason != self.reason {
            self.reason = reason;
            self.since = Some(now);
            return None;
        }
        let since = self.since?;
        if now.saturating_duration_since(since) < LONG {
            return None;
        }
        // It is told once.
        self.since = None;
        self.reason.clone()
    }
}

/// Why the robot stands; `None` while it drives, or searches its station.
fn reason(status: &Status) -> Option<String> {
    let searches = matches!(
        status.safety,
        WatchdogState::Docking | WatchdogState::LowGoingHome
    );
    if !status.actuators.tracks.is_stop() || (searches && !status.emergency_stop) {
        return None;
    }
    Some(if status.emergency_stop {
        STOP_HOLDS.to_owned()
    } else if let Some(words) = status.link.absence() {
        words.to_owned()
    } else if status.safety == WatchdogState::Alarm {
        status.safety.to_string()
    } else if status.docked {
        status.dock_state.to_string()
    } else {
        "what runs asks for no motion, or may not move it".to_owned()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pilot::LinkState;
    use crate::robot::Setpoint;
    use crate::safety::DockState;

    fn at_work() -> Status {
        Status {
            link: LinkState::Up,
            safety: WatchdogState::Free,
            ..Status::default()
        }
    }

    #[test]
    fn a_robot_that_stands_while_a_patrol_runs_has_one_row_with_the_reason() {
        let mut still = Standstill::default();
        let patrol = BTreeSet::from(["patrol".to_owned()]);
        let mut drives = at_work();
        drives.actuators.tracks = Setpoint::from_percent(30.0, 30.0).unwrap();
        let charges = Status {
            docked: true,
            dock_state: DockState::Charging,
            ..at_work()
        };
        let stopped = Status {
            emergency_stop: true,
            ..charges
        };
        let mut now = Instant::now();
        let mut rows = Vec::new();
        for (status, minutes) in [
            (drives, 20),
            (at_work(), 4),
            (drives, 1),
            (charges, 90),
            (stopped, 20),
            (drives, 9),
            (at_work(), 6),
        ] {
            for _ in 0..minutes {
                rows.extend(still.poll(&status, &patrol, true, now));
                now += Duration::from_secs(60);
            }
        }
        assert_eq!(
            rows,
            [
                "on its station, charging",
                STOP_HOLDS,
                "what runs asks for no motion, or may not move it"
            ]
        );
    }

    #[test]
    fn a_guard_that_only_watches_has_none_and_a_search_is_no_standstill() {
        let mut still = Standstill::default();
        let guard = BTreeSet::from(["guard".to_owned()]);
        let now = Instant::now();
        for minutes in 0..60 {
            let at = now + Duration::from_secs(60 * minutes);
            assert_eq!(still.poll(&at_work(), &guard, false, at), None);
        }
        let searches = Status {
            safety: WatchdogState::LowGoingHome,
            ..at_work()
        };
        for minutes in 60..120 {
            let at = now + Duration::from_secs(60 * minutes);
            assert_eq!(still.poll(&searches, &guard, true, at), None);
        }
    }
}
