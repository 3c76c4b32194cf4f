//! How `spykee serve` goes about its robot: the `service:` section.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clock::Span;

/// What a service does while no behaviour runs, and as which user it runs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Service {
    /// What happens to the link while no behaviour runs: `keep`, or `release`, so that others can
    /// log in.
    pub idle: Idle,
    /// The time without a behaviour after which the robot is idle: 1m.
    #[schemars(with = "String")]
    pub idle_after: Span,
    /// Whether an idle robot that is off its station is sent there.
    pub dock: bool,
    /// The user that a service started as root continues as.
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

/// What happens to the link while no behaviour runs.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Idle {
    /// It stays connected, and the battery is monitored.
    #[default]
    Keep,
    /// The service disconnects from a robot on its station, so that another program can log in.
    Release,
}
