//! Parameters: values that a person gives to a script from outside, on the command line or in the
//! config, as they travel to the script that declares them.

use std::fmt;

use serde::de::Visitor;
use serde::{Deserialize, Deserializer, Serialize};

/// A value from outside. From a human-readable document it is read as what it looks like: `true`,
/// `40`, `fast`; nothing else, no list, no map, no null, is a value.
#[derive(Serialize, Clone, Debug, PartialEq)]
pub enum ParamValue {
    /// `true` or `false`.
    Boolean(bool),
    /// A finite number.
    Number(f64),
    /// A text.
    Text(String),
}

/// Where a value was written.
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq, Eq)]
pub enum ParamOrigin {
    /// `--param NAME=VALUE`: always a text, read as what the script has declared.
    CommandLine,
    /// The config of this name, such as `spykee.yaml`, with the line if it is known.
    Config(String),
}

/// A value and where it was written, for messages.
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq)]
pub struct GivenParam {
    /// The value.
    pub value: ParamValue,
    /// Where it was written.
    pub origin: ParamOrigin,
}

impl<'de> Deserialize<'de> for ParamValue {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<ParamValue, D::Error> {
        if from.is_human_readable() {
            return from.deserialize_any(Written);
        }
        // Between processes the kind is written down: those formats do not describe themselves.
        Ok(match Tagged::deserialize(from)? {
            Tagged::Boolean(value) => ParamValue::Boolean(value),
            Tagged::Number(value) => ParamValue::Number(value),
            Tagged::Text(value) => ParamValue::Text(value),
        })
    }
}

/// [`ParamValue`] as its derived [`Serialize`] writes it.
#[derive(Deserialize)]
enum Tagged {
    Boolean(bool),
    Number(f64),
    Text(String),
}

/// Reads what a person wrote.
struct Written;

impl Visitor<'_> for Written {
    type Value = ParamValue;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("true, false, a number or a text")
    }

    fn visit_bool<E>(self, value: bool) -> Result<ParamValue, E> {
        Ok(ParamValue::Boolean(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<ParamValue, E> {
        Ok(ParamValue::Number(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> Result<ParamValue, E> {
        Ok(ParamValue::Number(value as f64))
    }

    fn visit_f64<E: serde::de::Error>(self, value: f64) -> Result<ParamValue, E> {
        if value.is_finite() {
            return Ok(ParamValue::Number(value));
        }
        Err(E::custom(
            "invalid value: not a finite number, expected true, false, a number or a text",
        ))
    }

    fn visit_str<E>(self, value: &str) -> Result<ParamValue, E> {
        Ok(ParamValue::Text(value.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_gives_booleans_numbers_and_texts_and_nothing_else() {
        let read = |text: &str| serde_yaml::from_str::<ParamValue>(text);
        assert_eq!(read("true").unwrap(), ParamValue::Boolean(true));
        assert_eq!(read("-3").unwrap(), ParamValue::Number(-3.0));
        assert_eq!(read("0.5").unwrap(), ParamValue::Number(0.5));
        assert_eq!(read("'40'").unwrap(), ParamValue::Text("40".into()));
        for wrong in ["[1]", "{a: 1}", "~", ".nan", ".inf"] {
            let error = read(wrong).unwrap_err().to_string();
            assert!(error.contains("true, false, a number or a text"), "{error}");
        }
    }

    #[test]
    fn values_cross_the_pipe_as_they_are() {
        for value in [
            ParamValue::Boolean(false),
            ParamValue::Number(0.1),
            ParamValue::Text("40".into()),
        ] {
            let bytes = postcard::to_allocvec(&value).unwrap();
            assert_eq!(postcard::from_bytes::<ParamValue>(&bytes).unwrap(), value);
        }
    }
}
