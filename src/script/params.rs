//! Parameters: values that a person gives to a script from outside, on the command line or in the
//! config, as they travel to the script that declares them.

use serde::{Deserialize, Serialize};

pub use crate::robot::ParamValue;

/// Where a value was written.
#[derive(Serialize, Deserialize, Clone, Debug, PartialEq, Eq)]
pub enum ParamOrigin {
    /// `--param NAME=VALUE`: always a text, read as what the script has declared.
    CommandLine,
    /// The config of this name, such as `spykee.yaml`, with the line if it is known.
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
