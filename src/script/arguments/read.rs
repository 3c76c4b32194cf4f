//! The types that arguments are converted to: numbers, times, names, functions, ranges.

use std::time::Duration;

use mlua::prelude::{LuaFunction, LuaValue};

use super::{Argument, Given, Refusal};
use crate::api::{Literal, Type};
use crate::wire::{Sound, Stream};

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

/// One of a set of names.
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
