//! The parameters that a script declares, and the values that a person gives for them.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::failure::printable;
use crate::robot::DeclaredParam;
use crate::yaml::suggestion;

pub use crate::robot::ParamValue;

/// Checks what a script has declared of a parameter; its value is still the default.
pub(crate) fn check_declaration(declared: &DeclaredParam) -> Result<(), String> {
    let default = match declared.value {
        ParamValue::Number(number) => Some(number),
        ParamValue::Boolean(_) | ParamValue::Text(_) => None,
    };
    if default.is_none() && (declared.min.is_some() || declared.max.is_some()) {
        return Err("min and max are for numbers only".to_owned());
    }
    let numbers = [default, declared.min, declared.max];
    if numbers
        .into_iter()
        .flatten()
        .any(|number| !number.is_finite())
    {
        return Err("default, min and max must be finite numbers".to_owned());
    }
    if !matches!(declared.value, ParamValue::Text(_)) && !declared.choices.is_empty() {
        return Err("choices are for texts only".to_owned());
    }
    if let (Some(min), Some(max)) = (declared.min, declared.max)
        && min > max
    {
        return Err(format!("min {min} is above max {max}"));
    }
    if !declared.allows(&declared.value) {
        return Err(format!("default must be {}", declared.expected()));
    }
    Ok(())
}

/// Replaces the defaults of the declared parameters by the given values. The error says why one is
/// refused, with its place.
pub(crate) fn set_given(
    declared: &mut BTreeMap<String, DeclaredParam>,
    given: &BTreeMap<String, GivenParam>,
) -> Result<(), String> {
    for (name, param) in given {
        if !declared.contains_key(name) {
            return Err(unknown(name, param, declared));
        }
    }
    for (name, declared) in declared {
        if let Some(param) = given.get(name) {
            declared.value = param.read(declared).ok_or_else(|| {
                let written = written(name, param);
                format!("{written}: {name} must be {}", declared.expected())
            })?;
        }
    }
    Ok(())
}

fn unknown(name: &str, param: &GivenParam, declared: &BTreeMap<String, DeclaredParam>) -> String {
    let written = written(name, param);
    let names: Vec<&str> = declared.keys().map(String::as_str).collect();
    let near = suggestion(name, names.iter().copied());
    let known = if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    };
    format!("{written}: the script has no parameter '{name}'{near} (declared: {known})")
}

/// The error message if values are given to a script that declares no parameters.
pub(super) fn no_declaration_error(given: &BTreeMap<String, GivenParam>) -> Option<String> {
    let (name, param) = given.first_key_value()?;
    Some(format!(
        "{}: the script declares no parameters; it must call params.declare before it waits or moves",
        written(name, param)
    ))
}

fn written(name: &str, param: &GivenParam) -> String {
    let value = match &param.value {
        ParamValue::Boolean(value) => value.to_string(),
        ParamValue::Number(value) => value.to_string(),
        ParamValue::Text(value) => printable(value, 60),
    };
    let name = printable(name, 60);
    match &param.origin {
        ParamOrigin::CommandLine => format!("--param {name}={value}"),
        ParamOrigin::Config(file) => format!("{file}: params: {name}: {value}"),
    }
}

#[derive(Serialize, Deserialize, Clone, Debug, PartialEq, Eq)]
pub enum ParamOrigin {
    /// `--param NAME=VALUE`: always a text, converted to the type that the script has declared.
    CommandLine,
    /// The config file of this name, such as `spykee.yaml`, with the line if it is known.
    Config(String),
}

/// A value and where it was written, for messages.
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq)]
pub struct GivenParam {
    pub value: ParamValue,
    pub origin: ParamOrigin,
}

impl GivenParam {
    /// Converts the value, since everything on a command line is text. Returns `None` if it is not
    /// allowed.
    fn read(&self, declared: &DeclaredParam) -> Option<ParamValue> {
        let value = match (&self.origin, &self.value, &declared.value) {
            (ParamOrigin::CommandLine, ParamValue::Text(text), ParamValue::Boolean(_)) => {
                ParamValue::Boolean(text.parse().ok()?)
            }
            (ParamOrigin::CommandLine, ParamValue::Text(text), ParamValue::Number(_)) => {
                ParamValue::Number(text.trim().parse().ok()?)
            }
            _ => self.value.clone(),
        };
        Some(value).filter(|value| declared.allows(value))
    }
}
