//! Why a journal cannot be used. The recorder decides by this error how to continue.

use std::io;

use rusqlite::ErrorCode;

use super::schema::SchemaError;

/// Bytes of the disk that must stay free: below that nothing is written.
pub(super) const FREE: u64 = 16 << 20;

/// Why a journal cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// An error of the system.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: String,
        /// The error.
        source: io::Error,
    },
    /// An error of SQLite.
    #[error("{0}")]
    Sql(#[from] rusqlite::Error),
    /// The file has a newer version.
    #[error("{0}")]
    Version(String),
    /// The file belongs to another program, or another program has changed it.
    #[error("{0}")]
    Foreign(String),
    /// The disk is nearly full.
    #[error("the disk has less than {FREE} bytes left")]
    Disk,
    /// The system cannot start a thread.
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
    /// Whether the file is not, or no longer, a journal.
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

    /// Whether the file has reached its maximum size.
    pub(super) fn is_full(&self) -> bool {
        let JournalError::Sql(error) = self else {
            return false;
        };
        error.sqlite_error_code() == Some(ErrorCode::DiskFull)
    }
}
