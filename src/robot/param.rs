//! Parameters of behaviours: their values, and changes by a person while the behaviour runs.

use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::de::Visitor;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use tokio::sync::{broadcast, watch};

const MAX_PARAMS: usize = 64;
/// The most letters of each text, and the most choices of one parameter.
const LONGEST: usize = 200;
/// The most changes that a behaviour may be behind.
const BEHIND: usize = 32;

/// A parameter's value: true, false, a number or a text. In a human-readable document it is written
/// as a plain scalar: `true`, `40`, `fast`. No list, map or null is a value.
#[derive(JsonSchema, Clone, Debug, PartialEq)]
#[schemars(untagged)]
pub enum ParamValue {
    /// `true` or `false`.
    Boolean(bool),
    /// A finite number.
    Number(f64),
    /// A text.
    Text(String),
}

/// A parameter that a behaviour has declared, with its present value.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(rename = "Knob")]
pub struct DeclaredParam {
    /// Its name.
    pub name: String,
    /// Its value.
    pub value: ParamValue,
    /// Whether it may be changed while the behaviour runs.
    pub live: bool,
    /// The smallest number.
    pub min: Option<f64>,
    /// The largest number.
    pub max: Option<f64>,
    /// The unit of a number, such as `%`.
    pub unit: Option<String>,
    /// The allowed texts; empty: any.
    pub choices: Vec<String>,
    /// What it is for.
    pub doc: String,
}

impl DeclaredParam {
    /// Whether a value has the right type and lies within the bounds.
    pub fn allows(&self, value: &ParamValue) -> bool {
        match (&self.value, value) {
            (ParamValue::Boolean(_), ParamValue::Boolean(_)) => true,
            (ParamValue::Number(_), ParamValue::Number(number)) => {
                number.is_finite()
                    && self.min.is_none_or(|min| *number >= min)
                    && self.max.is_none_or(|max| *number <= max)
            }
            (ParamValue::Text(_), ParamValue::Text(text)) => {
                self.choices.is_empty() || self.choices.contains(text)
            }
            _ => false,
        }
    }

    /// A description of the allowed values, such as `a number from 10 to 100 %`.
    pub fn expected(&self) -> String {
        match &self.value {
            ParamValue::Boolean(_) => "true or false".to_owned(),
            ParamValue::Text(_) if self.choices.is_empty() => "a text".to_owned(),
            ParamValue::Text(_) => format!("one of {}", self.choices.join(", ")),
            ParamValue::Number(_) => {
                let unit = self.unit.as_ref().map(|unit| format!(" {unit}"));
                let unit = unit.unwrap_or_default();
                match (self.min, self.max) {
                    (Some(min), Some(max)) => format!("a number from {min} to {max}{unit}"),
                    (Some(min), None) => format!("a number of at least {min}{unit}"),
                    (None, Some(max)) => format!("a number of at most {max}{unit}"),
                    (None, None) => format!("a number{}", unit.replacen(' ', " of ", 1)),
                }
            }
        }
    }

    /// Limits the texts: a compromised host may send anything.
    fn shorten(&mut self) {
        let value = match &mut self.value {
            ParamValue::Text(text) => Some(text),
            ParamValue::Boolean(_) | ParamValue::Number(_) => None,
        };
        let texts = [&mut self.name, &mut self.doc].into_iter();
        let texts = texts.chain(&mut self.choices).chain(&mut self.unit);
        for text in texts.chain(value) {
            if let Some((at, _)) = text.char_indices().nth(LONGEST) {
                text.truncate(at);
            }
        }
        self.choices.truncate(LONGEST);
    }
}

/// A person's request to change a parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ParamChange {
    pub behaviour: String,
    pub name: String,
    pub value: ParamValue,
}

/// The parameters of all behaviours that run. Cheap to clone; never blocks.
#[derive(Debug, Clone)]
pub struct ParamBoard {
    declared: watch::Sender<DeclaredParams>,
    changes: broadcast::Sender<ParamChange>,
}

pub type DeclaredParams = BTreeMap<String, Vec<DeclaredParam>>;

impl Default for ParamBoard {
    fn default() -> ParamBoard {
        ParamBoard {
            declared: watch::Sender::default(),
            changes: broadcast::Sender::new(BEHIND),
        }
    }
}

impl ParamBoard {
    /// Sets a behaviour's parameters, when it declares them or one has changed.
    pub fn declare(&self, behaviour: &str, mut list: Vec<DeclaredParam>) {
        list.truncate(MAX_PARAMS);
        list.iter_mut().for_each(DeclaredParam::shorten);
        self.declared
            .send_modify(|declared| drop(declared.insert(behaviour.to_owned(), list)));
    }

    /// Removes the parameters of a behaviour that has ended.
    pub fn forget(&self, behaviour: &str) {
        self.declared
            .send_if_modified(|declared| declared.remove(behaviour).is_some());
    }

    /// All declared parameters; the receiver can wait for changes.
    pub fn declared(&self) -> watch::Receiver<DeclaredParams> {
        self.declared.subscribe()
    }

    /// Passes on a change; the behaviour checks it.
    pub fn change(&self, change: ParamChange) {
        // Fails if no behaviour runs.
        let _ = self.changes.send(change);
    }

    pub fn changes(&self) -> broadcast::Receiver<ParamChange> {
        self.changes.subscribe()
    }
}

impl Serialize for ParamValue {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        if !to.is_human_readable() {
            return Tagged::serialize(self, to);
        }
        match self {
            ParamValue::Boolean(value) => to.serialize_bool(*value),
            ParamValue::Number(value) => to.serialize_f64(*value),
            ParamValue::Text(value) => to.serialize_str(value),
        }
    }
}

impl<'de> Deserialize<'de> for ParamValue {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<ParamValue, D::Error> {
        if from.is_human_readable() {
            return from.deserialize_any(Written);
        }
        Tagged::deserialize(from)
    }
}

/// [`ParamValue`] between processes, where formats are not self-describing and need the kind.
#[derive(Serialize, Deserialize)]
#[serde(remote = "ParamValue")]
enum Tagged {
    Boolean(bool),
    Number(f64),
    Text(String),
}

/// Reads a value that a person wrote.
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
    fn values_survive_the_pipe_and_are_plain_in_json() {
        for value in [
            ParamValue::Boolean(false),
            ParamValue::Number(0.1),
            ParamValue::Text("40".into()),
        ] {
            let bytes = postcard::to_allocvec(&value).unwrap();
            assert_eq!(postcard::from_bytes::<ParamValue>(&bytes).unwrap(), value);
            let json = serde_json::to_string(&value).unwrap();
            assert_eq!(json, format!("{value:?}").split(['(', ')']).nth(1).unwrap());
            assert_eq!(serde_json::from_str::<ParamValue>(&json).unwrap(), value);
        }
    }
}
