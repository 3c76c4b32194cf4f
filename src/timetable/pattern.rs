//! A pattern of times, such as `0 9,21 * * *`: minute, hour, day of the month, month, and day of
//! the week.

use std::fmt;
use std::str::FromStr;

use croner::Cron;
use croner::parser::{CronParser, Seconds, Year};
use jiff::Timestamp;
use jiff::civil::DateTime;
use jiff::tz::{AmbiguousOffset, TimeZone};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::clock::Zone;
use crate::yaml;

/// Maximum number of wall clock times that a search tries: the clock is never put back so far that
/// more of them occur twice.
const MAX_TRIES: u32 = 4 * 60;
/// Maximum length of a pattern, in bytes.
const MAX_LEN: usize = 200;
/// The parts of a pattern, in order, and the values that each may have.
const PARTS: [(&str, &str); 5] = [
    ("minute", "0 to 59"),
    ("hour", "0 to 23"),
    ("day of the month", "1 to 31"),
    ("month", "1 to 12 or jan to dec"),
    ("day of the week", "0 to 7 or sun to sat"),
];

#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    text: String,
    cron: Cron,
    /// Whether it names no hours.
    intervals: bool,
}

impl Pattern {
    /// Returns the first time after this instant; `None` if there is none.
    pub fn next_after(&self, after: Timestamp, zone: &Zone) -> Option<Timestamp> {
        if self.intervals {
            let next = self.cron.find_next_occurrence(&zone.time(after), false);
            return next.ok().map(|next| next.timestamp());
        }
        let mut at = zone.time(after).datetime();
        for _ in 0..MAX_TRIES {
            at = self.next_on_the_wall(at)?;
            let instant = first_instant(at, zone.time_zone())?;
            if instant > after {
                return Some(instant);
            }
        }
        None
    }

    /// Returns the next wall clock time, ignoring clock changes.
    fn next_on_the_wall(&self, after: DateTime) -> Option<DateTime> {
        let after = after.to_zoned(TimeZone::UTC).ok()?;
        let next = self.cron.find_next_occurrence(&after, false).ok()?;
        Some(next.datetime())
    }
}

/// Returns the instant at which the clock first shows this time, or, if the time is skipped, the
/// instant of the clock change.
fn first_instant(at: DateTime, zone: &TimeZone) -> Option<Timestamp> {
    let ambiguous = zone.to_ambiguous_zoned(at);
    match ambiguous.offset() {
        AmbiguousOffset::Unambiguous { .. } | AmbiguousOffset::Fold { .. } => {
            ambiguous.earlier().ok().map(|zoned| zoned.timestamp())
        }
        AmbiguousOffset::Gap { .. } => {
            let before = ambiguous.earlier().ok()?.timestamp();
            let change = zone.following(before).next()?;
            Some(change.timestamp())
        }
    }
}

impl FromStr for Pattern {
    type Err = TimetableError;

    fn from_str(text: &str) -> Result<Pattern, TimetableError> {
        let wrong = |why: &str| TimetableError::Pattern {
            text: text.to_owned(),
            why: why.to_owned(),
        };
        if text.len() > MAX_LEN {
            return Err(TimetableError::LongPattern);
        }
        // Such a list may match no time at all, which only a search through all years would show.
        if text
            .split_whitespace()
            .flat_map(|field| field.split(','))
            .any(str::is_empty)
        {
            return Err(wrong("a list contains an empty item"));
        }
        let parser = CronParser::builder()
            .seconds(Seconds::Disallowed)
            .year(Year::Disallowed)
            .build();
        let parsed = parser.parse(text);
        let cron = parsed.map_err(|error| {
            if let Some(why) = describe_error(text, &parser) {
                return wrong(&why);
            }
            // Limit the length: the parser quotes a long number several times.
            let why: String = error.to_string().chars().take(MAX_LEN).collect();
            wrong(why.trim_end_matches('.'))
        })?;
        let hours = text.split_whitespace().nth(1);
        let nickname = text.trim().starts_with('@');
        let hourly = text.trim().eq_ignore_ascii_case("@hourly");
        let counts = |field: &str| field.contains(['*', '/', '?']);
        let pattern = Pattern {
            text: text.trim().to_owned(),
            cron,
            intervals: hourly || (!nickname && hours.is_some_and(counts)),
        };
        // Reject a day that no year has, such as the 30th of February.
        let begin = jiff::civil::date(2024, 1, 1).at(0, 0, 0, 0);
        match pattern.next_on_the_wall(begin) {
            Some(_) => Ok(pattern),
            None => Err(wrong("it matches no day")),
        }
    }
}

/// Says what is wrong with a pattern that the parser refuses; `None` if each part is valid by
/// itself.
fn describe_error(text: &str, parser: &CronParser) -> Option<String> {
    if text.trim().starts_with('@') {
        return Some("valid names are @hourly, @daily, @weekly, @monthly and @yearly".to_owned());
    }
    let parts: Vec<&str> = text.split_whitespace().collect();
    if parts.len() != PARTS.len() {
        return Some(format!("it has {} instead of five parts", parts.len()));
    }
    for (index, (name, values)) in PARTS.into_iter().enumerate() {
        let mut alone = ["*"; PARTS.len()];
        alone[index] = parts[index];
        if parser.parse(&alone.join(" ")).is_err() {
            let part = parts[index];
            return Some(format!(
                "`{part}` is no {name}: valid are {values}, lists such as 1,3, rising ranges such \
                 as 1-3, and steps such as */2"
            ));
        }
    }
    None
}

impl fmt::Display for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Serialize for Pattern {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&self.text)
    }
}

impl<'de> Deserialize<'de> for Pattern {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Pattern, D::Error> {
        let expected = "minute, hour, day, month and weekday, such as \"0 9,21 * * *\" for nine \
                        and twenty-one o'clock";
        yaml::parsed_text(from, expected, |text| {
            Pattern::from_str(text)
                .map_err(|why| format!("{why}, expected minute, hour, day, month and weekday"))
        })
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TimetableError {
    /// Not a cron pattern, or a pattern that matches no day.
    #[error("`{text}` is not a pattern of times: {why}")]
    Pattern { text: String, why: String },
    #[error("a pattern of times is at most 200 characters long")]
    LongPattern,
    #[error("`{0}` is not a span of hours such as 22:00-07:00")]
    Quiet(String),
    #[error("there is no timetable: the config has no `schedule:`")]
    NoRules,
    #[error("the computer's clock is not set: the timetable waits until it is")]
    NoClock,
    #[error("`pause` needs a time `until`, the other changes of the timetable have none")]
    Until,
    #[error("`{0}` is no time such as 2026-05-04 18:00, 2026-05-04 or 2026-05-04T16:00:00Z")]
    NoTime(String),
    #[error("the timetable cannot be paused until {0}: that is over")]
    Past(String),
    #[error("the timetable has no next start")]
    NoStart,
    #[error("that is not the next start: it is {0}")]
    OtherStart(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rome() -> Zone {
        "Europe/Rome".parse().unwrap()
    }

    fn times(pattern: &str, from: &str, count: usize) -> Vec<String> {
        let (pattern, zone): (Pattern, Zone) = (pattern.parse().unwrap(), rome());
        let mut at = from.parse::<crate::clock::Date>().unwrap().at(&zone);
        let next = |at: &mut Timestamp| {
            *at = pattern.next_after(*at, &zone).unwrap();
            zone.time(*at).strftime("%d %H:%M %:z").to_string()
        };
        (0..count).map(|_| next(&mut at)).collect()
    }

    #[test]
    fn a_list_with_an_empty_item_is_refused() {
        for text in [
            ", 9,2 * * *",
            "0 9,,21 * * *",
            "0 9, * * *",
            ", , , , ,",
            "0 0 1 1 ,1",
        ] {
            let error = text.parse::<Pattern>().unwrap_err().to_string();
            assert!(error.contains("an empty item"), "{text}: {error}");
        }
    }

    #[test]
    fn local_times_stay_the_same_across_a_clock_change() {
        let spring = times("0 9,21 * * *", "2026-03-28 12:00", 3);
        assert_eq!(
            spring,
            ["28 21:00 +01:00", "29 09:00 +02:00", "29 21:00 +02:00"]
        );
        let autumn = times("0 9,21 * * *", "2026-10-24 12:00", 3);
        assert_eq!(
            autumn,
            ["24 21:00 +02:00", "25 09:00 +01:00", "25 21:00 +01:00"]
        );
    }

    #[test]
    fn a_start_in_the_skipped_hour_happens_once_after_the_change() {
        let expected = ["28 02:30 +01:00", "29 03:00 +02:00", "30 02:30 +02:00"];
        assert_eq!(times("30 2 * * *", "2026-03-28 01:00", 3), expected);
        let several = times("0,30 2,14 * * *", "2026-03-29 01:00", 3);
        assert_eq!(
            several,
            ["29 03:00 +02:00", "29 14:00 +02:00", "29 14:30 +02:00"]
        );
    }

    #[test]
    fn a_time_that_occurs_twice_counts_the_first_time() {
        let expected = ["24 02:30 +02:00", "25 02:30 +02:00", "26 02:30 +01:00"];
        assert_eq!(times("30 2 * * *", "2026-10-24 01:00", 3), expected);
        let several = times("0,30 2,14 * * *", "2026-10-25 01:00", 3);
        assert_eq!(
            several,
            ["25 02:00 +02:00", "25 02:30 +02:00", "25 14:00 +01:00"]
        );
    }

    #[test]
    fn intervals_continue_through_both_changes() {
        let spring = times("*/30 * * * *", "2026-03-29 01:10", 3);
        assert_eq!(
            spring,
            ["29 01:30 +01:00", "29 03:00 +02:00", "29 03:30 +02:00"]
        );
        let autumn = times("*/30 * * * *", "2026-10-25 02:10", 4);
        let expected = [
            "25 02:30 +02:00",
            "25 02:00 +01:00",
            "25 02:30 +01:00",
            "25 03:00 +01:00",
        ];
        assert_eq!(autumn, expected);
    }

    #[test]
    fn a_pattern_with_two_hours_has_two_starts_every_day_of_a_year() {
        let (pattern, zone): (Pattern, Zone) = ("0 9,21 * * *".parse().unwrap(), rome());
        let begin: crate::clock::Date = "2026-01-01 00:00".parse().unwrap();
        let mut at = begin.at(&zone);
        let mut starts = 0;
        while let Some(next) = pattern.next_after(at, &zone) {
            let time = zone.time(next);
            if time.year() > 2026 {
                break;
            }
            assert!(
                [9, 21].contains(&time.hour()) && time.minute() == 0,
                "{time}"
            );
            (at, starts) = (next, starts + 1);
        }
        assert_eq!(starts, 2 * 365);
    }

    #[test]
    fn an_invalid_pattern_is_refused_with_an_explanation() {
        for wrong in [
            "",
            "9:00",
            "0 9 * *",
            "0 25 * * *",
            "0 0 30 2 *",
            "* * * * * *",
            "x x x x x",
        ] {
            let error = wrong.parse::<Pattern>().unwrap_err();
            let error = error.to_string();
            assert!(error.contains("not a pattern of times"), "{wrong}: {error}");
        }
        for (wrong, why) in [
            ("0 9 * *", "it has 4 instead of five parts"),
            ("0 25 * * *", "`25` is no hour: valid are 0 to 23"),
            ("0 17-9 * * *", "`17-9` is no hour"),
            ("0 9 * * Monday", "`Monday` is no day of the week"),
            ("@dayly", "@daily"),
        ] {
            let error = wrong.parse::<Pattern>().unwrap_err().to_string();
            assert!(error.contains(why), "{wrong}: {error}");
        }
        assert!("@daily".parse::<Pattern>().is_ok());
    }
}
