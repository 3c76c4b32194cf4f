//! A duration as people write it: `90s`, `30m`, `1h30m`, `7d`, or a number of seconds.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{ClockError, SPAN_EXPECTED};

/// The maximum in milliseconds: a year.
const LONGEST: u64 = 366 * 86_400_000;
/// The units, in milliseconds.
const UNITS: [(char, u64); 4] = [
    ('d', 86_400_000),
    ('h', 3_600_000),
    ('m', 60_000),
    ('s', 1_000),
];

/// A duration in whole milliseconds, at most a year.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span(u64);

impl Span {
    pub const fn minutes(minutes: u64) -> Span {
        Span(minutes * 60_000)
    }

    pub const MAX: Span = Span(LONGEST);

    /// Rounds to milliseconds; `None` for NaN, a negative number, and more than a year.
    fn of_seconds(seconds: f64) -> Option<Span> {
        let most = Span::MAX.get().as_secs_f64();
        let millis = (seconds * 1_000.0).round();
        if (0.0..=most).contains(&seconds) {
            Some(Span(millis as u64))
        } else {
            None
        }
    }

    pub fn get(self) -> Duration {
        Duration::from_millis(self.0)
    }
}

impl FromStr for Span {
    type Err = ClockError;

    fn from_str(text: &str) -> Result<Span, ClockError> {
        let wrong = || ClockError::Span(text.to_owned());
        let trimmed = text.trim();
        if let Ok(seconds) = trimmed.parse::<f64>() {
            return Span::of_seconds(seconds).ok_or_else(wrong);
        }
        let mut total = 0u64;
        let mut digits = String::new();
        let mut units = UNITS.as_slice();
        for c in trimmed.chars() {
            if c.is_ascii_digit() {
                digits.push(c);
                continue;
            }
            let at = units.iter().position(|(unit, _)| *unit == c);
            let (at, count) = at.zip(digits.parse::<u64>().ok()).ok_or_else(wrong)?;
            total = count
                .checked_mul(units[at].1)
                .and_then(|millis| total.checked_add(millis))
                .ok_or_else(wrong)?;
            units = &units[at + 1..];
            digits.clear();
        }
        let whole = digits.is_empty() && !trimmed.is_empty() && total <= LONGEST;
        if whole { Ok(Span(total)) } else { Err(wrong()) }
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 {
            return f.write_str("0s");
        }
        if !self.0.is_multiple_of(1_000) {
            return write!(f, "{}", self.get().as_secs_f64());
        }
        let mut rest = self.0;
        for (unit, millis) in UNITS {
            if rest >= millis {
                write!(f, "{}{unit}", rest / millis)?;
                rest %= millis;
            }
        }
        Ok(())
    }
}

impl Serialize for Span {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Span {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Span, D::Error> {
        struct SpanVisitor;
        impl Visitor<'_> for SpanVisitor {
            type Value = Span;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(SPAN_EXPECTED)
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<Span, E> {
                text.parse().map_err(E::custom)
            }

            fn visit_u64<E: Error>(self, seconds: u64) -> Result<Span, E> {
                let wrong = || E::invalid_value(Unexpected::Unsigned(seconds), &self);
                Span::of_seconds(seconds as f64).ok_or_else(wrong)
            }

            fn visit_f64<E: Error>(self, seconds: f64) -> Result<Span, E> {
                let wrong = || E::invalid_value(Unexpected::Float(seconds), &self);
                Span::of_seconds(seconds).ok_or_else(wrong)
            }
        }
        from.deserialize_any(SpanVisitor)
    }
}

impl JsonSchema for Span {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "Span".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        let most = Span::MAX.get().as_secs();
        json_schema!({ "type": ["string", "number"], "minimum": 0, "maximum": most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn durations_are_parsed() {
        let seconds = |text: &str| text.parse::<Span>().map(|span| span.get().as_secs_f64());
        assert_eq!(seconds("90s"), Ok(90.0));
        assert_eq!(seconds("1h30m"), Ok(5400.0));
        assert_eq!(seconds("7d"), Ok(604_800.0));
        assert_eq!(seconds("30"), Ok(30.0));
        assert_eq!(seconds(" 1.5 "), Ok(1.5));
        assert_eq!(seconds("1e3"), Ok(1000.0));
        assert_eq!(seconds("31622400"), Ok(31_622_400.0));
        for wrong in [
            "",
            "1h30",
            "m",
            "30m1h",
            "1m1m",
            "-5m",
            "367d",
            "31622401",
            "31622400.5",
            "1.5h",
            "-1",
            "nan",
            "inf",
            "soon",
            "9".repeat(30).as_str(),
        ] {
            let error = seconds(wrong).unwrap_err().to_string();
            assert!(
                error.contains("or a number of seconds, at most 366d"),
                "{error}"
            );
        }
        for (text, millis) in [
            ("45", 45_000),
            ("'45'", 45_000),
            ("45s", 45_000),
            ("1.5", 1_500),
            ("'1.5'", 1_500),
        ] {
            assert_eq!(serde_yaml::from_str::<Span>(text).unwrap().0, millis);
        }
        assert_eq!(serde_json::from_str::<Span>("1.5").unwrap().0, 1_500);
        for wrong in ["-1", "-1.5", ".nan", "31622401", "'31622401'", "soon"] {
            let error = serde_yaml::from_str::<Span>(wrong).unwrap_err().to_string();
            assert!(
                error.contains("or a number of seconds, at most 366d"),
                "{error}"
            );
        }
    }

    proptest! {
        #[test]
        fn a_formatted_span_parses_to_the_same_value(
            millis in prop_oneof![0..=LONGEST, (0..=LONGEST / 1_000).prop_map(|one| one * 1_000)]
        ) {
            let span = Span(millis);
            prop_assert_eq!(span.to_string().parse(), Ok(span));
        }

        #[test]
        fn no_text_causes_a_panic(text in ".{0,40}") {
            let _ = text.parse::<Span>();
        }
    }
}
