//! Places the marks of a chart's time axis at round local times, also across changes of the clock.

use jiff::civil::{DateTime, Time};
use jiff::tz::TimeZone;
use jiff::{Span, Timestamp};

/// A mark on the axis.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    pub(super) at: Timestamp,
    pub(super) label: String,
    /// Whether it is the start of a day on an axis of hours or minutes.
    pub(super) strong: bool,
}

/// Steps within a day, in minutes.
const MINUTES: &[i64] = &[1, 2, 5, 10, 15, 30, 60, 120, 180, 360, 720];
/// Steps of days.
const DAYS: &[i64] = &[1, 2, 7, 14, 30, 60, 180, 365, 3650];
/// Maximum number of steps tried for an axis.
const MAX_TRIES: i64 = 5000;

/// The marks from `since` to `until`, about `most` at most.
pub(super) fn ticks(since: Timestamp, until: Timestamp, zone: &TimeZone, most: i64) -> Vec<Tick> {
    let long = until.duration_since(since).as_secs().max(1);
    let fits = |step: i64| long / step <= most;
    let minutes = MINUTES.iter().find(|minutes| fits(**minutes * 60));
    let days = DAYS
        .iter()
        .find(|days| fits(**days * 86_400))
        .unwrap_or(&3650);
    let step = match minutes {
        Some(minutes) => Span::new().minutes(*minutes),
        None => Span::new().days(*days),
    };
    let first = since.to_zoned(zone.clone()).datetime();
    let mut at = first.date().to_datetime(Time::midnight());
    let mut ticks: Vec<Tick> = Vec::new();
    for _ in 0..MAX_TRIES {
        let Ok(moment) = zone.to_ambiguous_zoned(at).compatible() else {
            break;
        };
        let moment = moment.timestamp();
        if moment > until {
            break;
        }
        // A time in the hour that the clock skips gets no mark.
        let is_new = ticks.last().is_none_or(|last| last.at < moment);
        if moment >= since && is_new {
            ticks.push(tick(moment, at, minutes.is_some()));
        }
        match at.checked_add(step) {
            Ok(next) => at = next,
            Err(_) => break,
        }
    }
    ticks
}

fn tick(at: Timestamp, local: DateTime, within_days: bool) -> Tick {
    let strong = within_days && local.time() == Time::midnight();
    let pattern = if within_days && !strong {
        "%H:%M"
    } else {
        "%-d %b"
    };
    Tick {
        at,
        label: local.strftime(pattern).to_string(),
        strong,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(since: &str, until: &str) -> Vec<String> {
        let zone = TimeZone::get("Europe/Rome").unwrap();
        let ticks = ticks(since.parse().unwrap(), until.parse().unwrap(), &zone, 10);
        assert!(ticks.len() <= 12, "{ticks:?}");
        assert!(ticks.is_sorted_by(|a, b| a.at < b.at));
        ticks.into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn marks_stand_at_round_local_times() {
        let day = labels("2026-11-21T11:20:00Z", "2026-11-22T11:20:00Z");
        assert_eq!(
            day,
            [
                "15:00", "18:00", "21:00", "22 Nov", "03:00", "06:00", "09:00", "12:00"
            ]
        );
        let week = labels("2026-11-15T12:00:00Z", "2026-11-22T12:00:00Z");
        assert_eq!(week.first().unwrap(), "16 Nov");
        assert_eq!(week.len(), 7);
        let hour = labels("2026-11-22T10:05:00Z", "2026-11-22T11:00:00Z");
        assert_eq!(hour[0], "11:10");
    }

    #[test]
    fn midnights_are_marked_around_a_clock_change() {
        let marks = labels("2026-03-28T12:00:00Z", "2026-03-30T12:00:00Z");
        assert!(
            marks.contains(&"29 Mar".to_owned()) && marks.contains(&"30 Mar".to_owned()),
            "{marks:?}"
        );
    }

    #[test]
    fn a_second_and_a_century_have_axes() {
        assert!(labels("2026-11-22T10:05:00Z", "2026-11-22T10:05:01Z").len() < 3);
        assert!(!labels("1970-01-01T00:00:00Z", "2070-01-01T00:00:00Z").is_empty());
    }
}
