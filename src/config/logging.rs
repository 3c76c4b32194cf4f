//! The `logging:` section: options of the log.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Options of the log on stderr.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Logging {
    /// The lowest level that is logged; `RUST_LOG` overrides it with a finer filter.
    pub level: Level,
    /// The format, for people or for programs; `--log-format` overrides it.
    pub format: Format,
    /// The kind of time at the beginning of each line.
    pub time: Time,
    /// When lines are coloured; `NO_COLOR` overrides `auto`.
    pub colour: When,
}

/// The lowest level that is logged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Only errors.
    Error,
    /// Errors and warnings.
    Warn,
    /// Also information.
    #[default]
    Info,
    /// Also details.
    Debug,
}

/// The format of log lines.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// Text for people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}

/// The kind of time in log lines. In virtual time it is always the time since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Time {
    /// The time since the start on a terminal, UTC in files and pipes.
    #[default]
    Auto,
    /// The time since the start, in seconds.
    Run,
    /// UTC, with the date.
    Utc,
    /// The computer's time zone, with the date.
    Local,
}

/// When to use colours.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum When {
    /// On a terminal.
    #[default]
    Auto,
    /// Also in files and pipes.
    Always,
    /// Not at all.
    Never,
}
