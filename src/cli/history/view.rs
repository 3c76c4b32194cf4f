//! Formats the journal's records as rows: a table for people, CSV for spreadsheets.

use std::time::Duration;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde_json::Value;

use super::super::table::{Side, aligned, csv_cell};
use super::runs::Run;
use crate::clock;
use crate::journal::Record;

#[derive(Debug, PartialEq)]
pub(super) struct View {
    columns: &'static [&'static str],
    rows: Vec<Vec<String>>,
}

impl View {
    /// A row for each record; see [`cell`] for the columns.
    pub(super) fn new(
        columns: &'static [&'static str],
        records: &[Record],
        zone: &TimeZone,
    ) -> View {
        let row = |one: &Record| columns.iter().map(|name| cell(name, one, zone)).collect();
        let rows = records.iter().map(row).collect();
        View { columns, rows }
    }

    pub(super) fn of_runs(runs: &[Run], zone: &TimeZone) -> View {
        let moment = |at: Option<Timestamp>| at.map_or_else(String::new, |at| time(at, zone));
        let row = |run: &Run| {
            let seconds = run.lasted().map(i64::unsigned_abs);
            let lasted = seconds.map(|seconds| clock::hours(Duration::from_secs(seconds)));
            vec![
                moment(run.began),
                moment(run.ended),
                lasted.unwrap_or_default(),
                run.behaviour.clone(),
                run.reason.clone(),
                run.message.clone(),
            ]
        };
        View {
            columns: &["began", "ended", "lasted", "behaviour", "end", "what"],
            rows: runs.iter().map(row).collect(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(super) fn table(&self) -> String {
        let titles: Vec<String> = self
            .columns
            .iter()
            .map(|name| name.to_uppercase())
            .collect();
        let head = titles.iter().zip(self.columns);
        let head: Vec<(&str, Side)> = head
            .map(|(title, name)| (title.as_str(), side(name)))
            .collect();
        aligned(&head, &self.rows)
    }

    pub(super) fn csv(&self) -> String {
        let mut csv = format!("{}\n", self.columns.join(","));
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(|cell| csv_cell(cell)).collect();
            csv.push_str(&format!("{}\n", cells.join(",")));
        }
        csv
    }
}

fn side(column: &str) -> Side {
    match column {
        "percent" | "attempts" | "seconds" | "lasted" => Side::Right,
        _ => Side::Left,
    }
}

/// A column of a record: what is known of each one, or else a text of its event.
fn cell(column: &str, one: &Record, zone: &TimeZone) -> String {
    let seconds = |long: f64| format!("{long:.1}");
    match column {
        "time" => time(one.at, zone),
        "robot" => one.robot.clone().unwrap_or_default(),
        "event" => one.kind().to_owned(),
        "what" => describe(one),
        "link" if one.kind() == "link_up" => "up".to_owned(),
        "link" => "down".to_owned(),
        "charging" if one.is("charging") => "yes".to_owned(),
        "charging" => "no".to_owned(),
        "by" => asked_by(one).to_owned(),
        "percent" | "attempts" => one
            .number(column)
            .map_or_else(String::new, |it| it.to_string()),
        "seconds" => one.number(column).map_or_else(String::new, seconds),
        "fields" => fields(one),
        _ => one.text(column).to_owned(),
    }
}

/// Who asked for a docking.
fn asked_by(one: &Record) -> &str {
    match one.text("by") {
        "" => "watchdog",
        by => by,
    }
}

fn describe(one: &Record) -> String {
    let text = |key| one.text(key);
    let whole = |key| one.number(key).unwrap_or(0.0);
    let if_docked = |words| if one.is("docked") { words } else { "" };
    match one.kind() {
        "link_up" => {
            let docked = if_docked(", on its station");
            format!("{} at {}{docked}", text("name"), text("address"))
        }
        "link_down" => text("reason").to_owned(),
        "watchdog" => {
            let docked = if_docked(", docked");
            format!("{}{docked}", text("state").replace('_', " "))
        }
        "safety" => format!("{}: {}", text("action"), text("reason")),
        "dock" => {
            let by = asked_by(one);
            let tries = match whole("attempts") {
                1.0 => "1 try".to_owned(),
                tries => format!("{tries} tries"),
            };
            format!(
                "{}, {tries}, {:.0} s, for {by}",
                text("end"),
                whole("seconds")
            )
        }
        "undock" => format!("{}, for {}", text("end"), text("by")),
        "started" => text("behaviour").to_owned(),
        "ended" => {
            let message = match text("message") {
                "" => String::new(),
                message => format!(": {message}"),
            };
            format!("{} {}{message}", text("behaviour"), text("reason"))
        }
        "given_up" => format!("{}: {}", text("behaviour"), text("message")),
        "start_missed" => format!("{}: {}", text("behaviour"), text("reason")),
        "stop_engaged" => format!("a person has stopped the robot: {}", text("by")),
        "stop_reset" => format!("a person has released the robot: {}", text("by")),
        "picture" => text("path").to_owned(),
        "entry" => format!("{}: {} {}", text("behaviour"), text("kind"), fields(one)),
        "notify" => format!("{}: {}", text("behaviour"), text("text")),
        "lost" => format!("{} events could not be written", whole("count")),
        _ => String::new(),
    }
}

fn fields(one: &Record) -> String {
    let Some(Value::Object(fields)) = one.data.get("data") else {
        return String::new();
    };
    let field = |(name, value): (&String, &Value)| match value {
        Value::String(text) => format!("{name}={text}"),
        value => format!("{name}={value}"),
    };
    fields.iter().map(field).collect::<Vec<_>>().join(" ")
}

fn time(at: Timestamp, zone: &TimeZone) -> String {
    at.to_zoned(zone.clone())
        .strftime("%Y-%m-%d %H:%M:%S")
        .to_string()
}

#[cfg(test)]
mod tests {
    use super::super::runs::tests::record;
    use super::*;
    use serde_json::json;

    fn zone() -> TimeZone {
        TimeZone::get("Europe/Rome").unwrap()
    }

    #[test]
    fn the_table_has_local_times_and_descriptions() {
        let records = [
            record(
                0,
                json!({"event": "link_up", "name": "Rover", "address": "10.0.0.2:9000", "docked": true}),
            ),
            record(
                1,
                json!({"event": "dock", "by": null, "end": "base_not_found", "attempts": 1, "seconds": 180.4}),
            ),
            record(
                2,
                json!({"event": "entry", "behaviour": "guard", "kind": "moved", "data": {"energy": 3.5, "where": "door"}}),
            ),
            record(3, json!({"event": "lost", "count": 7})),
            record(4, json!({"event": "something_of_the_future"})),
        ];
        let table = View::new(&["time", "robot", "event", "what"], &records, &zone()).table();
        for words in [
            "TIME",
            "2026-09-21 16:13:20  SPYKEE0001  link_up",
            "Rover at 10.0.0.2:9000, on its station",
            "base_not_found, 1 try, 180 s, for watchdog",
            "guard: moved energy=3.5 where=door",
            "7 events could not be written",
        ] {
            assert!(table.contains(words), "{words}:\n{table}");
        }
    }

    #[test]
    fn csv_has_one_cell_for_each_value_and_no_formula() {
        let records = [record(
            0,
            json!({"event": "notify", "behaviour": "guard", "text": "=1+1, \"quoted\""}),
        )];
        let columns = &["time", "behaviour", "text", "picture"];
        let csv = View::new(columns, &records, &zone()).csv();
        let expected = "time,behaviour,text,picture\n\
                        2026-09-21 16:13:20,guard,\"'=1+1, \"\"quoted\"\"\",\n";
        assert_eq!(csv, expected);
    }
}
