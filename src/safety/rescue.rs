//! The `rescue` setting: which behaviour drives between two searches of a robot with a low battery.

use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// The behaviour that the tracks of a robot with a low battery are granted to between two searches,
/// a few seconds at a time. In a config: `builtin`, `off`, or the name of a `.lua` file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Rescue {
    /// The built-in behaviour: it drives over free floor and looks for the station.
    #[default]
    Builtin,
    /// No behaviour: the tracks are not granted.
    Off,
    /// The user's own behaviour.
    File(PathBuf),
}

/// A `rescue` value that is neither a known keyword nor a script.
#[derive(Debug, thiserror::Error)]
#[error("`{0}` is neither `builtin` nor `off` nor the name of a .lua file")]
pub struct UnknownRescue(String);

impl TryFrom<String> for Rescue {
    type Error = UnknownRescue;

    fn try_from(text: String) -> Result<Rescue, UnknownRescue> {
        match text.as_str() {
            "builtin" => Ok(Rescue::Builtin),
            "off" => Ok(Rescue::Off),
            file if file.ends_with(".lua") => Ok(Rescue::File(PathBuf::from(file))),
            _ => Err(UnknownRescue(text)),
        }
    }
}

impl fmt::Display for Rescue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Rescue::Builtin => f.write_str("builtin"),
            Rescue::Off => f.write_str("off"),
            Rescue::File(file) => file.display().fmt(f),
        }
    }
}

impl From<Rescue> for String {
    fn from(rescue: Rescue) -> String {
        rescue.to_string()
    }
}

impl schemars::JsonSchema for Rescue {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Rescue".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "pattern": "^(builtin|off|.+\\.lua)$" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Rescue, serde_yaml::Error> {
        serde_yaml::from_str(text)
    }

    #[test]
    fn a_config_names_a_keyword_or_a_script() {
        assert_eq!(read("builtin").unwrap(), Rescue::Builtin);
        assert_eq!(read("off").unwrap(), Rescue::Off);
        let file = Rescue::File("mine/out.lua".into());
        assert_eq!(read("mine/out.lua").unwrap(), file);
        let error = read("of").unwrap_err().to_string();
        assert!(error.contains("`of` is neither"), "{error}");
    }

    #[test]
    fn the_schema_describes_the_setting() {
        let schema = schemars::schema_for!(crate::safety::Limits).to_value();
        let rescue = &schema["properties"]["rescue"];
        assert_eq!(rescue["pattern"], r"^(builtin|off|.+\.lua)$");
        assert_eq!(rescue["type"], "string");
    }

    #[test]
    fn a_setting_survives_a_round_trip() {
        for text in ["builtin", "off", "out.lua"] {
            assert_eq!(String::from(read(text).unwrap()), text);
        }
    }
}
