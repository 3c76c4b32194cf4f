//! A script's values to ours, with words for what is wrong. Never runs code of the script: tables
//! are read raw, and nothing of a value is echoed at length.

use std::time::Duration;

use mlua::prelude::{LuaError, LuaFunction, LuaMultiValue, LuaTable, LuaValue};

use super::failure::printable;
use super::nearest::suggestion;

/// The longest that one call can wait, in seconds: thirty days.
const LONGEST: f64 = 30.0 * 86_400.0;

/// Why a native does not do what it was asked.
#[derive(Debug)]
pub(super) enum Refusal {
    /// A mistake of the script: an error with its place.
    Misuse(String),
    /// The task was cancelled.
    Cancelled,
    /// The VM's own trouble: no memory.
    Machine(LuaError),
}

impl From<LuaError> for Refusal {
    fn from(error: LuaError) -> Refusal {
        Refusal::Machine(error)
    }
}

/// The arguments of one call.
pub(super) struct Args {
    /// As people write it, such as `robot.move`.
    pub(super) call: &'static str,
    pub(super) values: LuaMultiValue,
}

/// A number's bounds, in words.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Bounds {
    /// From the first up to the second.
    Between(f64, f64),
    /// Above the first, up to the second.
    Above(f64, f64),
}

impl Bounds {
    /// Whether a number is within them.
    pub fn holds(self, number: f64) -> bool {
        match self {
            Bounds::Between(low, high) => (low..=high).contains(&number),
            Bounds::Above(low, high) => number > low && number <= high,
        }
    }

    /// Such as `between 0 and 100`.
    pub fn words(self) -> String {
        match self {
            Bounds::Between(low, high) => format!("between {low} and {high}"),
            Bounds::Above(low, high) => format!("above {low} and at most {high}"),
        }
    }
}

/// How long a call may wait.
pub(super) const SECONDS: Bounds = Bounds::Between(0.0, LONGEST);

impl Args {
    /// The argument at `index`; nil beyond the last.
    pub(super) fn value(&self, index: usize) -> &LuaValue {
        self.values.get(index).unwrap_or(&LuaValue::Nil)
    }

    pub(super) fn has(&self, index: usize) -> bool {
        !self.value(index).is_nil()
    }

    /// An error about this call.
    pub(super) fn misuse(&self, words: &str) -> Refusal {
        Refusal::Misuse(format!("{}: {words}", self.call))
    }

    fn wrong(&self, name: &str, expected: &str, value: &LuaValue) -> Refusal {
        if value.is_nil() {
            return self.misuse(&format!("{name} is missing; it must be {expected}"));
        }
        let mut words = format!("{name} must be {expected}, got {}", describe(value));
        if matches!(self.values.front(), Some(LuaValue::Table(_)))
            && matches!(value, LuaValue::Table(_))
        {
            let wrong = self.call.replacen('.', ":", 1);
            words += &format!(" (call it with a dot: {}, not {wrong})", self.call);
        }
        self.misuse(&words)
    }

    pub(super) fn number(&self, index: usize, name: &str, bounds: Bounds) -> Result<f64, Refusal> {
        self.check_number(name, self.value(index), bounds)
    }

    pub(super) fn check_number(
        &self,
        name: &str,
        value: &LuaValue,
        bounds: Bounds,
    ) -> Result<f64, Refusal> {
        let number = match value {
            LuaValue::Integer(number) => *number as f64,
            LuaValue::Number(number) if number.is_nan() => {
                return Err(self.misuse(&format!("{name} must be a number, got NaN")));
            }
            LuaValue::Number(number) => *number,
            other => return Err(self.wrong(name, "a number", other)),
        };
        if bounds.holds(number) {
            return Ok(number);
        }
        Err(self.misuse(&format!("{name} must be {}, got {number}", bounds.words())))
    }

    pub(super) fn optional_number(
        &self,
        index: usize,
        name: &str,
        bounds: Bounds,
    ) -> Result<Option<f64>, Refusal> {
        self.has(index)
            .then(|| self.number(index, name, bounds))
            .transpose()
    }

    pub(super) fn seconds(&self, index: usize, name: &str) -> Result<Duration, Refusal> {
        Ok(Duration::from_secs_f64(self.number(index, name, SECONDS)?))
    }

    pub(super) fn optional_seconds(
        &self,
        index: usize,
        name: &str,
    ) -> Result<Option<Duration>, Refusal> {
        self.has(index)
            .then(|| self.seconds(index, name))
            .transpose()
    }

    pub(super) fn boolean(&self, index: usize, name: &str) -> Result<bool, Refusal> {
        match self.value(index) {
            LuaValue::Boolean(on) => Ok(*on),
            other => Err(self.wrong(name, "true or false", other)),
        }
    }

    pub(super) fn function(&self, index: usize, name: &str) -> Result<LuaFunction, Refusal> {
        match self.value(index) {
            LuaValue::Function(function) => Ok(function.clone()),
            other => Err(self.wrong(name, "a function", other)),
        }
    }

    /// Text of at most `longest` bytes.
    pub(super) fn text(&self, index: usize, name: &str, longest: usize) -> Result<String, Refusal> {
        let LuaValue::String(text) = self.value(index) else {
            return Err(self.wrong(name, "a string", self.value(index)));
        };
        let bytes = text.as_bytes();
        if bytes.len() > longest {
            return Err(self.misuse(&format!("{name} is too long: at most {longest} bytes")));
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// One of the names that `known` lists.
    pub(super) fn choice<T: Copy>(
        &self,
        index: usize,
        what: &str,
        known: &[(&'static str, T)],
    ) -> Result<T, Refusal> {
        self.check_choice(what, self.value(index), known)
    }

    fn check_choice<T: Copy>(
        &self,
        what: &str,
        value: &LuaValue,
        known: &[(&'static str, T)],
    ) -> Result<T, Refusal> {
        let names = || known.iter().map(|(name, _)| *name);
        let LuaValue::String(text) = value else {
            let expected = format!("one of {}", list(names()));
            return Err(self.wrong(what, &expected, value));
        };
        let text = printable(&text.to_string_lossy(), 40);
        let found = known.iter().find(|(name, _)| *name == text);
        found.map(|(_, value)| *value).ok_or_else(|| {
            let near = suggestion(&text, names());
            let names = list(names());
            self.misuse(&format!("unknown {what} '{text}'{near} (known: {names})"))
        })
    }

    /// The table of options at `index`, its keys checked.
    pub(super) fn options<'a>(&'a self, index: usize, keys: &[&str]) -> Result<Table<'a>, Refusal> {
        let table = match self.value(index) {
            LuaValue::Nil => None,
            LuaValue::Table(table) => Some(table.clone()),
            other => return Err(self.wrong("the options", "a table", other)),
        };
        if let Some(table) = &table {
            self.check_keys(table, keys)?;
        }
        Ok(Table { args: self, table })
    }

    fn check_keys(&self, table: &LuaTable, keys: &[&str]) -> Result<(), Refusal> {
        let mut wrong = None;
        // The first unknown key is enough; the visit stops there.
        let _ = table.for_each(|key: LuaValue, _: LuaValue| {
            let text = match &key {
                LuaValue::String(text) => printable(&text.to_string_lossy(), 40),
                other => describe(other),
            };
            if keys.contains(&text.as_str()) {
                return Ok(());
            }
            wrong = Some(text);
            Err(LuaError::runtime("unknown key"))
        });
        let Some(key) = wrong else { return Ok(()) };
        let near = suggestion(&key, keys.iter().copied());
        let known = list(keys.iter().copied());
        Err(self.misuse(&format!("unknown option '{key}'{near} (known: {known})")))
    }
}

/// A table of named values whose keys were checked.
pub(super) struct Table<'a> {
    pub(super) args: &'a Args,
    table: Option<LuaTable>,
}

impl Table<'_> {
    pub(super) fn value(&self, key: &str) -> Result<LuaValue, Refusal> {
        match &self.table {
            Some(table) => Ok(table.raw_get(key)?),
            None => Ok(LuaValue::Nil),
        }
    }

    pub(super) fn number(&self, key: &str, default: f64, bounds: Bounds) -> Result<f64, Refusal> {
        Ok(self.optional_number(key, bounds)?.unwrap_or(default))
    }

    pub(super) fn optional_number(
        &self,
        key: &str,
        bounds: Bounds,
    ) -> Result<Option<f64>, Refusal> {
        match self.value(key)? {
            LuaValue::Nil => Ok(None),
            value => self.args.check_number(key, &value, bounds).map(Some),
        }
    }

    pub(super) fn boolean(&self, key: &str, default: bool) -> Result<bool, Refusal> {
        match self.value(key)? {
            LuaValue::Nil => Ok(default),
            LuaValue::Boolean(on) => Ok(on),
            other => Err(self.args.wrong(key, "true or false", &other)),
        }
    }

    /// A whole number.
    pub(super) fn count(&self, key: &str, default: u32, most: u32) -> Result<u32, Refusal> {
        let bounds = Bounds::Between(0.0, f64::from(most));
        let number = self.number(key, f64::from(default), bounds)?;
        if number.fract() == 0.0 {
            return Ok(number as u32);
        }
        Err(self
            .args
            .misuse(&format!("{key} must be a whole number, got {number}")))
    }

    pub(super) fn choice<T: Copy>(
        &self,
        key: &str,
        known: &[(&'static str, T)],
    ) -> Result<Option<T>, Refusal> {
        match self.value(key)? {
            LuaValue::Nil => Ok(None),
            value => self.args.check_choice(key, &value, known).map(Some),
        }
    }
}

/// Names behind each other, for messages.
fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

/// A value in a few words: never more than a short piece of it.
pub(super) fn describe(value: &LuaValue) -> String {
    match value {
        LuaValue::Nil => "nothing".to_owned(),
        LuaValue::Boolean(on) => on.to_string(),
        LuaValue::Integer(number) => number.to_string(),
        LuaValue::Number(number) => number.to_string(),
        LuaValue::String(text) => {
            // Only the beginning is converted, however long it is.
            let bytes = text.as_bytes();
            let start = &bytes[..bytes.len().min(200)];
            format!("'{}'", printable(&String::from_utf8_lossy(start), 40))
        }
        LuaValue::Table(_) => "a table".to_owned(),
        LuaValue::Function(_) => "a function".to_owned(),
        LuaValue::Thread(_) => "a coroutine".to_owned(),
        LuaValue::Buffer(_) => "a buffer".to_owned(),
        LuaValue::Vector(_) => "a vector".to_owned(),
        _ => "an object".to_owned(),
    }
}
