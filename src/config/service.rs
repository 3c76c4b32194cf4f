//! How `spykee serve` goes about its robot: the `service:` section.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clock::Span;

/// What a service does while nothing runs, and as which user.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Service {
    /// What becomes of the link while nothing runs: `keep`, or `release`, so that others can log in.
    pub idle: Idle,
    /// How long nothing runs before the robot is idle: 1m.
    #[schemars(with = "String")]
    pub idle_after: Span,
    /// An idle robot that is off its station is sent there.
    pub dock: bool,
    /// Started as root, it goes on as this user of the computer.
    pub user: Option<String>,
}

impl Default for Service {
    fn default() -> Service {
        Service {
            idle: Idle::default(),
            idle_after: Span::minutes(1),
            dock: true,
            user: None,
        }
    }
}

/// What becomes of the link while nothing runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Idle {
    /// It stays: the battery is watched over.
    #[default]
    Keep,
    /// The link to a robot on its station is released, so that another program can log in.
    Release,
}
