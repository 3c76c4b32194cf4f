//! The JSON types of the API's requests and responses.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::command::{BehaviourAction, Light};
use crate::clock::Span;
use crate::robot::{ParamValue, Percent};

/// The health of the program and the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Health {
    /// Whether the pilot responds.
    pub live: bool,
    /// Whether the robot is connected.
    pub ready: bool,
}

/// The result of a request.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Outcome {
    /// Whether it was executed.
    pub ok: bool,
    /// The result in words, such as how a docking ended.
    pub text: String,
}

/// A light and its new state.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Lamp {
    /// The light.
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

/// The volume.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Volume {
    /// From 0 to 100.
    pub percent: Percent,
}

/// A parameter of a behaviour and its new value.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Tuned {
    /// Its name.
    pub param: String,
    /// Its new value.
    pub value: ParamValue,
}

/// A change of a behaviour's state.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Become")]
pub(super) struct BehaviourChange {
    /// The change.
    pub change: BehaviourAction,
    /// With `start`: end it after this time, such as `30m`, or a number of seconds.
    #[serde(rename = "for")]
    pub lasts: Option<Span>,
}

/// A docking; the defaults are those of `robot.dock`.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Dock {
    /// Maximum duration of one search, from 1 to 3600 s.
    pub seconds: Option<u64>,
    /// Number of retries, from 0 to 20.
    pub retries: Option<u32>,
}

/// A timeout.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TimeLimit {
    /// In whole seconds, from 1 to 600.
    pub seconds: Option<u64>,
}

/// The result of a docking or undocking, successful or not.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Docking {
    /// Whether it succeeded.
    pub ok: bool,
    /// The same as `end`.
    pub text: String,
    /// The same as `end`, if it failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub error: Option<String>,
    /// `done`, `already_docked`, `not_docked`, `base_not_found`, `timeout`, and so on, as in
    /// scripts.
    pub end: &'static str,
    /// Attempts made; absent for an undocking.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub attempts: Option<u32>,
    /// Time taken; absent for an undocking.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
}
