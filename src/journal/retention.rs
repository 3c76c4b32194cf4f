//! Keeps a journal's file within its age and its size.

use jiff::Timestamp;
use rusqlite::{Connection, params};

use super::error::JournalError;
use super::options::Options;

/// What is forgotten in one go, so that no transaction grows large.
const FORGOTTEN_AT_ONCE: i64 = 2000;
/// Of a file that is too large, this part of each table goes in one go.
const PART: i64 = 16;
/// So many goes in one clean-up.
const MOST_GOES: u32 = 200;

/// Forgets what is too old at this time of day, then the oldest until the file is small enough. How
/// many rows went.
pub(super) fn forget(
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
    for _ in 0..MOST_GOES {
        let went = forget_some(connection, before, |_| FORGOTTEN_AT_ONCE)?;
        gone += went;
        if went == 0 {
            break;
        }
    }
    let most = options.max_mib.saturating_mul(1 << 20);
    for _ in 0..MOST_GOES {
        if bytes(connection)? <= most {
            break;
        }
        let went = forget_some(connection, i64::MAX, |rows| rows / PART + 1)?;
        gone += went;
        if went == 0 {
            break;
        }
    }
    Ok(gone)
}

/// The oldest rows of each table that are older than this; of so many rows at most so many.
fn forget_some(
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

/// What the file holds, free pages left out.
pub(super) fn bytes(connection: &Connection) -> Result<u64, JournalError> {
    let number = |name: &str| {
        let query = |row: &rusqlite::Row<'_>| row.get::<_, i64>(0);
        connection.pragma_query_value(None, name, query)
    };
    let pages = number("page_count")? - number("freelist_count")?;
    Ok(u64::try_from(pages).unwrap_or(0) * page_size(connection)?)
}

/// In bytes.
pub(super) fn page_size(connection: &Connection) -> Result<u64, rusqlite::Error> {
    let size: i64 = connection.pragma_query_value(None, "page_size", |row| row.get(0))?;
    Ok(u64::try_from(size).unwrap_or(4096).max(512))
}
