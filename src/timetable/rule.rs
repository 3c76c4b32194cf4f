//! The timetable of the config, its view for display, and the starts that it leads to.

use std::fmt;
use std::str::FromStr;

use jiff::civil::Time;
use jiff::{Timestamp, Unit};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use tokio::sync::watch;

use super::pattern::TimetableError;
use super::{Hold, Pattern};
use crate::clock::{self, Span, Zone};
use crate::yaml;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// The behaviour, by its name.
    pub run: String,
    /// The start times: minute, hour, day of the month, month, day of the week.
    #[schemars(with = "String")]
    pub at: Pattern,
    /// The longest run, such as `30m`, or a number of seconds [default: until it ends on its own].
    #[serde(rename = "for", default, skip_serializing_if = "Option::is_none")]
    pub lasts: Option<Span>,
}

/// All rules, and the settings that apply to them.
#[derive(Debug, Clone, PartialEq)]
pub struct Timetable {
    /// In the order of the config.
    pub rules: Vec<Rule>,
    /// The time zone of all times.
    pub zone: Zone,
    pub quiet: Option<Quiet>,
    /// A start that was missed by at most this is made up for.
    pub catch_up: Span,
}

/// A start of the timetable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Start")]
pub struct NextStart {
    /// The time in UTC, in RFC 3339 format: `2026-05-04T07:00:00Z`.
    #[schemars(with = "String", extend("format" = "date-time"))]
    pub at: Timestamp,
    /// The behaviour.
    pub behaviour: String,
    /// Whether a person wants it to be left out.
    #[serde(default)]
    pub skipped: bool,
}

impl NextStart {
    /// The start in words, such as `patrol Sun 2026-03-29 01:30 (left out)`.
    pub fn describe(&self, zone: &Zone) -> String {
        let at = clock::describe(&zone.time(self.at));
        let skipped = if self.skipped { " (left out)" } else { "" };
        format!("{} {at}{skipped}", self.behaviour)
    }
}

/// The next start and the quiet hours. Both are unset in a run without a timetable.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct View {
    /// The next start of the timetable.
    pub next: Option<NextStart>,
    pub hold: Hold,
    pub quiet: bool,
    /// The behaviours that are always on, and so not what a person wants to start.
    pub always: Vec<String>,
}

impl View {
    /// Creates the channel through which a service publishes its view.
    pub fn channel() -> (watch::Sender<View>, watch::Receiver<View>) {
        watch::channel(View::default())
    }
}

const MAX_STARTS: usize = 10_000;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PredictedStart {
    pub at: Timestamp,
    pub run: String,
    /// When it is ended, if it has not ended on its own.
    pub until: Option<Timestamp>,
    pub reasons: Vec<Reason>,
}

impl PredictedStart {
    /// Whether the behaviour will be started, as far as can be predicted.
    pub fn happens(&self) -> bool {
        self.reasons.iter().all(|reason| *reason == Reason::Quiet)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(inline)]
pub enum Reason {
    /// It is a quiet hour: no sounds and no headlight.
    Quiet,
    /// It still runs from an earlier start.
    Overlap,
    /// The config has no behaviour of this name.
    Unknown,
    /// A person wants it to be left out.
    Skipped,
}

impl Timetable {
    /// Returns the names in the rules that no behaviour has, in the order of the rules.
    pub fn unknown<'a>(&'a self, known: &[String]) -> Vec<&'a str> {
        let runs = self.rules.iter().map(|rule| rule.run.as_str());
        runs.filter(|run| !known.iter().any(|name| name == run))
            .collect()
    }
}

/// Returns the next starts after an instant and after a pause, assuming that every run lasts as
/// planned. `known` are the config's behaviours.
pub fn predict_starts(
    table: &Timetable,
    hold: &Hold,
    known: &[String],
    after: Timestamp,
    count: usize,
) -> Vec<PredictedStart> {
    let next = |rule: usize, after| table.rules[rule].at.next_after(after, &table.zone);
    let after = hold.first_after(after);
    let mut due: Vec<Option<Timestamp>> = (0..table.rules.len())
        .map(|rule| next(rule, after))
        .collect();
    let mut found: Vec<PredictedStart> = Vec::new();
    while found.len() < count.min(MAX_STARTS) {
        let soonest = due.iter().enumerate();
        let soonest = soonest.filter_map(|(rule, at)| Some(((*at)?, rule)));
        let Some((at, rule)) = soonest.min() else {
            break;
        };
        due[rule] = next(rule, at);
        let rule = &table.rules[rule];
        let lasts = rule.lasts.map(|lasts| lasts.get());
        let mut reasons = Vec::new();
        if !known.contains(&rule.run) {
            reasons.push(Reason::Unknown);
        }
        if hold.shown(at, &rule.run).skipped {
            reasons.push(Reason::Skipped);
        }
        let runs = |other: &&PredictedStart| other.run == rule.run && other.happens();
        let last = found.iter().rev().find(runs);
        if last.is_some_and(|last| last.at == at || last.until.is_some_and(|until| until > at)) {
            reasons.push(Reason::Overlap);
        }
        if table
            .quiet
            .is_some_and(|quiet| quiet.covers(at, &table.zone))
        {
            reasons.push(Reason::Quiet);
        }
        found.push(PredictedStart {
            at,
            run: rule.run.clone(),
            until: lasts.and_then(|lasts| at.checked_add(lasts).ok()),
            reasons,
        });
    }
    found
}

/// A span from one time of day to another, which is on the next day if it is earlier.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quiet {
    from: Time,
    to: Time,
}

impl Quiet {
    pub fn covers(&self, instant: Timestamp, zone: &Zone) -> bool {
        let time = zone.time(instant).time();
        if self.from <= self.to {
            (self.from..self.to).contains(&time)
        } else {
            time >= self.from || time < self.to
        }
    }
}

impl FromStr for Quiet {
    type Err = TimetableError;

    fn from_str(text: &str) -> Result<Quiet, TimetableError> {
        let wrong = || TimetableError::Quiet(text.to_owned());
        let (from, to) = text.split_once('-').ok_or_else(wrong)?;
        let time = |text: &str| {
            let time: Option<Time> = text.trim().parse().ok();
            time.filter(|time| time.round(Unit::Minute).ok() == Some(*time))
        };
        match (time(from), time(to)) {
            (Some(from), Some(to)) if from != to => Ok(Quiet { from, to }),
            _ => Err(wrong()),
        }
    }
}

impl fmt::Display for Quiet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words = |time: Time| time.strftime("%H:%M").to_string();
        write!(f, "{}-{}", words(self.from), words(self.to))
    }
}

impl Serialize for Quiet {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Quiet {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Quiet, D::Error> {
        yaml::parsed_text(from, "hours such as 22:00-07:00", |text| {
            Quiet::from_str(text).map_err(|why| format!("{why}, expected two times of day"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Date;

    #[test]
    fn a_night_begins_in_the_evening_and_ends_in_the_morning() {
        let (quiet, zone): (Quiet, Zone) = (
            "22:00-07:00".parse().unwrap(),
            "Europe/Rome".parse().unwrap(),
        );
        let at = |time: &str| {
            let date: Date = format!("2026-03-29 {time}").parse().unwrap();
            quiet.covers(date.at(&zone), &zone)
        };
        assert!(at("22:00") && at("23:59") && at("00:00") && at("06:59"));
        assert!(!at("21:59") && !at("07:00") && !at("12:00"));
        let noon: Quiet = "12:00 - 14:30".parse().unwrap();
        assert_eq!(noon.to_string(), "12:00-14:30");
        for wrong in [
            "22:00",
            "22-7",
            "22:00-22:00",
            "25:00-07:00",
            "a-b",
            "22:00-07:00:30",
        ] {
            assert!(wrong.parse::<Quiet>().is_err(), "{wrong}");
        }
    }
}
