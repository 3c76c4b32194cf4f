//! The shapes of what the JSON API takes and gives.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::order::{Light, Turn};
use super::scripts::Plain;
use crate::robot::Percent;

/// Whether the program serves, and whether the robot does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Health {
    /// The pilot answers.
    pub live: bool,
    /// The robot is connected.
    pub ready: bool,
}

/// What became of what was asked for.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Outcome {
    /// It was done.
    pub ok: bool,
    /// In words, such as how a docking ended.
    pub text: String,
}

/// A light and whether it is to be on.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Lamp {
    /// Which.
    pub light: Light,
    /// On or off.
    pub on: bool,
}

/// A sound.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Tune {
    /// Its name, such as `laser`.
    pub sound: String,
}

/// How loud.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Volume {
    /// 0..=100.
    pub percent: Percent,
}

/// A parameter of a behaviour, and what it is to be.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Tuned {
    /// Its name.
    pub param: String,
    /// Its new value.
    pub value: Plain,
}

/// What is to become of a behaviour.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Become {
    /// This.
    pub change: Turn,
}
