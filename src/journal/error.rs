//! Why a journal cannot be used, for people and for the recorder, which tries again.

use std::io;

use rusqlite::ErrorCode;

use super::schema::SchemaError;

/// So many bytes of the disk stay free: below that nothing is written.
pub(super) const FREE: u64 = 16 << 20;

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// The system says so.
    #[error("{path}: {source}")]
    Io {
        /// Of what.
        path: String,
        /// Its words.
        source: io::Error,
    },
    /// SQLite says so.
    #[error("{0}")]
    Sql(#[from] rusqlite::Error),
    /// It is of another version.
    #[error("{0}")]
    Version(String),
    /// It is another program's, or another program has altered it.
    #[error("{0}")]
    Foreign(String),
    /// The disk is nearly full.
    #[error("the disk has less than {FREE} bytes left")]
    Disk,
    /// No thread to write it.
    #[error("no thread for the journal: {0}")]
    Thread(io::Error),
}

impl From<SchemaError> for JournalError {
    fn from(error: SchemaError) -> JournalError {
        match error {
            SchemaError::Sql(error) => error.into(),
            newer @ SchemaError::Newer { .. } => JournalError::Version(newer.to_string()),
            foreign @ SchemaError::Foreign => JournalError::Foreign(foreign.to_string()),
        }
    }
}

impl JournalError {
    /// The file is no journal any more.
    pub(super) fn is_damage(&self) -> bool {
        match self {
            JournalError::Foreign(_) => true,
            JournalError::Sql(error) => matches!(
                error.sqlite_error_code(),
                Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)
            ),
            _ => false,
        }
    }

    /// The file has reached its size.
    pub(super) fn is_full(&self) -> bool {
        let JournalError::Sql(error) = self else {
            return false;
        };
        error.sqlite_error_code() == Some(ErrorCode::DiskFull)
    }
}
