//! What a script declares of its parameters, and what of the values given to it is right.

use std::collections::BTreeMap;

use super::failure::printable;
use super::nearest::suggestion;
use super::params::{GivenParam, ParamOrigin, ParamValue};

/// One declared parameter; its type is that of its default.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Declaration {
    pub(crate) default: ParamValue,
    /// Of a number.
    pub(crate) min: Option<f64>,
    /// Of a number.
    pub(crate) max: Option<f64>,
    /// Behind a number, such as `%`.
    pub(crate) unit: Option<String>,
    /// Of a text; empty: any.
    pub(crate) choices: Vec<String>,
}

impl Declaration {
    /// What a value must be, in words.
    pub(crate) fn expected(&self) -> String {
        match &self.default {
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

    /// What is said must make sense for the default's type, and hold for the default itself.
    pub(crate) fn check(&self) -> Result<(), String> {
        let is_number = matches!(self.default, ParamValue::Number(_));
        let is_text = matches!(self.default, ParamValue::Text(_));
        if !is_number && (self.min.is_some() || self.max.is_some()) {
            return Err("min and max are for numbers only".to_owned());
        }
        if !is_text && !self.choices.is_empty() {
            return Err("choices are for texts only".to_owned());
        }
        if let (Some(min), Some(max)) = (self.min, self.max)
            && min > max
        {
            return Err(format!("min {min} is above max {max}"));
        }
        if !self.allows(&self.default) {
            return Err(format!("default must be {}", self.expected()));
        }
        Ok(())
    }

    /// Whether a value has the right type and lies within the bounds.
    pub(crate) fn allows(&self, value: &ParamValue) -> bool {
        match (&self.default, value) {
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

    /// The value that was given. On a command line everything is text.
    fn read(&self, given: &GivenParam) -> Option<ParamValue> {
        let value = match (&given.origin, &given.value, &self.default) {
            (ParamOrigin::CommandLine, ParamValue::Text(text), ParamValue::Boolean(_)) => {
                ParamValue::Boolean(text.parse().ok()?)
            }
            (ParamOrigin::CommandLine, ParamValue::Text(text), ParamValue::Number(_)) => {
                ParamValue::Number(text.trim().parse().ok()?)
            }
            _ => given.value.clone(),
        };
        self.allows(&value).then_some(value)
    }
}

/// The value of each declared parameter, or what is wrong with the values that were given.
pub(crate) fn settle(
    declared: &BTreeMap<String, Declaration>,
    given: &BTreeMap<String, GivenParam>,
) -> Result<BTreeMap<String, ParamValue>, String> {
    for (name, param) in given {
        if !declared.contains_key(name) {
            return Err(unknown(name, param, declared));
        }
    }
    let value = |(name, declaration): (&String, &Declaration)| {
        let value = match given.get(name) {
            None => declaration.default.clone(),
            Some(param) => declaration.read(param).ok_or_else(|| {
                let (written, expected) = (written(name, param), declaration.expected());
                format!("{written}: {name} must be {expected}")
            })?,
        };
        Ok((name.clone(), value))
    };
    declared.iter().map(value).collect()
}

fn unknown(name: &str, param: &GivenParam, declared: &BTreeMap<String, Declaration>) -> String {
    let names = || declared.keys().map(String::as_str);
    let near = suggestion(name, names());
    let known = names().collect::<Vec<_>>().join(", ");
    let known = if known.is_empty() { "none" } else { &known };
    let written = written(name, param);
    format!("{written}: the script has no parameter '{name}'{near} (declared: {known})")
}

/// What is wrong when a script takes no parameters at all.
pub(super) fn undeclared(given: &BTreeMap<String, GivenParam>) -> Option<String> {
    let (name, param) = given.first_key_value()?;
    Some(format!(
        "{}: the script declares no parameters; it must call params.declare before it waits or moves",
        written(name, param)
    ))
}

/// A value as it was written, with its place.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn number(default: f64, min: f64, max: f64) -> Declaration {
        Declaration {
            default: ParamValue::Number(default),
            min: Some(min),
            max: Some(max),
            unit: Some("%".into()),
            choices: Vec::new(),
        }
    }

    fn given(text: &str) -> GivenParam {
        let (value, origin) = (ParamValue::Text(text.into()), ParamOrigin::CommandLine);
        GivenParam { value, origin }
    }

    fn settled(name: &str, param: GivenParam) -> Result<ParamValue, String> {
        let declared = BTreeMap::from([("speed".to_owned(), number(40.0, 10.0, 100.0))]);
        let given = BTreeMap::from([(name.to_owned(), param)]);
        settle(&declared, &given).map(|mut values| values.remove("speed").unwrap())
    }

    #[test]
    fn a_text_of_the_command_line_is_read_as_what_was_declared() {
        assert_eq!(settled("speed", given("55")), Ok(ParamValue::Number(55.0)));
    }

    #[test]
    fn a_wrong_value_is_told_with_its_place_and_what_is_right() {
        for wrong in ["500", "fast", "nan", ""] {
            let text = settled("speed", given(wrong)).unwrap_err();
            let place = format!("--param speed={wrong}: ");
            assert!(text.starts_with(&place), "{text}");
            assert!(text.ends_with("a number from 10 to 100 %"), "{text}");
        }
        let (value, origin) = (
            ParamValue::Text("50".into()),
            ParamOrigin::Config("spykee.yaml".into()),
        );
        let text = settled("speed", GivenParam { value, origin }).unwrap_err();
        assert!(
            text.starts_with("spykee.yaml: params: speed: 50: "),
            "{text}"
        );
    }

    #[test]
    fn an_unknown_name_is_told_with_the_nearest() {
        let text = settled("sped", given("50")).unwrap_err();
        assert!(text.contains("did you mean 'speed'?"), "{text}");
    }
}
