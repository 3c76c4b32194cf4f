//! The shapes of what the JSON API takes and gives.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::command::{Light, Turn};
use crate::clock::Span;
use crate::robot::{ParamValue, Percent};

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
    pub value: ParamValue,
}

/// What is to become of a behaviour.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Become {
    /// This.
    pub change: Turn,
    /// With `start`: it is ended after this time, such as `30m`.
    #[serde(rename = "for")]
    #[schemars(with = "Option<String>")]
    pub lasts: Option<Span>,
}

/// A docking; what is left out is as `robot.dock` has it.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Dock {
    /// The longest search of one try, 1..=3600 s.
    pub seconds: Option<u64>,
    /// Tries after the first, 0..=20.
    pub retries: Option<u32>,
}

/// How long something may take.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TimeLimit {
    /// In whole seconds, 1..=600.
    pub seconds: Option<u64>,
}

/// How a docking or undocking ended, whether well or not.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Docking {
    /// The robot is where it was wanted.
    pub ok: bool,
    /// As `end`.
    pub text: String,
    /// As `end`, if it did not work.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// `done`, `already_docked`, `not_docked`, `base_not_found`, `timeout` and so on, as in scripts.
    pub end: &'static str,
    /// Tries made; not of an undocking.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attempts: Option<u32>,
    /// Time taken; not of an undocking.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}
