//! The journal: a SQLite file in the data folder with the events of an agent's bus. A separate
//! thread writes it; if the disk is full or slow, events that do not fit into the queue are
//! counted. A process that is killed loses the events of its last half second.

mod database;
mod history;
mod pending;
mod recorder;
mod schema;

use std::io;

use rusqlite::ErrorCode;
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::yaml::whole_within;

pub use database::{folder, journal_file};
pub use history::{JournalReader, LevelRange, Record, Span};
pub use recorder::{Journal, SimulationJournal};

/// What the journal keeps, and for how long.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "JournalOptions")]
pub struct Options {
    /// Whether there is a journal.
    pub record: When,
    /// Entries older than this many days are deleted: 400.
    #[serde(deserialize_with = "days")]
    #[schemars(range(min = 1, max = 36_500))]
    pub keep_days: u64,
    /// The largest size of the file, in MiB; beyond that the oldest entries are deleted.
    #[serde(skip)]
    pub max_mib: u64,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            record: When::Auto,
            keep_days: 400,
            max_mib: 64,
        }
    }
}

/// When there is a journal.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(rename = "JournalWhen")]
pub enum When {
    /// A service has one, a single run has none.
    #[default]
    Auto,
    /// Always.
    On,
    /// Never.
    Off,
}

/// The agent that the journal describes.
#[derive(Debug, Clone)]
pub struct RunInfo {
    pub target: String,
    pub simulated: bool,
}

fn days<'de, D: Deserializer<'de>>(from: D) -> Result<u64, D::Error> {
    whole_within(from, "a whole number of days, 1 to 36500", 1..=36_500)
}

/// Bytes of the disk that must stay free: below that nothing is written.
const FREE: u64 = 16 << 20;

#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    #[error("{path}: {source}")]
    Io { path: String, source: io::Error },
    #[error("{0}")]
    Sql(#[from] rusqlite::Error),
    #[error("a newer spykee has written it (version {found}; this one knows {known})")]
    Newer {
        found: usize,
        /// The newest version that this program knows.
        known: usize,
    },
    /// Its tables differ from those that this program creates: the file belongs to another program,
    /// or another program has changed it.
    #[error("its tables are not those of a journal")]
    Foreign,
    #[error("the disk has less than {FREE} bytes left")]
    Disk,
}

impl JournalError {
    /// Whether the file is not, or no longer, a journal.
    fn is_damage(&self) -> bool {
        match self {
            JournalError::Foreign => true,
            JournalError::Sql(error) => matches!(
                error.sqlite_error_code(),
                Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)
            ),
            _ => false,
        }
    }

    fn is_full(&self) -> bool {
        let JournalError::Sql(error) = self else {
            return false;
        };
        error.sqlite_error_code() == Some(ErrorCode::DiskFull)
    }
}
