//! Quantities with their ranges. Each is checked while a YAML file is parsed, so that the error
//! names line and column of the wrong value.

use std::fmt;
use std::time::Duration;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::yaml;

/// A whole percentage, 0..=100.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, schemars::JsonSchema)]
#[schemars(inline)]
pub struct Percent(#[schemars(range(max = 100))] u8);

impl Percent {
    /// `None` above 100.
    pub const fn new(percent: u8) -> Option<Percent> {
        if percent <= 100 {
            Some(Percent(percent))
        } else {
            None
        }
    }

    pub const fn saturating(percent: u8) -> Percent {
        Percent(if percent <= 100 { percent } else { 100 })
    }

    pub const fn get(self) -> u8 {
        self.0
    }
}

impl fmt::Display for Percent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} %", self.0)
    }
}

/// Power of one track in the wire's units, -90..=90, negative backwards (`PROTOCOL.md`, MOVE).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct TrackPower(i8);

impl TrackPower {
    pub const STOP: TrackPower = TrackPower(0);
    /// The largest power that is ever sent, in the wire's units.
    pub const MAX: i8 = 90;

    /// `None` outside of -90..=90.
    pub fn new(power: i8) -> Option<TrackPower> {
        (-TrackPower::MAX..=TrackPower::MAX)
            .contains(&power)
            .then_some(TrackPower(power))
    }

    /// `round(percent * 0.9)`; `None` unless `percent` is a number in -100..=100.
    pub fn from_percent(percent: f64) -> Option<TrackPower> {
        let inside = (-100.0..=100.0).contains(&percent);
        inside.then(|| TrackPower((percent * f64::from(Self::MAX) / 100.0).round() as i8))
    }

    pub fn get(self) -> i8 {
        self.0
    }
}

/// A duration that the config gives as a number of seconds, 0.05..=86,400.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, schemars::JsonSchema)]
#[schemars(inline)]
pub struct Seconds(#[schemars(with = "f64", range(min = 0.05, max = 86_400))] Duration);

impl Seconds {
    pub const fn from_secs(seconds: u64) -> Seconds {
        Seconds(Duration::from_secs(seconds))
    }

    pub const fn from_millis(milliseconds: u64) -> Seconds {
        Seconds(Duration::from_millis(milliseconds))
    }

    /// `None` unless `seconds` is a number in 0.05..=86,400.
    pub fn new(seconds: f64) -> Option<Seconds> {
        let inside = (0.05..=86_400.0).contains(&seconds);
        inside.then(|| Seconds(Duration::from_secs_f64(seconds)))
    }

    pub const fn get(self) -> Duration {
        self.0
    }
}

impl<'de> Deserialize<'de> for Percent {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Percent, D::Error> {
        let percent = yaml::whole("a whole number from 0 to 100 (percent)", 0..=100);
        deserializer.deserialize_u8(percent).map(Percent)
    }
}

impl<'de> Deserialize<'de> for TrackPower {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<TrackPower, D::Error> {
        let make = |number: f64| {
            if number.fract() == 0.0 {
                TrackPower::new(number as i8)
            } else {
                None
            }
        };
        deserializer.deserialize_i8(yaml::number("a whole number from -90 to 90", make))
    }
}

impl<'de> Deserialize<'de> for Seconds {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Seconds, D::Error> {
        let expected = "a number of seconds from 0.05 to 86400";
        deserializer.deserialize_f64(yaml::number(expected, Seconds::new))
    }
}

impl Serialize for Seconds {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_f64(self.0.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn percent_of_power_is_rounded_to_the_wires_units() {
        let wire = |percent| TrackPower::from_percent(percent).map(TrackPower::get);
        assert_eq!(wire(100.0), Some(90));
        assert_eq!(wire(-100.0), Some(-90));
        assert_eq!(wire(50.0), Some(45));
        assert_eq!(wire(-0.4), Some(0));
        assert_eq!(wire(0.6), Some(1));
    }

    #[test]
    fn power_beyond_a_hundred_and_nan_are_refused() {
        for percent in [100.01, -101.0, f64::NAN, f64::INFINITY] {
            assert_eq!(TrackPower::from_percent(percent), None);
        }
        assert!(postcard::from_bytes::<TrackPower>(&[91]).is_err());
        assert!(postcard::from_bytes::<Percent>(&[101]).is_err());
    }

    #[test]
    fn quantities_survive_the_transfer_between_processes() {
        let all = (Percent(100), TrackPower(-90), Seconds::from_millis(250));
        let bytes = postcard::to_allocvec(&all).unwrap();
        assert_eq!(
            postcard::from_bytes::<(Percent, TrackPower, Seconds)>(&bytes),
            Ok(all)
        );
    }

    fn yaml_error<T: for<'de> Deserialize<'de> + fmt::Debug>(text: &str) -> String {
        serde_yaml::from_str::<BTreeMap<String, T>>(text)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn wrong_values_are_refused_with_their_position() {
        let error = yaml_error::<Percent>("a: 20\nb: 120\n");
        assert!(
            error.contains("`120`") && error.contains("line 2 column 4"),
            "{error}"
        );
        assert!(error.contains("from 0 to 100"), "{error}");
        let error = yaml_error::<Percent>("b: 12.5\n");
        assert!(error.contains("line 1 column 4"), "{error}");
        let error = yaml_error::<Seconds>("b: .nan\n");
        assert!(
            error.contains("0.05 to 86400") && error.contains("line 1"),
            "{error}"
        );
        let error = yaml_error::<Seconds>("b: soon\n");
        assert!(
            error.contains("0.05 to 86400") && error.contains("line 1"),
            "{error}"
        );
    }

    #[test]
    fn whole_and_fractional_seconds_are_read() {
        let read: BTreeMap<String, Seconds> = serde_yaml::from_str("a: 3\nb: 0.25\n").unwrap();
        assert_eq!(read["a"], Seconds::from_secs(3));
        assert_eq!(read["b"], Seconds::from_millis(250));
    }
}
