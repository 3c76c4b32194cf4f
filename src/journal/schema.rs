//! The tables, and the migration of older files. `user_version` is the number of migration steps
//! already applied to a file.

use rusqlite::{Connection, TransactionBehavior};

use super::JournalError;

/// One migration step for each version, never changed once it is released.
pub(super) const STEPS: &[&str] = &[
    "
    CREATE TABLE session (
        id INTEGER PRIMARY KEY,
        began INTEGER NOT NULL,         -- milliseconds of the epoch, as all times
        ended INTEGER,                  -- NULL: it runs, or was killed
        pid INTEGER NOT NULL,
        target TEXT NOT NULL,
        simulated INTEGER NOT NULL
    );
    CREATE TABLE event (
        id INTEGER PRIMARY KEY,
        at INTEGER NOT NULL,
        session INTEGER NOT NULL,
        robot TEXT,                     -- the uid, once known
        kind TEXT NOT NULL,
        behaviour TEXT,
        data TEXT NOT NULL              -- the whole event as JSON
    );
    CREATE INDEX event_at ON event (at);
    CREATE INDEX event_kind ON event (kind, at);
    CREATE TABLE battery (
        at INTEGER NOT NULL,
        session INTEGER NOT NULL,
        robot TEXT,
        percent INTEGER NOT NULL,
        charging INTEGER NOT NULL
    );
    CREATE INDEX battery_at ON battery (at);
",
    "
    ALTER TABLE battery RENAME TO known;
    CREATE TABLE battery (
        at INTEGER NOT NULL,
        session INTEGER NOT NULL,
        robot TEXT,
        percent INTEGER,                -- NULL: not known
        charging INTEGER NOT NULL
    );
    INSERT INTO battery SELECT at, session, robot, percent, charging FROM known ORDER BY rowid;
    DROP TABLE known;
    CREATE INDEX battery_at ON battery (at);
",
];

pub(super) const VERSION: usize = STEPS.len();

pub(super) fn version(connection: &Connection) -> rusqlite::Result<usize> {
    let version: u32 = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
    Ok(version as usize)
}

/// Returns all objects in a file: tables, indices, and what another program may have added.
fn parts(connection: &Connection) -> rusqlite::Result<Vec<[Option<String>; 3]>> {
    let select = "SELECT type, name, sql FROM sqlite_schema ORDER BY type, name";
    let mut select = connection.prepare(select)?;
    let rows = select.query_map([], |row| Ok([row.get(0)?, row.get(1)?, row.get(2)?]))?;
    rows.collect()
}

/// Checks that a file has exactly the objects that this program creates in this version. A foreign
/// view or trigger could run endlessly whenever the file is read or written.
pub(super) fn validate(
    steps: &[&str],
    connection: &Connection,
    version: usize,
) -> Result<(), JournalError> {
    let own = Connection::open_in_memory()?;
    for step in steps.iter().take(version) {
        own.execute_batch(step)?;
    }
    if parts(connection)? == parts(&own)? {
        Ok(())
    } else {
        Err(JournalError::Foreign)
    }
}

/// Migrates a file, including an empty one, to this program's version: applies all missing steps,
/// or none.
pub(super) fn migrate(steps: &[&str], connection: &mut Connection) -> Result<(), JournalError> {
    let immediate = TransactionBehavior::Immediate;
    let transaction = connection.transaction_with_behavior(immediate)?;
    let found = version(&transaction)?;
    if found > steps.len() {
        return Err(JournalError::Newer {
            found,
            known: steps.len(),
        });
    }
    validate(steps, &transaction, found)?;
    for step in &steps[found..] {
        transaction.execute_batch(step)?;
    }
    transaction.pragma_update(None, "user_version", steps.len() as u32)?;
    Ok(transaction.commit()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_file_gets_the_missing_steps_and_keeps_its_data() {
        let mut connection = Connection::open_in_memory().unwrap();
        migrate(STEPS, &mut connection).unwrap();
        let add = "INSERT INTO battery VALUES (1, 1, NULL, 50, 0)";
        connection.execute(add, []).unwrap();
        migrate(STEPS, &mut connection).unwrap();
        let longer = [STEPS, &["ALTER TABLE battery ADD COLUMN volts REAL"]].concat();
        migrate(&longer, &mut connection).unwrap();
        assert_eq!(version(&connection).unwrap(), VERSION + 1);
        let read = "SELECT percent FROM battery WHERE volts IS NULL";
        let percent: i64 = connection.query_row(read, [], |row| row.get(0)).unwrap();
        assert_eq!(percent, 50);
    }

    #[test]
    fn a_step_that_fails_leaves_the_file_as_it_was() {
        let mut connection = Connection::open_in_memory().unwrap();
        let broken = ["CREATE TABLE a (x); CREATE TABLE b (y", "no SQL"];
        assert!(migrate(&broken, &mut connection).is_err());
        assert_eq!(version(&connection).unwrap(), 0);
        migrate(STEPS, &mut connection).unwrap();
    }

    #[test]
    fn a_file_with_foreign_objects_is_refused() {
        for foreign in [
            "CREATE TRIGGER t AFTER INSERT ON event BEGIN DELETE FROM event; END",
            "DROP TABLE event; CREATE VIEW event AS SELECT 1 AS at",
            "CREATE TABLE more (x)",
            "ALTER TABLE event ADD COLUMN more",
            "CREATE INDEX more ON event (printf('%1000000000d', at))",
            "DROP INDEX event_at",
        ] {
            let mut connection = Connection::open_in_memory().unwrap();
            migrate(STEPS, &mut connection).unwrap();
            validate(STEPS, &connection, VERSION).unwrap();
            connection.execute_batch(foreign).unwrap();
            assert!(
                matches!(
                    validate(STEPS, &connection, VERSION),
                    Err(JournalError::Foreign)
                ),
                "{foreign}"
            );
            assert!(migrate(STEPS, &mut connection).is_err(), "{foreign}");
        }
    }

    #[test]
    fn a_newer_file_is_refused_with_an_explanation() {
        let mut connection = Connection::open_in_memory().unwrap();
        connection.pragma_update(None, "user_version", 99).unwrap();
        let error = migrate(STEPS, &mut connection).unwrap_err();
        assert!(error.to_string().contains("a newer spykee"), "{error}");
    }
}
