//! Reads a journal, even while it is being written.

use std::path::Path;
use std::time::Duration;

use jiff::Timestamp;
use rusqlite::{Connection, OpenFlags, params_from_iter};
use serde::Serialize;
use serde_json::{Map, Value, json};

use super::JournalError;
use super::database::{FILE, folder};
use super::schema;

/// How long a reader waits for a writer.
const BUSY: Duration = Duration::from_secs(5);

/// One record of the journal. As JSON, one flat object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Record {
    /// The time; in JSON as RFC 3339 in UTC.
    pub at: Timestamp,
    /// The number of the agent's session; pairs the start of a run with its end.
    pub session: i64,
    /// The robot's uid, if one was connected.
    pub robot: Option<String>,
    /// `event` and its fields: see [`AgentEvent`](crate::robot::AgentEvent). The event of a battery
    /// level is `battery`; `lost` means that `count` events could not be written.
    #[serde(flatten)]
    pub data: Map<String, Value>,
}

impl Record {
    pub fn kind(&self) -> &str {
        self.text("event")
    }

    /// Returns a text field of the event; empty if it has none.
    pub fn text(&self, key: &str) -> &str {
        self.data
            .get(key)
            .and_then(Value::as_str)
            .unwrap_or_default()
    }

    pub fn number(&self, key: &str) -> Option<f64> {
        self.data.get(key).and_then(Value::as_f64)
    }

    /// Returns a boolean field of the event; false if it has none.
    pub fn is(&self, key: &str) -> bool {
        self.data.get(key).and_then(Value::as_bool).unwrap_or(false)
    }
}

/// The period, both ends included, and the robot to read.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Span {
    /// The start; `None`: from the beginning.
    pub since: Option<Timestamp>,
    /// The end; `None`: until now.
    pub until: Option<Timestamp>,
    /// The uid of a robot; `None`: all robots.
    pub robot: Option<String>,
    /// Maximum number of records, the newest; `None`: all.
    pub newest: Option<u32>,
}

/// The battery within one part of a period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LevelRange {
    pub part: u32,
    /// `None` if no level was known.
    pub low: Option<u8>,
    pub high: Option<u8>,
    /// The share of its records with the robot charging, 0..=1.
    pub charging: f64,
}

#[derive(Debug)]
pub struct JournalReader(Connection);

impl JournalReader {
    /// Opens the journal of a data folder; `None` if there is none. Fails if a newer
    /// program has written it.
    pub fn open(data: &Path) -> Result<Option<JournalReader>, JournalError> {
        // SQLite must not follow a symbolic link to the file, so only the folder's path is
        // resolved.
        let Ok(folder) = folder(data).canonicalize() else {
            return Ok(None);
        };
        let path = folder.join(FILE);
        let kind = path.symlink_metadata().map(|found| found.file_type());
        if !kind.is_ok_and(|kind| kind.is_file()) {
            return Ok(None);
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_WRITE
            | OpenFlags::SQLITE_OPEN_NO_MUTEX
            | OpenFlags::SQLITE_OPEN_NOFOLLOW;
        let connection = Connection::open_with_flags(path, flags)?;
        connection.busy_timeout(BUSY)?;
        connection.pragma_update(None, "query_only", true)?;
        let found = schema::version(&connection)?;
        if found > schema::VERSION {
            let known = schema::VERSION;
            return Err(JournalError::Newer { found, known });
        }
        schema::validate(schema::STEPS, &connection, found)?;
        // Version 0: created, but not written yet.
        if found == 0 {
            return Ok(None);
        }
        Ok(Some(JournalReader(connection)))
    }

    /// Returns events of these kinds, or of all if none is named, in the order in which they happened.
    pub fn records(&self, kinds: &[&str], span: &Span) -> Result<Vec<Record>, JournalError> {
        let mut records = Vec::new();
        let newest = format!("DESC LIMIT {}", span.limit());
        self.visit_ordered(kinds, span, &newest, |record| records.push(record))?;
        records.reverse();
        Ok(records)
    }

    /// Passes events of these kinds on one by one, in the order in which they happened; all of the
    /// period, however many.
    pub fn visit(
        &self,
        kinds: &[&str],
        span: &Span,
        each: impl FnMut(Record),
    ) -> Result<(), JournalError> {
        self.visit_ordered(kinds, span, "ASC", each)
    }

    fn visit_ordered(
        &self,
        kinds: &[&str],
        span: &Span,
        order: &str,
        each: impl FnMut(Record),
    ) -> Result<(), JournalError> {
        let (mut conditions, mut values) = span.conditions();
        if !kinds.is_empty() {
            let marks = vec!["?"; kinds.len()].join(", ");
            conditions.push(format!("kind IN ({marks})"));
            values.extend(kinds.iter().map(|kind| (*kind).to_owned().into()));
        }
        let columns = "at, session, robot, data";
        let select = select("event", columns, &conditions, order);
        let data = |row: &rusqlite::Row<'_>| {
            let text: String = row.get(3)?;
            let data = serde_json::from_str(&text).unwrap_or_else(|_| {
                // Edited by hand, or damaged: still shows that something happened.
                Map::from_iter([("event".to_owned(), json!("unreadable"))])
            });
            Ok(data)
        };
        self.read(&select, values, data, each)
    }

    /// Returns the lowest and the highest battery level in each of so many equal parts of a
    /// period, leaving out parts without any.
    pub fn levels(
        &self,
        since: Timestamp,
        until: Timestamp,
        parts: u32,
    ) -> Result<Vec<LevelRange>, JournalError> {
        let select =
            "SELECT (at - ?1) * ?3 / (?2 - ?1) AS part, min(percent), max(percent), avg(charging)
            FROM battery WHERE at >= ?1 AND at < ?2 GROUP BY part";
        let mut statement = self.0.prepare(select)?;
        let percent = |level: i64| level.clamp(0, 100) as u8;
        let period = (since.as_millisecond(), until.as_millisecond(), parts);
        let rows = statement.query_map(period, |row| {
            Ok(LevelRange {
                part: row.get(0)?,
                low: row.get::<_, Option<i64>>(1)?.map(percent),
                high: row.get::<_, Option<i64>>(2)?.map(percent),
                charging: row.get(3)?,
            })
        })?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    pub fn battery(&self, span: &Span) -> Result<Vec<Record>, JournalError> {
        let (conditions, values) = span.conditions();
        let columns = "at, session, robot, percent, charging";
        let order = format!("DESC LIMIT {}", span.limit());
        let select = select("battery", columns, &conditions, &order);
        let data = |row: &rusqlite::Row<'_>| {
            let percent: Option<i64> = row.get(3)?;
            let charging: bool = row.get(4)?;
            Ok(Map::from_iter([
                ("event".to_owned(), json!("battery")),
                ("percent".to_owned(), json!(percent)),
                ("charging".to_owned(), json!(charging)),
            ]))
        };
        let mut records = Vec::new();
        self.read(&select, values, data, |record| records.push(record))?;
        records.reverse();
        Ok(records)
    }

    fn read(
        &self,
        select: &str,
        values: Vec<rusqlite::types::Value>,
        data: impl Fn(&rusqlite::Row<'_>) -> rusqlite::Result<Map<String, Value>>,
        mut each: impl FnMut(Record),
    ) -> Result<(), JournalError> {
        let mut statement = self.0.prepare(select)?;
        let mut rows = statement.query(params_from_iter(values))?;
        while let Some(row) = rows.next()? {
            each(Record {
                at: Timestamp::from_millisecond(row.get(0)?).unwrap_or_default(),
                session: row.get(1)?,
                robot: row.get(2)?,
                data: data(row)?,
            });
        }
        Ok(())
    }
}

/// In the order of writing, not of time: the clock may have been set back in between.
fn select(table: &str, columns: &str, conditions: &[String], order: &str) -> String {
    let condition = if conditions.is_empty() {
        String::new()
    } else {
        format!("WHERE {}", conditions.join(" AND "))
    };
    format!("SELECT {columns} FROM {table} {condition} ORDER BY rowid {order}")
}

impl Span {
    fn limit(&self) -> i64 {
        self.newest.map_or(-1, i64::from)
    }

    fn conditions(&self) -> (Vec<String>, Vec<rusqlite::types::Value>) {
        let mut conditions = Vec::new();
        let mut values = Vec::new();
        let bounds = [("at >= ?", self.since), ("at <= ?", self.until)];
        for (condition, bound) in bounds {
            if let Some(bound) = bound {
                conditions.push(condition.to_owned());
                values.push(bound.as_millisecond().into());
            }
        }
        if let Some(robot) = &self.robot {
            conditions.push("robot = ?".to_owned());
            values.push(robot.clone().into());
        }
        (conditions, values)
    }
}
