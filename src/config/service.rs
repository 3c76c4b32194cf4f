//! The `service:` section: options of `spykee serve`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::clock::Span;

/// What a service does while no behaviour runs, and the user that runs it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Service {
    /// What happens to the link while no behaviour runs: `keep`, or `release`, so that others can
    /// log in.
    pub idle: Idle,
    /// The time without a behaviour after which the robot is idle [default: 1m].
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
    /// The service stays connected and monitors the battery.
    #[default]
    Keep,
    /// The service disconnects from a robot on its station, so that another program can log in.
    Release,
}
