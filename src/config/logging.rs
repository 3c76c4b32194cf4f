//! How logs are written: the `logging:` section.

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::robot::whole_within;

/// How logs are written on stderr.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Logging {
    /// What is logged; `RUST_LOG` overrides it, in more detail.
    pub level: Level,
    /// For people or for programs; `--log-format` overrides it.
    pub format: Format,
    /// The time at the beginning of each line.
    pub time: Time,
    /// Whether lines are coloured; `NO_COLOR` overrides `auto`.
    pub colour: When,
    /// The most bytes written per day, of which a 24th may be used at once: 256 MiB. The rest is
    /// counted.
    #[serde(deserialize_with = "bytes_a_day")]
    pub bytes_a_day: u64,
}

impl Default for Logging {
    fn default() -> Logging {
        Logging {
            level: Level::default(),
            format: Format::default(),
            time: Time::default(),
            colour: When::default(),
            bytes_a_day: 256 << 20,
        }
    }
}

fn bytes_a_day<'de, D: Deserializer<'de>>(from: D) -> Result<u64, D::Error> {
    let words = "a whole number of bytes, 1048576 to 2^50";
    whole_within(from, words, (1 << 20)..=(1 << 50))
}

/// Lines below this level are left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// Errors only.
    Error,
    /// And warnings.
    Warn,
    /// And information.
    #[default]
    Info,
    /// And details.
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
