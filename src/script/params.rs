//! Parameter values that a person gives to a script, on the command line or in the config, before
//! they are checked against the script's declarations.

use serde::{Deserialize, Serialize};

pub use crate::robot::ParamValue;

/// Where a value was written.
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
    /// The value.
    pub value: ParamValue,
    /// Where it was written.
    pub origin: ParamOrigin,
}
