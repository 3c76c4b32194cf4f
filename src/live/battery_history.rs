//! The history of the battery level, for its plot: bounded in size, coarser for older values.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::Battery;

/// Maximum number of points; beyond that, every other point of the older half is deleted.
const MAX_POINTS: usize = 600;
/// Interval at which an unchanged level is recorded.
const EVERY: Duration = Duration::from_secs(30);

#[derive(Debug, Clone, Copy)]
struct Point {
    at: Instant,
    percent: u8,
    charging: bool,
}

#[derive(Debug, Default)]
pub(super) struct BatteryHistory(VecDeque<Point>);

impl BatteryHistory {
    /// Records a level if it has changed or the last record is old. Returns whether it was
    /// recorded.
    pub(super) fn record(&mut self, battery: Battery, at: Instant) -> bool {
        let percent = battery.percent.get();
        let charging = battery.charging;
        let same = |last: &Point| (last.percent, last.charging) == (percent, charging);
        let fresh = |last: &Point| at.saturating_duration_since(last.at) < EVERY;
        if self.0.back().is_some_and(|last| same(last) && fresh(last)) {
            return false;
        }
        self.0.push_back(Point {
            at,
            percent,
            charging,
        });
        if self.0.len() > MAX_POINTS {
            let mut index = 0;
            self.0.retain(|_| {
                index += 1;
                index > MAX_POINTS / 2 || index % 2 == 1
            });
        }
        true
    }

    /// Returns seconds before now, percent, charging; oldest first.
    pub(super) fn points(&self, now: Instant) -> Vec<(f32, u8, bool)> {
        let ago = |at| now.saturating_duration_since(at).as_secs_f32();
        self.0
            .iter()
            .map(|point| (ago(point.at), point.percent, point.charging))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;

    fn battery(percent: u8) -> Battery {
        Battery {
            percent: Percent::saturating(percent),
            charging: false,
            minutes_left: None,
        }
    }

    #[test]
    fn a_month_fits_and_includes_the_newest_and_the_oldest() {
        let mut history = BatteryHistory::default();
        let start = Instant::now();
        for hour in 0..24 * 30 {
            let at = start + Duration::from_secs(3600) * hour;
            assert!(history.record(battery((hour % 100) as u8), at));
            assert!(!history.record(battery((hour % 100) as u8), at));
        }
        let points = history.points(start + Duration::from_secs(3600) * 24 * 30);
        assert!(points.len() <= MAX_POINTS, "{}", points.len());
        assert!(points[0].0 > points[1].0);
        assert_eq!(points.last().map(|last| last.0), Some(3600.0));
    }
}
