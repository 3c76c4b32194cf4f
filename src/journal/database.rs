//! The journal's file: opens it, writes it, and keeps it within its maximum size. All of this may
//! block on the disk.

use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::{Connection, OpenFlags, Transaction, TransactionBehavior, params};

use super::pending::{Content, Row};
use super::{FREE, JournalError};
use super::{Options, RunInfo, schema};
use crate::files::Folder;

/// Name of the journal's folder in the data folder. No behaviour can have a folder of this name.
const FOLDER: &str = ".journal";
pub(super) const FILE: &str = "journal.db";
/// How long a write waits for another process that writes.
const BUSY: Duration = Duration::from_secs(5);
/// Number of pages after which the write-ahead log is copied into the file.
const CHECKPOINT_PAGES: u32 = 256;
/// Length to which an empty write-ahead log is truncated, in bytes.
const LOG_LEN: u32 = 1 << 20;

pub fn folder(data: &Path) -> PathBuf {
    data.join(FOLDER)
}

pub fn journal_file(data: &Path) -> PathBuf {
    folder(data).join(FILE)
}

#[derive(Debug)]
pub(super) struct Database {
    connection: Connection,
    folder: Folder,
    session: i64,
    options: Options,
}

impl Database {
    /// Opens the journal of a data folder, creates it if there is none, and starts a session at
    /// this time.
    pub(super) fn open(
        data: &Path,
        options: Options,
        about: &RunInfo,
        now: Timestamp,
    ) -> Result<Database, JournalError> {
        let path = folder(data);
        let failed = |source| JournalError::Io {
            path: path.display().to_string(),
            source,
        };
        Folder::make(data).map_err(failed)?;
        let private = Folder::make(&path).map_err(failed)?;
        if private.free().is_ok_and(|free| free < FREE) {
            return Err(JournalError::Disk);
        }
        create_file(&private).map_err(failed)?;
        let mut connection = connect(&path).map_err(failed)??;
        schema::migrate(schema::STEPS, &mut connection)?;
        let pages = options.max_mib.saturating_mul(1 << 20) / page_size(&connection)?;
        let most = u32::try_from(pages + pages / 4 + 256).unwrap_or(u32::MAX);
        // A hard limit, in case the periodic clean-up is too late.
        connection.pragma_update(None, "max_page_count", most)?;
        let began = now.as_millisecond();
        connection.execute(
            "INSERT INTO session (began, pid, target, simulated) VALUES (?, ?, ?, ?)",
            params![began, std::process::id(), about.target, about.simulated],
        )?;
        let session = connection.last_insert_rowid();
        Ok(Database {
            connection,
            folder: private,
            session,
            options,
        })
    }

    /// Renames a file that is not, or no longer, a journal. Returns its new name.
    pub(super) fn set_aside(data: &Path, now: Timestamp) -> io::Result<String> {
        let private = Folder::open(&folder(data))?;
        let aside = format!("{FILE}.damaged-{}", now.as_second());
        private.rename(FILE, &aside)?;
        for rest in ["-wal", "-shm"] {
            let _ = private.remove(&format!("{FILE}{rest}"));
        }
        Ok(aside)
    }

    /// Writes all rows or none, with a record of the number of lost events at this time. The data
    /// is on the disk when it returns.
    pub(super) fn write(
        &mut self,
        rows: &[Row],
        lost: u64,
        now: Timestamp,
    ) -> Result<(), JournalError> {
        if self.folder.free().is_ok_and(|free| free < FREE) {
            return Err(JournalError::Disk);
        }
        let session = self.session;
        let immediate = TransactionBehavior::Immediate;
        let transaction = self.connection.transaction_with_behavior(immediate)?;
        for row in rows {
            insert(&transaction, session, row)?;
        }
        if lost > 0 {
            let at = now.as_millisecond();
            let content = Content::of_lost(lost);
            let robot = rows.last().and_then(|row| row.robot.clone());
            insert(&transaction, session, &Row { at, robot, content })?;
        }
        Ok(transaction.commit()?)
    }

    pub(super) fn end(&self, now: Timestamp) -> Result<(), JournalError> {
        let ended = now.as_millisecond();
        let update = "UPDATE session SET ended = ? WHERE id = ?";
        self.connection
            .execute(update, params![ended, self.session])?;
        Ok(())
    }

    /// Deletes the rows that are too old at this time, then the oldest ones until the file is small
    /// enough. Returns the number of deleted rows.
    pub(super) fn delete_old(&mut self, now: Timestamp) -> Result<u64, JournalError> {
        let gone = delete_old(&self.connection, &self.options, now)?;
        if gone > 0 {
            let sessions = "DELETE FROM session WHERE id <> ?1
                AND id NOT IN (SELECT session FROM event) AND id NOT IN (SELECT session FROM battery)";
            self.connection.execute(sessions, [self.session])?;
            self.connection.execute_batch("PRAGMA incremental_vacuum")?;
        }
        Ok(gone)
    }
}

/// Creates the file if there is none, with access for this user only; SQLite gives its other files
/// the same mode. Replaces a symbolic link, but never a file: another agent may have created it and
/// opened it a moment ago.
fn create_file(private: &Folder) -> io::Result<()> {
    private.create(FILE)?;
    if private.item(FILE)?.is_none() {
        private.replace(FILE, b"")?;
    }
    Ok(())
}

/// Opens the connection of a writer. SQLite must not follow a symbolic link to the file, so only
/// the folder's path is resolved.
fn connect(folder: &Path) -> io::Result<Result<Connection, rusqlite::Error>> {
    let path = folder.canonicalize()?.join(FILE);
    let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
        | OpenFlags::SQLITE_OPEN_NO_MUTEX
        | OpenFlags::SQLITE_OPEN_NOFOLLOW;
    Ok(Connection::open_with_flags(path, flags).and_then(prepared))
}

fn prepared(connection: Connection) -> Result<Connection, rusqlite::Error> {
    connection.busy_timeout(BUSY)?;
    // Has an effect on an empty file only.
    connection.pragma_update(None, "auto_vacuum", "INCREMENTAL")?;
    connection.pragma_update(None, "journal_mode", "WAL")?;
    // Committed data survives a power failure.
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "wal_autocheckpoint", CHECKPOINT_PAGES)?;
    connection.pragma_update(None, "journal_size_limit", LOG_LEN)?;
    // In KiB, small because little is read twice.
    connection.pragma_update(None, "cache_size", -512)?;
    Ok(connection)
}

fn insert(transaction: &Transaction<'_>, session: i64, row: &Row) -> Result<(), rusqlite::Error> {
    let Row { at, robot, content } = row;
    match content {
        Content::Battery { percent, charging } => {
            let insert = "INSERT INTO battery (at, session, robot, percent, charging)
                VALUES (?, ?, ?, ?, ?)";
            let mut insert = transaction.prepare(insert)?;
            insert.execute(params![at, session, robot, percent, charging])?;
        }
        Content::Event {
            kind,
            behaviour,
            data,
        } => {
            let insert = "INSERT INTO event (at, session, robot, kind, behaviour, data)
                VALUES (?, ?, ?, ?, ?, ?)";
            let mut insert = transaction.prepare(insert)?;
            insert.execute(params![at, session, robot, kind, behaviour, data])?;
        }
    }
    Ok(())
}

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

pub(super) fn page_size(connection: &Connection) -> Result<u64, rusqlite::Error> {
    let size: i64 = connection.pragma_query_value(None, "page_size", |row| row.get(0))?;
    Ok(u64::try_from(size).unwrap_or(4096).max(512))
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    use super::*;
    use crate::journal::{JournalReader, Span};

    fn about() -> RunInfo {
        RunInfo {
            target: "10.0.0.2:9000".to_owned(),
            simulated: true,
        }
    }

    fn now() -> Timestamp {
        Timestamp::from_second(1_767_258_000).unwrap()
    }

    fn event(at: i64, text: &str) -> Row {
        let content = Content::Event {
            kind: "link_down".to_owned(),
            behaviour: None,
            data: serde_json::json!({ "event": "link_down", "reason": text }).to_string(),
        };
        Row {
            at,
            robot: None,
            content,
        }
    }

    fn count(data: &Path) -> usize {
        let history = JournalReader::open(data).unwrap().unwrap();
        history.records(&[], &Span::default()).unwrap().len()
    }

    #[test]
    fn its_files_are_private() {
        let data = tempfile::tempdir().unwrap();
        let mut database =
            Database::open(data.path(), Options::default(), &about(), now()).unwrap();
        database.write(&[event(1, "x")], 0, now()).unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777;
        let folder = folder(data.path());
        assert_eq!(mode(&folder), 0o700);
        let files: Vec<_> = std::fs::read_dir(&folder).unwrap().flatten().collect();
        assert!(files.len() >= 2, "{files:?}");
        for file in files {
            assert_eq!(mode(&file.path()), 0o600, "{file:?}");
        }
    }

    #[test]
    fn links_are_not_followed() {
        let data = tempfile::tempdir().unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        symlink(elsewhere.path(), folder(data.path())).unwrap();
        let error = Database::open(data.path(), Options::default(), &about(), now()).unwrap_err();
        assert!(error.to_string().contains("symbolic link"), "{error}");
        std::fs::remove_file(folder(data.path())).unwrap();
        std::fs::create_dir(folder(data.path())).unwrap();
        let target = elsewhere.path().join("x");
        std::fs::write(&target, "").unwrap();
        symlink(&target, journal_file(data.path())).unwrap();
        Database::open(data.path(), Options::default(), &about(), now()).unwrap();
        assert_eq!(target.metadata().unwrap().len(), 0);
        assert!(
            journal_file(data.path())
                .symlink_metadata()
                .unwrap()
                .is_file()
        );
    }

    #[test]
    fn old_rows_are_deleted_and_the_oldest_make_room() {
        let data = tempfile::tempdir().unwrap();
        let options = Options {
            keep_days: 10,
            max_mib: 1,
            ..Options::default()
        };
        let mut database = Database::open(data.path(), options, &about(), now()).unwrap();
        let today = now().as_millisecond();
        let old: Vec<Row> = (0..50)
            .map(|at| event(today - 11 * 86_400_000 + at, "old"))
            .collect();
        database.write(&old, 0, now()).unwrap();
        database.write(&[event(today, "new")], 0, now()).unwrap();
        assert_eq!(database.delete_old(now()).unwrap(), 50);
        assert_eq!(count(data.path()), 1);
        let long = "x".repeat(2000);
        for round in 0..6 {
            let rows: Vec<Row> = (0..100)
                .map(|at| event(today + round * 100 + at, &long))
                .collect();
            database.write(&rows, 0, now()).unwrap();
            database.delete_old(now()).unwrap();
            assert!(bytes(&database.connection).unwrap() <= 1 << 20);
        }
        let history = JournalReader::open(data.path()).unwrap().unwrap();
        let last = history.records(&[], &Span::default()).unwrap();
        assert_eq!(
            last.last().unwrap().at.as_millisecond(),
            today + 599,
            "the newest stays"
        );
    }

    #[test]
    fn a_full_file_takes_all_rows_or_none_and_more_when_there_is_room() {
        let data = tempfile::tempdir().unwrap();
        let options = Options {
            max_mib: 1,
            ..Options::default()
        };
        let mut database = Database::open(data.path(), options, &about(), now()).unwrap();
        let long = "x".repeat(10_000);
        let rows: Vec<Row> = (0..50).map(|at| event(at, &long)).collect();
        let mut written = 0;
        let error = loop {
            match database.write(&rows, 0, now()) {
                Ok(()) => written += 50,
                Err(error) => break error,
            }
        };
        assert!(error.is_full(), "{error}");
        assert_eq!(count(data.path()), written);
        database.delete_old(now()).unwrap();
        database.write(&rows[..1], 50, now()).unwrap();
        let history = JournalReader::open(data.path()).unwrap().unwrap();
        let lost = history.records(&["lost"], &Span::default()).unwrap();
        assert_eq!(lost[0].data["count"], 50);
    }

    #[test]
    fn a_file_that_is_not_a_journal_counts_as_damaged_and_is_renamed() {
        let data = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder(data.path())).unwrap();
        std::fs::write(journal_file(data.path()), vec![7; 8192]).unwrap();
        let error = Database::open(data.path(), Options::default(), &about(), now()).unwrap_err();
        assert!(error.is_damage(), "{error}");
        let aside = Database::set_aside(data.path(), now()).unwrap();
        Database::open(data.path(), Options::default(), &about(), now()).unwrap();
        let kept = std::fs::read(folder(data.path()).join(aside)).unwrap();
        assert_eq!(kept, vec![7; 8192]);
    }
}
