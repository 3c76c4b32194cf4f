//! Why a journal cannot be used.

use std::io;

use rusqlite::ErrorCode;

/// Bytes of the disk that must stay free: below that nothing is written.
pub(super) const FREE: u64 = 16 << 20;

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
    #[error("no thread for the journal: {0}")]
    Thread(io::Error),
}

impl JournalError {
    /// Whether the file is not, or no longer, a journal.
    pub(super) fn is_damage(&self) -> bool {
        match self {
            JournalError::Foreign => true,
            JournalError::Sql(error) => matches!(
                error.sqlite_error_code(),
                Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase)
            ),
            _ => false,
        }
    }

    pub(super) fn is_full(&self) -> bool {
        let JournalError::Sql(error) = self else {
            return false;
        };
        error.sqlite_error_code() == Some(ErrorCode::DiskFull)
    }
}
