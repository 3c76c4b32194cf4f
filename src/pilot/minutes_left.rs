//! Estimates how many minutes the battery lasts at its recent drain, for people: no rule depends on
//! it.
//!
//! Levels come in whole percents, so time is counted from one fall of the level to the next.

use std::collections::VecDeque;

use tokio::time::Instant;

use crate::robot::Battery;

/// The last falls of the level while the battery does not charge.
#[derive(Debug, Default)]
pub(super) struct MinutesLeft {
    level: Option<u8>,
    falls: VecDeque<(u8, Instant)>,
}

impl MinutesLeft {
    /// The estimate uses the last ten percents (a level that falls by more at once says nothing) ...
    const MOST_PERCENT: u8 = 10;
    /// ... and at least two.
    const LEAST_PERCENT: u8 = 2;
    /// A level that rises by up to this many points is rounding noise.
    const FLICKER: u8 = 2;

    /// Forgets everything: the link is lost, and what the robot does meanwhile is not known.
    pub(super) fn forget(&mut self) {
        *self = MinutesLeft::default();
    }

    /// Takes in a level that is believed.
    pub(super) fn level(&mut self, battery: Battery, now: Instant) {
        let percent = battery.percent.get();
        if battery.charging {
            return self.forget();
        }
        let Some(before) = self.level else {
            self.level = Some(percent);
            return;
        };
        let rises = percent > before.saturating_add(MinutesLeft::FLICKER);
        let leaps = before > percent.saturating_add(MinutesLeft::MOST_PERCENT);
        if rises || leaps {
            self.forget();
            self.level = Some(percent);
        } else if percent < before {
            self.level = Some(percent);
            self.falls.push_back((percent, now));
            let oldest = percent.saturating_add(MinutesLeft::MOST_PERCENT);
            self.falls.retain(|(level, _)| *level <= oldest);
        }
    }

    /// The minutes until the battery is empty; `None` while it charges, and before its level has
    /// fallen far enough.
    pub(super) fn estimate(&self) -> Option<f32> {
        let (first, began) = *self.falls.front()?;
        let (last, ended) = *self.falls.back()?;
        let used = first - last;
        if used < MinutesLeft::LEAST_PERCENT {
            return None;
        }
        let minutes = ended.saturating_duration_since(began).as_secs_f32() / 60.0;
        let left = minutes / f32::from(used) * f32::from(last);
        Some((left * 10.0).round() / 10.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;
    use std::time::Duration;

    /// The estimate after these levels, one a minute.
    fn after(levels: &[u8]) -> Option<f32> {
        let mut left = MinutesLeft::default();
        let start = Instant::now();
        for (minute, level) in (0..).zip(levels) {
            let battery = Battery {
                percent: Percent::saturating(*level),
                charging: false,
                minutes_left: None,
            };
            left.level(battery, start + Duration::from_secs(60 * minute));
        }
        left.estimate()
    }

    #[test]
    fn the_drain_is_measured_between_two_falls_of_the_level() {
        assert_eq!(after(&[60, 60, 59]), None);
        assert_eq!(after(&[60, 60, 59, 58]), None);
        assert_eq!(after(&[60, 59, 58, 57]), Some(57.0));
        assert_eq!(after(&[60, 60, 60, 59, 59, 58, 58, 57]), Some(114.0));
        assert_eq!(after(&[60, 59, 60, 58, 59, 57]), Some(114.0), "it flickers");
    }

    #[test]
    fn an_old_drain_is_forgotten() {
        let slow = [100, 100, 100, 100, 99, 99, 99, 99];
        let fast: Vec<u8> = (70..=98).rev().collect();
        assert_eq!(after(&[&slow[..], &fast].concat()), Some(70.0));
    }

    #[test]
    fn charging_and_another_battery_begin_anew() {
        assert_eq!(after(&[60, 59, 58, 57, 90]), None);
        assert_eq!(after(&[60, 59, 58, 57, 46]), None);
        let mut left = MinutesLeft::default();
        let now = Instant::now();
        let battery = |percent, charging| Battery {
            percent: Percent::saturating(percent),
            charging,
            minutes_left: None,
        };
        for percent in [60, 59, 58, 57] {
            left.level(battery(percent, false), now);
        }
        assert!(left.estimate().is_some());
        left.level(battery(57, true), now);
        assert_eq!(left.estimate(), None);
    }
}
