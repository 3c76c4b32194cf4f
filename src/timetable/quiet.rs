//! The quiet hours, in which the robot makes no sound and its headlight stays off.

use std::fmt;
use std::str::FromStr;

use jiff::civil::Time;
use jiff::{Timestamp, Unit};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::pattern::TimetableError;
use crate::clock::Zone;
use crate::yaml;

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
