//! How logs are written: the `logging:` section.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How logs are written on stderr.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Logging {
    /// What is logged; `RUST_LOG` says it in more detail and wins.
    pub level: Level,
    /// For people or for programs; `--log-format` wins.
    pub format: Format,
    /// Which time stands before a line.
    pub time: Time,
    /// Whether lines are coloured; `NO_COLOR` wins over `auto`.
    pub colour: When,
}

/// Lines below this level are left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Only what went wrong.
    Error,
    /// And what may go wrong.
    Warn,
    /// And what happens.
    #[default]
    Info,
    /// And why.
    Debug,
}

/// The form of a log line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Lines for people.
    #[default]
    Text,
    /// One JSON object a line.
    Json,
}

/// The time of a log line. In virtual time it is always the time since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Time {
    /// Since the start on a terminal, UTC in files and pipes.
    #[default]
    Auto,
    /// Since the start, in seconds.
    Run,
    /// UTC, with the date.
    Utc,
    /// The computer's time zone, with the date.
    Local,
}

/// When colours are used.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum When {
    /// On a terminal.
    #[default]
    Auto,
    /// Also in files and pipes.
    Always,
    /// Nowhere.
    Never,
}
