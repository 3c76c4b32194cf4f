//! Keeps a journal's file within its maximum age and size.

use jiff::Timestamp;
use rusqlite::{Connection, params};

use super::error::JournalError;
use super::options::Options;

/// Maximum number of rows deleted at once, so that no transaction grows large.
const DELETED_AT_ONCE: i64 = 2000;
/// If the file is too large, the oldest rows of each table are deleted, one part in this many at a
/// time.
const PART: i64 = 16;
/// Maximum number of deletions in one clean-up.
const MAX_ROUNDS: u32 = 200;

/// Deletes the rows that are too old at this time, then the oldest ones until the file is small
/// enough. Returns the number of deleted rows.
pub(super) fn delete_old(
    connection: &Connection,
    options: &Options,
    now: Timestamp,
) -> Result<u64, JournalError> {
    let day = 86_400_000;
    let days = i64::try_from(options.keep_days).unwrap_or(i64::MAX);
    let before = now
        .as_millisecond()
        .saturating_sub(days.saturating_mul(day));
    let mut gone = 0;
    for _ in 0..MAX_ROUNDS {
        let went = delete_some(connection, before, |_| DELETED_AT_ONCE)?;
        gone += went;
        if went == 0 {
            break;
        }
    }
    let most = options.max_mib.saturating_mul(1 << 20);
    for _ in 0..MAX_ROUNDS {
        if bytes(connection)? <= most {
            break;
        }
        let went = delete_some(connection, i64::MAX, |rows| rows / PART + 1)?;
        gone += went;
        if went == 0 {
            break;
        }
    }
    Ok(gone)
}

/// Deletes the oldest rows of each table, only those before this time. `most` maps the number of
/// rows of a table to the maximum number to delete.
fn delete_some(
    connection: &Connection,
    before: i64,
    most: impl Fn(i64) -> i64,
) -> Result<u64, JournalError> {
    let mut went = 0;
    for table in ["event", "battery"] {
        let count = format!("SELECT count(*) FROM {table}");
        let rows = connection.query_row(&count, [], |row| row.get(0))?;
        let delete = format!(
            "DELETE FROM {table} WHERE rowid IN
                (SELECT rowid FROM {table} WHERE at < ? ORDER BY at LIMIT ?)"
        );
        went += connection.execute(&delete, params![before, most(rows)])?;
    }
    Ok(went as u64)
}

/// Returns the size of the file's content in bytes, without free pages.
pub(super) fn bytes(connection: &Connection) -> Result<u64, JournalError> {
    let number = |name: &str| {
        let query = |row: &rusqlite::Row<'_>| row.get::<_, i64>(0);
        connection.pragma_query_value(None, name, query)
    };
    let pages = number("page_count")? - number("freelist_count")?;
    Ok(u64::try_from(pages).unwrap_or(0) * page_size(connection)?)
}

/// Returns the size of a page in bytes.
pub(super) fn page_size(connection: &Connection) -> Result<u64, rusqlite::Error> {
    let size: i64 = connection.pragma_query_value(None, "page_size", |row| row.get(0))?;
    Ok(u64::try_from(size).unwrap_or(4096).max(512))
}
