//! Converts a script's values to Rust values, as the rows of the API table say, with an error
//! message if a value is wrong. Never runs code of the script: tables are read raw, and messages
//! quote values only in short form.

use std::time::Duration;

use mlua::prelude::{LuaError, LuaFunction, LuaMultiValue, LuaTable, LuaValue};

use super::failure::printable;
use crate::api::{Bounds, Choice, Function, Literal, Requirement, Type, Value};
use crate::wire::{Sound, Stream};
use crate::yaml::suggestion;

/// Why a native function refuses a call.
#[derive(Debug)]
pub(super) enum Refusal {
    /// A mistake in the script, raised as an error with its place.
    Misuse(String),
    Cancelled,
    /// A failure of the VM itself, such as too little memory.
    Vm(LuaError),
}

impl From<LuaError> for Refusal {
    fn from(error: LuaError) -> Refusal {
        Refusal::Vm(error)
    }
}

/// The row used where the API table has none: for a native function that reads more arguments than
/// its row declares.
const UNNAMED: &Value = &Value {
    name: "the argument",
    kind: Type::Any,
    unit: "",
    requirement: Requirement::Optional,
    doc: "",
};

pub(super) struct Args {
    pub(super) function: &'static Function,
    pub(super) values: LuaMultiValue,
    /// What messages name before the argument, such as `speed: `; usually empty.
    pub(super) within: String,
}

impl Args {
    pub(super) fn new(function: &'static Function, values: LuaMultiValue) -> Args {
        let within = String::new();
        Args {
            function,
            values,
            within,
        }
    }

    /// The value of a parameter; nil beyond the last one. The object of a method is not counted.
    pub(super) fn value(&self, index: usize) -> &LuaValue {
        let index = index + usize::from(self.function.is_method());
        self.values.get(index).unwrap_or(&LuaValue::Nil)
    }

    pub(super) fn receiver(&self) -> &LuaValue {
        self.values.front().unwrap_or(&LuaValue::Nil)
    }

    /// The extra arguments after the declared parameters.
    pub(super) fn rest(&self) -> LuaMultiValue {
        let skipped = self.function.parameters.len() + usize::from(self.function.is_method());
        self.values.iter().skip(skipped).cloned().collect()
    }

    pub(super) fn misuse(&self, words: &str) -> Refusal {
        Refusal::Misuse(format!("{}: {}{words}", self.function.path, self.within))
    }

    /// Reads the argument of a parameter as its row says; its default if it is left out.
    pub(super) fn get<T: Argument>(&self, index: usize) -> Result<T, Refusal> {
        T::read(self.given(index))
    }

    pub(super) fn given(&self, index: usize) -> Given<'_> {
        Given {
            args: self,
            row: self.function.parameters.get(index).unwrap_or(UNNAMED),
            value: self.value(index).clone(),
        }
    }

    /// The options table of a parameter, with its keys checked.
    pub(super) fn options(&self, index: usize) -> Result<OptionTable<'_>, Refusal> {
        self.given(index).options()
    }
}

pub(super) struct Given<'a> {
    pub(super) args: &'a Args,
    row: &'static Value,
    pub(super) value: LuaValue,
}

pub(super) trait Argument: Sized {
    /// Converts the given value, or returns an error message if it has the wrong type.
    fn read(given: Given<'_>) -> Result<Self, Refusal>;
}

impl<'a> Given<'a> {
    pub(super) fn wrong(&self, expected: &str) -> Refusal {
        self.args.wrong(self.row.label(), expected, &self.value)
    }

    fn default(&self) -> Option<Literal> {
        match self.row.requirement {
            Requirement::Default(literal) if self.value.is_nil() => Some(literal),
            _ => None,
        }
    }

    fn choice(&self, choice: &Choice) -> Result<&'static str, Refusal> {
        let names = (choice.names)();
        let LuaValue::String(text) = &self.value else {
            return Err(self.wrong(&format!("one of {}", names.join(", "))));
        };
        let text = printable(&text.to_string_lossy(), 40);
        let found = names.iter().find(|name| **name == text);
        found.copied().ok_or_else(|| {
            let near = suggestion(&text, names.iter().copied());
            let what = choice.what;
            let known = names.join(", ");
            let words = format!("unknown {what} '{text}'{near} (known: {known})");
            self.args.misuse(&words)
        })
    }

    fn name(&self) -> Result<&'static str, Refusal> {
        match self.row.kind {
            Type::Choice(choice) => self.choice(choice),
            _ => Err(self.wrong("a name")),
        }
    }

    /// Reads one of a set of names and converts it with `find`.
    pub(super) fn named<T>(&self, find: impl Fn(&str) -> Option<T>) -> Result<T, Refusal> {
        let name = self.name()?;
        find(name).ok_or_else(|| self.wrong("another name"))
    }

    fn options(self) -> Result<OptionTable<'a>, Refusal> {
        let keys = match self.row.kind {
            Type::Options(keys) => keys,
            _ => &[],
        };
        match &self.value {
            LuaValue::Nil if !self.row.is_required() => self.args.table(None, keys),
            LuaValue::Table(table) => self.args.table(Some(table.clone()), keys),
            _ => Err(self.wrong("a table")),
        }
    }

    /// Checks the given value against its row without converting it. Types whose check needs more
    /// than the row are checked when they are read.
    pub(super) fn check(self) -> Result<(), Refusal> {
        if self.value.is_nil() && !self.row.is_required() {
            return Ok(());
        }
        match self.row.kind {
            Type::Boolean => bool::read(self).map(drop),
            Type::Number(_) => f64::read(self).map(drop),
            Type::Whole(_) => u32::read(self).map(drop),
            Type::Text(_) => String::read(self).map(drop),
            kind if kind.is_function() => LuaFunction::read(self).map(drop),
            Type::Choice(choice) => self.choice(choice).map(drop),
            Type::Options(_) => {
                let options = self.options()?;
                let mut keys = options.keys.iter();
                keys.try_for_each(|key| options.given(key.name)?.check())
            }
            Type::Fields if !self.value.is_table() => Err(self.wrong("a table")),
            _ => Ok(()),
        }
    }
}

impl Args {
    fn wrong(&self, name: &str, expected: &str, value: &LuaValue) -> Refusal {
        if value.is_nil() {
            return self.misuse(&format!("{name} is missing; it must be {expected}"));
        }
        let mut words = format!("{name} must be {expected}, got {}", describe(value));
        let path = self.function.path;
        let with_colon = matches!(self.values.front(), Some(LuaValue::Table(_)));
        if with_colon && value.is_table() && !self.function.is_method() {
            let wrong = path.replacen('.', ":", 1);
            words += &format!(" (call it with a dot: {path}, not {wrong})");
        }
        self.misuse(&words)
    }

    pub(super) fn check_number(
        &self,
        name: &str,
        value: &LuaValue,
        bounds: Option<Bounds>,
    ) -> Result<f64, Refusal> {
        let number = match value {
            LuaValue::Integer(number) => *number as f64,
            LuaValue::Number(number) if number.is_nan() => {
                return Err(self.misuse(&format!("{name} must be a number, got NaN")));
            }
            LuaValue::Number(number) => *number,
            other => return Err(self.wrong(name, "a number", other)),
        };
        match bounds.filter(|bounds| !bounds.contains(number)) {
            None => Ok(number),
            Some(bounds) => Err(self.misuse(&format!(
                "{name} must be {}, got {number}",
                bounds.describe()
            ))),
        }
    }

    /// A table with these keys and no others.
    pub(super) fn table(
        &self,
        table: Option<LuaTable>,
        keys: &'static [Value],
    ) -> Result<OptionTable<'_>, Refusal> {
        if let Some(table) = &table {
            self.check_keys(table, keys)?;
        }
        Ok(OptionTable {
            args: self,
            keys,
            table,
        })
    }

    fn check_keys(&self, table: &LuaTable, keys: &[Value]) -> Result<(), Refusal> {
        let mut wrong = None;
        // The first unknown key is enough; the visit stops there.
        let _ = table.for_each(|key: LuaValue, _: LuaValue| {
            let text = describe_key(&key);
            if keys.iter().any(|known| known.name == text) {
                return Ok(());
            }
            wrong = Some(text);
            Err(LuaError::runtime("unknown key"))
        });
        let Some(key) = wrong else { return Ok(()) };
        let known: Vec<_> = keys.iter().map(|known| known.name).collect();
        let near = suggestion(&key, known.iter().copied());
        let known = known.join(", ");
        Err(self.misuse(&format!("unknown option '{key}'{near} (known: {known})")))
    }
}

pub(super) struct OptionTable<'a> {
    args: &'a Args,
    keys: &'static [Value],
    table: Option<LuaTable>,
}

impl OptionTable<'_> {
    /// Reads an option as its row says; its default if it is left out.
    pub(super) fn get<T: Argument>(&self, key: &str) -> Result<T, Refusal> {
        T::read(self.given(key)?)
    }

    fn given(&self, key: &str) -> Result<Given<'_>, Refusal> {
        let row = self.keys.iter().find(|row| row.name == key);
        Ok(Given {
            args: self.args,
            row: row.unwrap_or(UNNAMED),
            value: match &self.table {
                Some(table) => table.raw_get(key)?,
                None => LuaValue::Nil,
            },
        })
    }

    pub(super) fn value(&self, key: &str) -> Result<LuaValue, Refusal> {
        Ok(self.given(key)?.value)
    }

    pub(super) fn defaults(&self) -> Result<Vec<(&'static str, Literal)>, Refusal> {
        let mut found = Vec::new();
        for key in self.keys {
            found.extend(self.given(key.name)?.default().map(|one| (key.name, one)));
        }
        Ok(found)
    }
}

/// Describes a value in a few words: of a long string only its beginning.
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

pub(super) fn describe_key(key: &LuaValue) -> String {
    match key {
        LuaValue::String(text) => printable(&text.to_string_lossy(), 40),
        other => describe(other),
    }
}

impl<T: Argument> Argument for Option<T> {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        if given.value.is_nil() && given.default().is_none() {
            return Ok(None);
        }
        T::read(given).map(Some)
    }
}

impl Argument for f64 {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        if let Some(Literal::Number(number)) = given.default() {
            return Ok(number);
        }
        let bounds = match given.row.kind {
            Type::Number(bounds) | Type::Whole(bounds) => bounds,
            _ => None,
        };
        let args = given.args;
        args.check_number(given.row.label(), &given.value, bounds)
    }
}

impl Argument for u32 {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        let args = given.args;
        let name = given.row.label();
        let number = f64::read(given)?;
        if number.fract() == 0.0 {
            return Ok(number as u32);
        }
        Err(args.misuse(&format!("{name} must be a whole number, got {number}")))
    }
}

/// In seconds.
impl Argument for Duration {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        let args = given.args;
        let name = given.row.label();
        Duration::try_from_secs_f64(f64::read(given)?)
            .map_err(|_| args.misuse(&format!("{name} is not a time")))
    }
}

impl Argument for bool {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        match (&given.value, given.default()) {
            (LuaValue::Boolean(on), _) => Ok(*on),
            (_, Some(Literal::Boolean(on))) => Ok(on),
            _ => Err(given.wrong("true or false")),
        }
    }
}

impl Argument for LuaFunction {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        match &given.value {
            LuaValue::Function(function) => Ok(function.clone()),
            _ => Err(given.wrong("a function")),
        }
    }
}

impl Argument for String {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        let LuaValue::String(text) = &given.value else {
            return Err(given.wrong("a string"));
        };
        let bytes = text.as_bytes();
        if let Type::Text(Some(most)) = given.row.kind
            && bytes.len() > most
        {
            let words = format!("{} is too long: at most {most} bytes", given.row.label());
            return Err(given.args.misuse(&words));
        }
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }
}

impl Argument for &'static str {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        given.name()
    }
}

impl Argument for Sound {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        given.named(Sound::from_name)
    }
}

impl Argument for Stream {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        given.named(Stream::from_name)
    }
}

/// `{low, high}`
impl Argument for [f64; 2] {
    fn read(given: Given<'_>) -> Result<Self, Refusal> {
        if let Some(Literal::Range(low, high)) = given.default() {
            return Ok([low, high]);
        }
        let name = given.row.name;
        let wrong = || {
            let words = format!("{name} must be two numbers, such as {name}={{20, 80}}");
            given.args.misuse(&words)
        };
        let table = given.value.as_table().ok_or_else(wrong)?;
        if table.raw_len() != 2 {
            return Err(wrong());
        }
        let number = |index: usize| -> Result<f64, Refusal> {
            let value: LuaValue = table.raw_get(index)?;
            let whole = || value.as_integer().map(|number| number as f64);
            value.as_number().or_else(whole).ok_or_else(wrong)
        };
        Ok([number(1)?, number(2)?])
    }
}
