//! `--param NAME=VALUE`: values for parameters that scripts declare with `params.declare`. Names
//! and values are validated against the declaration when the script runs.

use super::Failure;
use super::argument::ArgumentError;
use crate::script::{GivenParam, Options, ParamOrigin, ParamValue, suggestion};

/// One value, optionally for one of several behaviours.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Param {
    behaviour: Option<String>,
    name: String,
    value: String,
}

impl Param {
    /// Parses `NAME=VALUE` or `BEHAVIOUR.NAME=VALUE`.
    pub(super) fn parse(text: &str) -> Result<Param, ArgumentError> {
        let (key, value) = text.split_once('=').ok_or(ArgumentError::Param)?;
        let (behaviour, name) = match key.rsplit_once('.') {
            Some((behaviour, name)) => (Some(behaviour), name),
            None => (None, key),
        };
        if name.is_empty() || behaviour == Some("") {
            return Err(ArgumentError::Param);
        }
        Ok(Param {
            behaviour: behaviour.map(str::to_owned),
            name: name.to_owned(),
            value: value.to_owned(),
        })
    }
}

/// Gives each value to its behaviour; overrides values from the config. Of two values for one name
/// the last is used.
pub(super) fn apply(params: &[Param], mut behaviours: Vec<&mut Options>) -> Result<(), Failure> {
    for param in params {
        let of = owner(param, &behaviours)?;
        let given = GivenParam {
            value: ParamValue::Text(param.value.clone()),
            origin: ParamOrigin::CommandLine,
        };
        behaviours[of].params.insert(param.name.clone(), given);
    }
    Ok(())
}

/// The index of the behaviour that a value is for.
fn owner(param: &Param, behaviours: &[&mut Options]) -> Result<usize, Failure> {
    let names = || behaviours.iter().map(|options| options.name.as_str());
    let known = || names().collect::<Vec<_>>().join(", ");
    let Param {
        behaviour,
        name,
        value,
    } = param;
    match behaviour {
        None if behaviours.len() == 1 => Ok(0),
        None => {
            let what = format!("--param {name}={value}: for which behaviour?");
            let first = names().next().unwrap_or_default();
            let help = format!(
                "write --param {first}.{name}={value} (behaviours: {})",
                known()
            );
            Err(Failure::usage(what).help(help))
        }
        Some(wanted) => names().position(|name| name == wanted).ok_or_else(|| {
            let near = suggestion(wanted, names());
            let what =
                format!("--param {wanted}.{name}={value}: there is no behaviour '{wanted}'{near}");
            Failure::usage(what).help(format!("behaviours: {}", known()))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_may_contain_anything_and_behaviour_names_may_contain_dots() {
        let parsed = |text: &str| {
            let Param {
                behaviour,
                name,
                value,
            } = Param::parse(text).unwrap();
            (behaviour.unwrap_or_default(), name, value)
        };
        let texts = |a: &str, b: &str, c: &str| (a.to_owned(), b.to_owned(), c.to_owned());
        assert_eq!(parsed("speed=50"), texts("", "speed", "50"));
        assert_eq!(parsed("say=a=b.c"), texts("", "say", "a=b.c"));
        assert_eq!(parsed("patrol.v2.speed="), texts("patrol.v2", "speed", ""));
        for wrong in ["speed", "=5", ".speed=5", "patrol.=5"] {
            assert!(Param::parse(wrong).is_err(), "{wrong}");
        }
    }
}
