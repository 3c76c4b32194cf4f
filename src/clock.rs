//! The time of day. Code that depends on the date uses this module; everything else uses
//! `tokio::time`. In a simulation the wall clock is virtual too: it starts at a given date and
//! advances with the runtime's clock.

mod span;

use std::cell::Cell;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use jiff::civil::DateTime;
use jiff::tz::{self, TimeZone, TimeZoneDatabase};
use jiff::{SignedDuration, Timestamp, Zoned};
use serde::{Deserialize, Deserializer, Serialize};
use tokio::time::{Instant, Interval, MissedTickBehavior, interval, sleep_until};

pub use span::Span;

use crate::yaml;

/// An earlier date means that the computer's clock is not set: no version of this program is older.
const PLAUSIBLE: i64 = 1_767_225_600; // 2026-01-01T00:00:00Z
/// Default start of virtual time: a Thursday morning.
const VIRTUAL: i64 = 1_767_258_000; // 2026-01-01T09:00:00Z

thread_local! {
    /// This thread's virtual date, and the instant at which it was set.
    static WALL: Cell<Option<(Timestamp, Instant)>> = const { Cell::new(None) };
}

/// Tells the time of day. Cheap to copy.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Clock {
    offset: SignedDuration,
}

impl Clock {
    /// Returns a clock that shows this date now and then advances with the computer's clock.
    pub fn set_to(date: Timestamp) -> Clock {
        Clock {
            offset: date.duration_since(Timestamp::now()),
        }
    }

    /// Returns a clock that is this many milliseconds ahead of the computer's.
    pub fn ahead(millis: i64) -> Clock {
        Clock {
            offset: SignedDuration::from_millis(millis),
        }
    }

    /// Returns how far this clock is ahead of the computer's, in milliseconds.
    pub fn offset_millis(self) -> i64 {
        i64::try_from(self.offset.as_millis()).unwrap_or(0)
    }

    /// Returns the current time; in a simulation the virtual time.
    pub fn now(self) -> Timestamp {
        let virtually = WALL.get().map(|(date, at)| {
            let passed = SignedDuration::try_from(at.elapsed()).unwrap_or(SignedDuration::MAX);
            date.saturating_add(passed)
        });
        let time = virtually.unwrap_or_else(|| Timestamp::now().saturating_add(self.offset));
        time.unwrap_or(Timestamp::MAX)
    }

    /// Returns the time of day of a recent instant, according to the clock's current setting.
    pub fn time_of(&self, instant: Instant) -> Timestamp {
        let ago = SignedDuration::try_from(instant.elapsed()).unwrap_or_default();
        let now = self.now();
        now.checked_sub(ago).unwrap_or(now)
    }
}

/// Makes the time on this thread virtual, starting at this date; `None`: at the default date. For
/// simulations.
pub fn begin_virtual(date: Option<Timestamp>) {
    let usual = || Timestamp::from_second(VIRTUAL).unwrap_or(Timestamp::UNIX_EPOCH);
    WALL.set(Some((date.unwrap_or_else(usual), Instant::now())));
}

/// Whether a clock that shows this time has been set: a computer without a battery for its clock
/// starts in the past.
pub fn is_plausible(now: Timestamp) -> bool {
    now.as_second() >= PLAUSIBLE
}

/// A date and time of day without a zone, such as `2026-03-29 01:30`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Date(DateTime);

impl Date {
    /// Returns the instant in this zone. For a time that the zone skips, returns a later one; for a
    /// time that occurs twice, the first.
    pub fn at(self, zone: &Zone) -> Timestamp {
        let zoned = zone.time_zone().to_ambiguous_zoned(self.0).compatible();
        zoned.map_or(Timestamp::MAX, |zoned| zoned.timestamp())
    }
}

impl FromStr for Date {
    type Err = ClockError;

    fn from_str(text: &str) -> Result<Date, ClockError> {
        let date = text.trim().parse().map(Date);
        date.map_err(|_| ClockError::Date(text.to_owned()))
    }
}

/// Formats a time for people: `Sun 2026-03-29 01:30`.
pub fn describe(time: &Zoned) -> String {
    time.strftime("%a %Y-%m-%d %H:%M").to_string()
}

/// Formats a duration for people, in hours, minutes and whole seconds: `1:02:05`.
pub fn hours(time: Duration) -> String {
    let seconds = time.as_secs();
    let hours = seconds / 3600;
    let minutes = seconds / 60 % 60;
    format!("{hours}:{minutes:02}:{:02}", seconds % 60)
}

/// Ticks in this period, at once for the first time; a tick that is late delays those after it.
pub fn every(period: Duration) -> Interval {
    let mut ticks = interval(period);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    ticks
}

/// Sleeps until the deadline; without one, never returns. Cancel-safe, for the branches of
/// `select!`.
pub async fn until(deadline: Option<Instant>) {
    or_never(deadline.map(sleep_until)).await;
}

/// Waits for what may come; without it, never returns. As cancel-safe as that is.
pub async fn or_never<T>(future: Option<impl Future<Output = T>>) -> T {
    match future {
        Some(future) => future.await,
        None => std::future::pending().await,
    }
}

const SPAN_EXPECTED: &str =
    "a duration such as 90s, 30m, 1h30m or 7d, or a number of seconds, at most 366d";

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ClockError {
    #[error("`{0}` is not a date such as \"2026-03-29 01:30\"")]
    Date(String),
    #[error("expected {SPAN_EXPECTED}, found `{0}`")]
    Span(String),
    #[error("there is no time zone `{0}`")]
    Zone(String),
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Zone {
    name: String,
    #[serde(skip)]
    rules: TimeZone,
}

impl Zone {
    pub fn utc() -> Zone {
        Zone {
            name: "UTC".to_owned(),
            rules: TimeZone::UTC,
        }
    }

    /// Returns the computer's time zone if its name is known; otherwise universal time.
    pub fn system() -> Zone {
        let system = TimeZone::system();
        let named = system.iana_name().and_then(|name| name.parse().ok());
        named.unwrap_or_else(Zone::utc)
    }

    /// Returns the name, such as `Europe/Rome`.
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn time(&self, instant: Timestamp) -> Zoned {
        instant.to_zoned(self.rules.clone())
    }

    pub fn time_zone(&self) -> &tz::TimeZone {
        &self.rules
    }
}

impl FromStr for Zone {
    type Err = ClockError;

    fn from_str(name: &str) -> Result<Zone, ClockError> {
        if name.eq_ignore_ascii_case("utc") {
            return Ok(Zone::utc());
        }
        let rules = TimeZoneDatabase::bundled().get(name);
        let rules = rules.map_err(|_| ClockError::Zone(name.to_owned()))?;
        let name = rules.iana_name().unwrap_or(name).to_owned();
        Ok(Zone { name, rules })
    }
}

impl fmt::Display for Zone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name)
    }
}

impl<'de> Deserialize<'de> for Zone {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Zone, D::Error> {
        let expected = "the name of a time zone, such as Europe/Rome";
        yaml::parsed_text(from, expected, |name| {
            let zone = name.parse::<Zone>();
            zone.map_err(|why| format!("{why}, expected one such as Europe/Rome or UTC"))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_is_shown_in_hours_minutes_and_seconds() {
        assert_eq!(hours(Duration::from_secs(3725)), "1:02:05");
        assert_eq!(hours(Duration::from_secs(90_061)), "25:01:01");
    }

    #[test]
    fn a_date_becomes_an_instant_of_its_zone_across_clock_changes() {
        let rome: Zone = "Europe/Rome".parse().unwrap();
        let at = |text: &str| text.parse::<Date>().unwrap().at(&rome).to_string();
        assert_eq!(at("2026-01-05 09:00"), "2026-01-05T08:00:00Z");
        assert_eq!(
            at("2026-03-29 02:30"),
            "2026-03-29T01:30:00Z",
            "does not exist"
        );
        assert_eq!(
            at("2026-10-25 02:30"),
            "2026-10-25T00:30:00Z",
            "the first of two"
        );
        assert!("2026-13-01 09:00".parse::<Date>().is_err());
    }

    #[test]
    fn a_clock_that_was_set_advances_from_there() {
        let date = Timestamp::from_second(VIRTUAL).unwrap();
        let clock = Clock::set_to(date);
        let passed = clock.now().duration_since(date);
        assert!(passed >= SignedDuration::ZERO && passed < SignedDuration::from_secs(60));
        let other = Clock::ahead(clock.offset_millis());
        assert!(other.now().duration_since(clock.now()).abs() < SignedDuration::from_secs(60));
    }

    #[tokio::test(start_paused = true)]
    async fn virtual_time_advances_with_the_runtime() {
        begin_virtual(None);
        let began = Clock::default().now();
        assert_eq!(began.to_string(), "2026-01-01T09:00:00Z");
        tokio::time::sleep(std::time::Duration::from_secs(86_400)).await;
        assert_eq!(Clock::default().now().to_string(), "2026-01-02T09:00:00Z");
        WALL.set(None);
    }

    #[test]
    fn a_clock_at_its_beginning_is_not_plausible() {
        assert!(!is_plausible(Timestamp::UNIX_EPOCH));
        assert!(is_plausible(Timestamp::from_second(PLAUSIBLE).unwrap()));
    }
}
