//! What a scenario's script hands over, with words for what is wrong.

use std::time::Duration;

use serde_json::{Map, Value};

use crate::script::suggestion;

/// No wait is longer: thirty days.
const LONGEST: f64 = 30.0 * 86_400.0;

/// The arguments of one call.
#[derive(Clone, Copy)]
pub(super) struct Arguments<'a>(pub(super) &'a [Value]);

impl<'a> Arguments<'a> {
    pub(super) fn value(self, index: usize) -> &'a Value {
        self.0.get(index).unwrap_or(&Value::Null)
    }

    pub(super) fn has(self, index: usize) -> bool {
        !self.value(index).is_null()
    }

    pub(super) fn number(
        self,
        index: usize,
        name: &str,
        low: f64,
        high: f64,
    ) -> Result<f64, String> {
        number(self.value(index), name, low, high)
    }

    pub(super) fn seconds(self, index: usize) -> Result<Duration, String> {
        self.number(index, "seconds", 0.0, LONGEST)
            .map(Duration::from_secs_f64)
    }

    pub(super) fn whole(self, index: usize, name: &str, most: usize) -> Result<usize, String> {
        whole(self.value(index), name, 1, most as u64).map(|number| number as usize)
    }

    pub(super) fn flag(self, index: usize, name: &str) -> Result<bool, String> {
        let value = self.value(index);
        value
            .as_bool()
            .ok_or_else(|| wrong(name, "true or false", value))
    }

    pub(super) fn text(self, index: usize, name: &str) -> Result<&'a str, String> {
        let value = self.value(index);
        value.as_str().ok_or_else(|| wrong(name, "a text", value))
    }

    pub(super) fn optional_text(self, index: usize, name: &str) -> Result<Option<&'a str>, String> {
        self.has(index).then(|| self.text(index, name)).transpose()
    }

    pub(super) fn fields(
        self,
        index: usize,
        what: &str,
        keys: &[&str],
    ) -> Result<Fields<'a>, String> {
        Fields::of(self.value(index), what, keys)
    }
}

/// A table with names.
#[derive(Debug)]
pub(super) struct Fields<'a>(Option<&'a Map<String, Value>>);

impl<'a> Fields<'a> {
    /// None of an empty table and of nothing: they look alike.
    pub(super) fn of(value: &'a Value, what: &str, keys: &[&str]) -> Result<Fields<'a>, String> {
        let map = match value {
            Value::Null => return Ok(Fields(None)),
            Value::Array(list) if list.is_empty() => return Ok(Fields(None)),
            Value::Object(map) => map,
            other => return Err(wrong(what, "a table", other)),
        };
        match map.keys().find(|key| !keys.contains(&key.as_str())) {
            Some(key) => Err(unknown_key(key, keys)),
            None => Ok(Fields(Some(map))),
        }
    }

    pub(super) fn value(&self, key: &str) -> Option<&'a Value> {
        self.0.and_then(|map| map.get(key))
    }

    pub(super) fn text(&self, key: &str) -> Result<Option<String>, String> {
        let text = |value: &Value| value.as_str().map(str::to_owned);
        self.read(key, |value| {
            text(value).ok_or_else(|| wrong(key, "a text", value))
        })
    }

    pub(super) fn flag(&self, key: &str) -> Result<Option<bool>, String> {
        self.read(key, |value| {
            value
                .as_bool()
                .ok_or_else(|| wrong(key, "true or false", value))
        })
    }

    pub(super) fn number(&self, key: &str, low: f64, high: f64) -> Result<Option<f64>, String> {
        self.read(key, |value| number(value, key, low, high))
    }

    pub(super) fn whole(&self, key: &str, low: u64, high: u64) -> Result<Option<u64>, String> {
        self.read(key, |value| whole(value, key, low, high))
    }

    fn read<T>(
        &self,
        key: &str,
        read: impl FnOnce(&'a Value) -> Result<T, String>,
    ) -> Result<Option<T>, String> {
        self.value(key).map(read).transpose()
    }
}

fn number(value: &Value, name: &str, low: f64, high: f64) -> Result<f64, String> {
    let number = value
        .as_f64()
        .ok_or_else(|| wrong(name, "a number", value))?;
    match (low..=high).contains(&number) {
        true => Ok(number),
        false => Err(format!(
            "{name} must be between {low} and {high}, got {number}"
        )),
    }
}

fn whole(value: &Value, name: &str, low: u64, high: u64) -> Result<u64, String> {
    let found = number(value, name, low as f64, high as f64)?;
    match found.fract() == 0.0 {
        true => Ok(found as u64),
        false => Err(format!("{name} must be a whole number, got {found}")),
    }
}

fn wrong(name: &str, expected: &str, value: &Value) -> String {
    match value {
        Value::Null => format!("{name} is missing; it must be {expected}"),
        Value::String(text) => {
            let start: String = text.chars().take(40).collect();
            format!("{name} must be {expected}, got '{start}'")
        }
        Value::Array(_) | Value::Object(_) => format!("{name} must be {expected}, got a table"),
        plain => format!("{name} must be {expected}, got {plain}"),
    }
}

fn unknown_key(key: &str, keys: &[&str]) -> String {
    let near = suggestion(key, keys.iter().copied());
    let known = keys.join(", ");
    format!("unknown option '{key}'{near} (known: {known})")
}
