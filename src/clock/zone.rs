//! A time zone by its name, such as `Europe/Rome`. The rules are built into the program, so they
//! are also available in a confined process and on a computer without a time zone database.

use std::fmt;
use std::str::FromStr;

use jiff::Timestamp;
use jiff::tz::{TimeZone, TimeZoneDatabase};
use jiff::{Zoned, tz};
use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::ClockError;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Zone {
    name: String,
    rules: TimeZone,
}

impl Zone {
    /// Returns universal time.
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

    /// Converts an instant to the local time of this zone.
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

impl Serialize for Zone {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str(&self.name)
    }
}

impl<'de> Deserialize<'de> for Zone {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Zone, D::Error> {
        struct ZoneVisitor;
        impl Visitor<'_> for ZoneVisitor {
            type Value = Zone;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the name of a time zone, such as Europe/Rome")
            }

            fn visit_str<E: Error>(self, name: &str) -> Result<Zone, E> {
                name.parse().map_err(|why: ClockError| {
                    E::custom(format_args!(
                        "{why}, expected one such as Europe/Rome or UTC"
                    ))
                })
            }
        }
        from.deserialize_str(ZoneVisitor)
    }
}
