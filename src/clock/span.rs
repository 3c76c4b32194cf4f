//! A duration as people write it: `90s`, `30m`, `1h30m`, `7d`, or a number of seconds.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::error::{ClockError, SPAN_EXPECTED};

/// The maximum: a year.
const LONGEST: u64 = 366 * 86_400;
const UNITS: [(char, u64); 4] = [('d', 86_400), ('h', 3_600), ('m', 60), ('s', 1)];

/// A duration in whole seconds, at most a year.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Span(u64);

impl Span {
    /// Creates a span of this many minutes.
    pub const fn minutes(minutes: u64) -> Span {
        Span(minutes * 60)
    }

    /// Creates a span of this many seconds, at most a year.
    pub fn seconds(seconds: u64) -> Span {
        Span(seconds.min(LONGEST))
    }

    /// The maximum: a year.
    pub const MAX: Span = Span(LONGEST);

    /// `None` above a year.
    fn of_seconds(seconds: u64) -> Option<Span> {
        (seconds <= LONGEST).then_some(Span(seconds))
    }

    /// Returns the span as a [`Duration`].
    pub fn get(self) -> Duration {
        Duration::from_secs(self.0)
    }
}

impl FromStr for Span {
    type Err = ClockError;

    fn from_str(text: &str) -> Result<Span, ClockError> {
        let wrong = || ClockError::Span(text.to_owned());
        if text.trim().bytes().all(|byte| byte.is_ascii_digit()) {
            let seconds = text.trim().parse::<u64>().ok();
            return seconds.and_then(Span::of_seconds).ok_or_else(wrong);
        }
        let (mut total, mut digits, mut units) = (0u64, String::new(), UNITS.as_slice());
        for c in text.trim().chars() {
            if c.is_ascii_digit() {
                digits.push(c);
                continue;
            }
            let at = units.iter().position(|(unit, _)| *unit == c);
            let (at, count) = at.zip(digits.parse::<u64>().ok()).ok_or_else(wrong)?;
            total = count
                .checked_mul(units[at].1)
                .and_then(|seconds| total.checked_add(seconds))
                .ok_or_else(wrong)?;
            units = &units[at + 1..];
            digits.clear();
        }
        let whole = digits.is_empty().then_some(total);
        whole.and_then(Span::of_seconds).ok_or_else(wrong)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0 == 0 {
            return f.write_str("0s");
        }
        let mut rest = self.0;
        for (unit, seconds) in UNITS {
            if rest >= seconds {
                write!(f, "{}{unit}", rest / seconds)?;
                rest %= seconds;
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
        json_schema!({ "type": ["string", "integer"], "minimum": 0, "maximum": LONGEST })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn durations_are_parsed() {
        let seconds = |text: &str| text.parse::<Span>().map(|span| span.0);
        assert_eq!(seconds("90s"), Ok(90));
        assert_eq!(seconds("1h30m"), Ok(5400));
        assert_eq!(seconds("7d"), Ok(604_800));
        assert_eq!(seconds("30"), Ok(30));
        for wrong in [
            "",
            "1h30",
            "m",
            "30m1h",
            "1m1m",
            "-5m",
            "367d",
            "31622401",
            "1.5",
            "9".repeat(30).as_str(),
        ] {
            assert!(seconds(wrong).is_err(), "{wrong}");
        }
        for seconds in ["45", "'45'", "45s"] {
            assert_eq!(serde_yaml::from_str::<Span>(seconds).unwrap().0, 45);
        }
        for wrong in ["1.5", "-1", "31622401", "'31622401'", "soon"] {
            let error = serde_yaml::from_str::<Span>(wrong).unwrap_err().to_string();
            assert!(
                error.contains("or a number of seconds, at most 366d"),
                "{error}"
            );
        }
    }

    proptest! {
        #[test]
        fn a_formatted_span_parses_to_the_same_value(seconds in 0..=LONGEST) {
            let span = Span(seconds);
            prop_assert_eq!(span.to_string().parse(), Ok(span));
        }

        #[test]
        fn no_text_causes_a_panic(text in ".{0,40}") {
            let _ = text.parse::<Span>();
        }
    }
}
