//! When something in a world is on: from a start time, for a duration, periodically.

use serde::Deserialize;

use crate::sim::yaml::number;

/// A schedule, in simulated seconds since the start.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Schedule {
    /// The first beginning, seconds.
    #[serde(default, deserialize_with = "number::span")]
    pub after: f64,
    /// Duration of each occurrence, seconds; unlimited if omitted.
    #[serde(default, rename = "for")]
    pub lasts: Option<Seconds>,
    /// Period from one beginning to the next, seconds; once only if omitted or 0.
    #[serde(default)]
    pub every: Option<Seconds>,
}

/// A number of seconds, 0..=86,400.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct Seconds(#[serde(deserialize_with = "number::span")] pub f64);

impl Schedule {
    /// Whether the schedule is on at a time, in seconds.
    pub fn holds(&self, seconds: f64) -> bool {
        let since = seconds - self.after;
        if since < 0.0 {
            return false;
        }
        let since = match self.every {
            Some(Seconds(every)) if every > 0.0 => since % every,
            _ => since,
        };
        self.lasts.is_none_or(|Seconds(lasts)| since < lasts)
    }
}

/// Whether something is on at a time: during `on`, or always without it, except during `off`.
pub(crate) fn lit(on: Option<Schedule>, off: Option<Schedule>, seconds: f64) -> bool {
    let in_on = on.is_none_or(|times| times.holds(seconds));
    in_on && !off.is_some_and(|times| times.holds(seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn times(yaml: &str) -> Schedule {
        serde_yaml::from_str(yaml).unwrap()
    }

    #[test]
    fn a_schedule_begins_ends_and_repeats() {
        let times = times("{after: 10, for: 5, every: 20}");
        let on: Vec<u32> = (0..60).filter(|t| times.holds(f64::from(*t))).collect();
        assert_eq!(
            on,
            [10, 11, 12, 13, 14, 30, 31, 32, 33, 34, 50, 51, 52, 53, 54]
        );
    }

    #[test]
    fn an_omitted_duration_is_unlimited_and_an_omitted_period_means_once() {
        assert!(times("{after: 3}").holds(1e6) && !times("{after: 3}").holds(2.9));
        assert!(times("{for: 4}").holds(0.0) && !times("{for: 4}").holds(4.0));
    }

    #[test]
    fn off_takes_precedence_over_on() {
        let on = Some(times("{after: 2}"));
        let off = Some(times("{after: 4, for: 1}"));
        let seen: Vec<bool> = [1.0, 3.0, 4.5, 6.0].map(|t| lit(on, off, t)).to_vec();
        assert_eq!(seen, [false, true, false, true]);
        assert!(lit(None, None, 0.0));
    }
}
