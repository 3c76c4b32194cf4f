//! The values of `--since` and `--until`: an age, a date, or a date and a time.

use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use jiff::{SignedDuration, Timestamp};

use crate::cli::argument::ArgumentError;

/// A point in time, as given on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Moment {
    /// This long before now.
    Ago(SignedDuration),
    At(DateTime),
}

/// A time outside the range of the calendar.
#[derive(Debug, thiserror::Error)]
#[error("there is no such time: {0}")]
pub(super) struct NoSuchTime(#[from] jiff::Error);

pub(super) fn parse(text: &str) -> Result<Moment, ArgumentError> {
    let text = text.trim();
    let at = || text.parse::<DateTime>().ok().map(Moment::At);
    let moment = ago(text).map(Moment::Ago).or_else(at);
    moment.ok_or(ArgumentError::Moment)
}

/// Parses a number with a unit.
fn ago(text: &str) -> Option<SignedDuration> {
    let unit = text.chars().next_back()?;
    let number: f64 = text[..text.len() - unit.len_utf8()].parse().ok()?;
    let seconds = match unit {
        's' => 1.0,
        'm' => 60.0,
        'h' => 3600.0,
        'd' => 86_400.0,
        'w' => 7.0 * 86_400.0,
        _ => return None,
    };
    let long = number * seconds;
    // At most a century.
    if !(0.0..=36_525.0 * 86_400.0).contains(&long) {
        return None;
    }
    Some(SignedDuration::from_millis((long * 1000.0) as i64))
}

impl Moment {
    pub(super) fn resolve(&self, now: Timestamp, zone: &TimeZone) -> Result<Timestamp, NoSuchTime> {
        let resolved = match self {
            Moment::Ago(ago) => now.checked_sub(*ago),
            Moment::At(time) => zone
                .to_ambiguous_zoned(*time)
                .compatible()
                .map(|at| at.timestamp()),
        };
        Ok(resolved?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn resolved(text: &str) -> String {
        let now = "2026-11-22T12:00:00Z".parse().unwrap();
        let zone = TimeZone::get("Europe/Rome").unwrap();
        let at = parse(text).unwrap().resolve(now, &zone).unwrap();
        at.to_string()
    }

    #[test]
    fn ages_dates_and_times_are_understood() {
        assert_eq!(resolved("90m"), "2026-11-22T10:30:00Z");
        assert_eq!(resolved("7d"), "2026-11-15T12:00:00Z");
        assert_eq!(resolved("0.5h"), "2026-11-22T11:30:00Z");
        assert_eq!(resolved("2026-11-01"), "2026-10-31T23:00:00Z");
        assert_eq!(resolved("2026-11-01T21:30"), "2026-11-01T20:30:00Z");
        assert_eq!(resolved("2026-11-01 21:30"), "2026-11-01T20:30:00Z");
    }

    #[test]
    fn a_time_in_the_hour_that_the_clock_skips_is_moved_forward() {
        assert_eq!(resolved("2026-03-29T02:30"), "2026-03-29T01:30:00Z");
    }

    #[test]
    fn the_error_for_invalid_text_names_the_expected_form() {
        for text in [
            "",
            "yesterday",
            "7",
            "-1d",
            "7x",
            "2026-13-01",
            "nand",
            "infd",
            "1e9w",
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains("7d"), "{text}: {error}");
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "\\PC{0,30}") {
            if let Ok(moment) = parse(&text) {
                let _ = moment.resolve(Timestamp::now(), &TimeZone::UTC);
            }
        }
    }
}
