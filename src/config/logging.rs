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
    pub format: LogFormat,
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
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// Text for people.
    #[default]
    Text,
    /// One JSON object per line.
    Json,
}
