//! Formats the journal's records as rows: a table for people, CSV for spreadsheets.

use std::time::Duration;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde_json::Value;

use super::super::table::{Side, aligned, csv_cell};
use super::runs::Run;
use crate::clock;
use crate::journal::Record;

#[derive(Debug, Default, PartialEq)]
pub(super) struct View {
    head: Vec<(&'static str, Side)>,
    rows: Vec<Vec<String>>,
}

impl View {
    fn new(head: &[(&'static str, Side)], rows: impl Iterator<Item = Vec<String>>) -> View {
        View {
            head: head.to_vec(),
            rows: rows.collect(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    pub(super) fn table(&self) -> String {
        let upper: Vec<(String, Side)> = self
            .head
            .iter()
            .map(|(title, side)| (title.to_uppercase(), *side))
            .collect();
        let head: Vec<(&str, Side)> = upper
            .iter()
            .map(|(title, side)| (title.as_str(), *side))
            .collect();
        aligned(&head, &self.rows)
    }

    pub(super) fn csv(&self) -> String {
        let head: Vec<String> = self
            .head
            .iter()
            .map(|(title, _)| (*title).to_owned())
            .collect();
        std::iter::once(&head)
            .chain(&self.rows)
            .map(|row| {
                let cells: Vec<String> = row.iter().map(|cell| csv_cell(cell)).collect();
                format!("{}\n", cells.join(","))
            })
            .collect()
    }
}

use Side::{Left, Right};

pub(super) fn all(records: &[Record], zone: &TimeZone) -> View {
    let head = [
        ("time", Left),
        ("robot", Left),
        ("event", Left),
        ("what", Left),
    ];
    let rows = records.iter().map(|one| {
        let robot = one.robot.clone().unwrap_or_default();
        vec![
            time(one.at, zone),
            robot,
            one.kind().to_owned(),
            describe(one),
        ]
    });
    View::new(&head, rows)
}

pub(super) fn battery(records: &[Record], zone: &TimeZone) -> View {
    let head = [
        ("time", Left),
        ("robot", Left),
        ("percent", Right),
        ("charging", Left),
    ];
    let rows = records.iter().map(|one| {
        let robot = one.robot.clone().unwrap_or_default();
        vec![
            time(one.at, zone),
            robot,
            number(one, "percent"),
            yes(one.is("charging")),
        ]
    });
    View::new(&head, rows)
}

pub(super) fn link(records: &[Record], zone: &TimeZone) -> View {
    let head = [
        ("time", Left),
        ("robot", Left),
        ("link", Left),
        ("what", Left),
    ];
    let rows = records.iter().map(|one| {
        let state = if one.kind() == "link_up" {
            "up"
        } else {
            "down"
        };
        let robot = one.robot.clone().unwrap_or_default();
        vec![time(one.at, zone), robot, state.to_owned(), describe(one)]
    });
    View::new(&head, rows)
}

pub(super) fn docks(records: &[Record], zone: &TimeZone) -> View {
    let head = [
        ("time", Left),
        ("robot", Left),
        ("event", Left),
        ("by", Left),
        ("end", Left),
        ("attempts", Right),
        ("seconds", Right),
    ];
    let rows = records.iter().map(|one| {
        let by = match one.text("by") {
            "" => "watchdog",
            by => by,
        };
        vec![
            time(one.at, zone),
            one.robot.clone().unwrap_or_default(),
            one.kind().to_owned(),
            by.to_owned(),
            one.text("end").to_owned(),
            number(one, "attempts"),
            one.number("seconds")
                .map_or_else(String::new, |long| format!("{long:.1}")),
        ]
    });
    View::new(&head, rows)
}

pub(super) fn runs(runs: &[Run], zone: &TimeZone) -> View {
    let head = [
        ("began", Left),
        ("ended", Left),
        ("lasted", Right),
        ("behaviour", Left),
        ("end", Left),
        ("what", Left),
    ];
    let rows = runs.iter().map(|run| {
        let moment = |at: Option<Timestamp>| at.map_or_else(String::new, |at| time(at, zone));
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
    });
    View::new(&head, rows)
}

pub(super) fn pictures(records: &[Record], zone: &TimeZone) -> View {
    let head = [("time", Left), ("behaviour", Left), ("path", Left)];
    let rows = records.iter().map(|one| {
        let behaviour = one.text("behaviour");
        let path = one.text("path");
        vec![time(one.at, zone), behaviour.to_owned(), path.to_owned()]
    });
    View::new(&head, rows)
}

pub(super) fn entries(records: &[Record], zone: &TimeZone) -> View {
    let head = [
        ("time", Left),
        ("behaviour", Left),
        ("kind", Left),
        ("fields", Left),
    ];
    let rows = records.iter().map(|one| {
        let behaviour = one.text("behaviour");
        let kind = one.text("kind");
        vec![
            time(one.at, zone),
            behaviour.to_owned(),
            kind.to_owned(),
            fields(one),
        ]
    });
    View::new(&head, rows)
}

pub(super) fn messages(records: &[Record], zone: &TimeZone) -> View {
    let head = [
        ("time", Left),
        ("behaviour", Left),
        ("text", Left),
        ("picture", Left),
    ];
    let rows = records.iter().map(|one| {
        let behaviour = one.text("behaviour");
        let text = one.text("text");
        let picture = one.text("picture").to_owned();
        vec![
            time(one.at, zone),
            behaviour.to_owned(),
            text.to_owned(),
            picture,
        ]
    });
    View::new(&head, rows)
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
            let by = match text("by") {
                "" => "watchdog",
                by => by,
            };
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

fn number(one: &Record, key: &str) -> String {
    one.number(key)
        .map_or_else(String::new, |number| number.to_string())
}

fn yes(is: bool) -> String {
    if is { "yes" } else { "no" }.to_owned()
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
        let table = all(&records, &zone()).table();
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
        let csv = messages(&records, &zone()).csv();
        let expected = "time,behaviour,text,picture\n\
                        2026-09-21 16:13:20,guard,\"'=1+1, \"\"quoted\"\"\",\n";
        assert_eq!(csv, expected);
    }
}
