//! `spykee history`: shows the journal as a table, as JSON or CSV.

use std::collections::BTreeMap;
use std::time::Duration;

use clap::ValueEnum;
use jiff::civil::DateTime;
use jiff::tz::TimeZone;
use jiff::{Span, Timestamp};
use serde_json::Value;

use super::settings::CommandSettings;
use super::table::aligned;
use super::{Exit, Failure, print, print_json};
use crate::clock;
use crate::journal::{self, JournalReader, Record};
use crate::sanitize::{csv_cell, json_text};

/// Show the journal: links, battery, docks, alarms, runs, pictures, entries by scripts
///
/// `spykee serve` keeps a journal; `spykee run` keeps one with `journal: { record: on }` in the
/// config. Times are local. The page draws the same journal: spykee run --live, or a service.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee history --since 1d\n  spykee history docks --since 2026-11-01 \
                        --csv > docks.csv"
)]
pub(super) struct HistoryArgs {
    /// Kind of entries to show
    #[arg(value_enum, default_value_t = Topic::All)]
    topic: Topic,

    /// Only entries since this time: an age (30m, 12h, 7d), a date (2026-11-01), or a date and a
    /// time (2026-11-01T21:30) [default: the newest 1000 entries]
    #[arg(long, value_name = "WHEN", value_parser = parse_moment)]
    since: Option<Moment>,

    /// Only entries until this time, in the same form
    #[arg(long, value_name = "WHEN", value_parser = parse_moment)]
    until: Option<Moment>,

    /// Only entries of this robot
    #[arg(long, value_name = "UID")]
    robot: Option<String>,

    /// Print a JSON array
    #[arg(long, conflicts_with = "csv")]
    json: bool,

    /// Print CSV for spreadsheets
    #[arg(long)]
    csv: bool,
}

/// A value of `--since` and `--until`.
#[derive(Debug, Clone, Copy)]
enum Moment {
    /// This long before now.
    Ago(Span),
    At(DateTime),
}

fn parse_moment(text: &str) -> Result<Moment, &'static str> {
    let text = text.trim();
    if let Ok(ago) = text.parse::<Span>()
        && !ago.is_negative()
    {
        return Ok(Moment::Ago(ago));
    }
    text.parse().map(Moment::At).map_err(|_| {
        "expected an age with its unit, such as 30m, 12h, 7d or 2w, or a date such as 2026-11-01 \
         or 2026-11-01T21:30"
    })
}

impl Moment {
    fn resolve(&self, now: Timestamp, zone: &TimeZone) -> Result<Timestamp, jiff::Error> {
        let resolved = match self {
            Moment::Ago(ago) => now.to_zoned(zone.clone()).checked_sub(*ago)?,
            Moment::At(time) => zone.to_ambiguous_zoned(*time).compatible()?,
        };
        Ok(resolved.timestamp())
    }
}

/// The entries to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Topic {
    /// Everything except the battery level
    All,
    /// The battery level, each minute and at each change
    Battery,
    /// Connections to the robot: when the link was up and down
    Link,
    /// Dockings and undockings: how they ended, tries, time
    Docks,
    /// Watchdog actions, STOP, behaviours that were given up, missed starts, changes of the timetable,
    /// events that were lost
    Alarms,
    /// Behaviours: start, end, and how they ended
    Runs,
    /// Pictures and their paths
    Pictures,
    /// Entries that scripts added with journal.add
    Entries,
    /// Messages that scripts sent with notify.send
    Messages,
}

impl Topic {
    fn kinds(self) -> &'static [&'static str] {
        match self {
            Topic::All => &[],
            Topic::Battery => &["battery"],
            Topic::Link => &["link_up", "link_down"],
            Topic::Docks => &["dock", "undock"],
            Topic::Alarms => &[
                "safety",
                "given_up",
                "start_missed",
                "stop_engaged",
                "stop_reset",
                "timetable_changed",
                "lost",
            ],
            Topic::Runs => &["started", "ended"],
            Topic::Pictures => &["picture"],
            Topic::Entries => &["entry"],
            Topic::Messages => &["notify"],
        }
    }
}

const DEFAULT_LIMIT: u32 = 1000;

pub(super) fn run(args: &HistoryArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let config = settings.config()?;
    let zone = config.zone().time_zone().clone();
    let now = Timestamp::now();
    let resolve = |moment: Moment| {
        let resolved = moment.resolve(now, &zone);
        resolved.map_err(|error| Failure::usage(format!("there is no such time: {error}")))
    };
    let span = journal::Span {
        since: args.since.map(resolve).transpose()?,
        until: args.until.map(resolve).transpose()?,
        robot: args.robot.clone(),
        newest: None,
    };
    let folder = config.data_folder();
    let shown = folder.display();
    let opened = JournalReader::open(folder)
        .map_err(|error| Failure::io(format_args!("read the journal in {shown}"), error))?;
    let history = opened.ok_or_else(|| {
        Failure::usage(format_args!("there is no journal in {shown}")).help(
            "`spykee serve` keeps one, and with `journal: { record: on }` in the config `spykee run` \
             too; --config selects another config and its data folder",
        )
    })?;
    list(args, &history, span, &zone)
}

fn list(
    args: &HistoryArgs,
    history: &JournalReader,
    mut span: journal::Span,
    zone: &TimeZone,
) -> Result<Exit, Failure> {
    if span.since.is_none() {
        span.newest = Some(DEFAULT_LIMIT);
    }
    let records = match args.topic {
        Topic::Battery => history.battery(&span),
        topic => history.records(topic.kinds(), &span),
    };
    let records = records.map_err(|error| Failure::io("read the journal", error))?;
    if span.since.is_none() && records.len() == DEFAULT_LIMIT as usize {
        tracing::warn!("only the newest {DEFAULT_LIMIT} entries are shown; --since shows more");
    }
    if args.json {
        return print_json(&records);
    }
    let view = view(args.topic, &records, zone);
    if args.csv {
        print(&view.csv())
    } else if view.is_empty() {
        print("the journal has no such entries\n")
    } else {
        print(&view.table())
    }
}

fn view(topic: Topic, records: &[Record], zone: &TimeZone) -> View {
    let columns: &'static [&'static str] = match topic {
        Topic::All | Topic::Alarms => &["time", "robot", "event", "what"],
        Topic::Battery => &["time", "robot", "percent", "charging"],
        Topic::Link => &["time", "robot", "link", "what"],
        Topic::Docks => &["time", "robot", "event", "by", "end", "attempts", "seconds"],
        Topic::Runs => return View::of_runs(records, zone),
        Topic::Pictures => &["time", "behaviour", "path"],
        Topic::Entries => &["time", "behaviour", "kind", "fields"],
        Topic::Messages => &["time", "behaviour", "text", "picture"],
    };
    View::new(columns, records, zone)
}

/// The records as rows: a table for people, CSV for spreadsheets.
#[derive(Debug, PartialEq)]
struct View {
    columns: &'static [&'static str],
    rows: Vec<Vec<String>>,
}

impl View {
    /// A row for each record; see [`cell`] for the columns.
    fn new(columns: &'static [&'static str], records: &[Record], zone: &TimeZone) -> View {
        let row = |one: &Record| columns.iter().map(|name| cell(name, one, zone)).collect();
        let rows = records.iter().map(row).collect();
        View { columns, rows }
    }

    /// A row for each run of a behaviour, in the order in which they began. One that has no end is still
    /// running, or its agent was killed.
    fn of_runs(records: &[Record], zone: &TimeZone) -> View {
        let new_row = |behaviour: &str| {
            let mut row = vec![String::new(); 7];
            row[3] = behaviour.to_owned();
            row
        };
        let mut rows: Vec<Vec<String>> = Vec::new();
        let mut open: BTreeMap<(i64, &str), usize> = BTreeMap::new();
        for record in records {
            let key = (record.session, record.text("behaviour"));
            let at = time(record.at, zone);
            if record.kind() == "started" {
                open.insert(key, rows.len());
                let mut row = new_row(key.1);
                row[0] = at;
                row[4] = record.text("by").to_owned();
                rows.push(row);
                continue;
            }
            let number = open.remove(&key).unwrap_or(rows.len());
            if number == rows.len() {
                rows.push(new_row(key.1));
            }
            let seconds = record.number("seconds").unwrap_or_default();
            let lasted = Duration::try_from_secs_f64(seconds.round());
            let row = &mut rows[number];
            row[1] = at;
            row[2] = clock::hours(lasted.unwrap_or_default());
            row[5] = record.text("reason").to_owned();
            row[6] = message_and_who(record);
        }
        View {
            columns: &["began", "ended", "lasted", "behaviour", "by", "end", "what"],
            rows,
        }
    }

    fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    fn table(self) -> String {
        let title = |name: &&str| match *name {
            "percent" | "attempts" | "seconds" | "lasted" => format!(">{}", name.to_uppercase()),
            _ => name.to_uppercase(),
        };
        let titles: Vec<String> = self.columns.iter().map(title).collect();
        aligned(&titles.join("|"), self.rows)
    }

    fn csv(&self) -> String {
        let mut csv = format!("{}\n", self.columns.join(","));
        for row in &self.rows {
            let cells: Vec<String> = row.iter().map(|cell| csv_cell(cell)).collect();
            csv.push_str(&format!("{}\n", cells.join(",")));
        }
        csv
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

/// Why a behaviour has ended, and who has ended it, or what.
fn message_and_who(one: &Record) -> String {
    match (one.text("message"), one.text("by")) {
        (message, "") => message.to_owned(),
        ("", by) => by.to_owned(),
        (message, by) => format!("{message} ({by})"),
    }
}

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
            let end = text("end");
            let seconds = whole("seconds");
            match whole("attempts") {
                1.0 => format!("{end}, 1 try, {seconds:.0} s, for {by}"),
                tries => format!("{end}, {tries} tries, {seconds:.0} s, for {by}"),
            }
        }
        "undock" => format!("{}, for {}", text("end"), text("by")),
        "started" => match text("by") {
            "" => text("behaviour").to_owned(),
            by => format!("{}: {by}", text("behaviour")),
        },
        "ended" => {
            let message = match message_and_who(one) {
                message if message.is_empty() => message,
                message => format!(": {message}"),
            };
            format!("{} {}{message}", text("behaviour"), text("reason"))
        }
        "given_up" => format!("{}: {}", text("behaviour"), text("message")),
        "start_missed" => format!("{}: {}", text("behaviour"), text("reason")),
        "standstill" | "stop_engaged" | "stop_reset" | "timetable_changed" => why_it_stands(one),
        "picture" => text("path").to_owned(),
        "entry" => format!("{}: {} {}", text("behaviour"), text("kind"), fields(one)),
        "notify" => format!("{}: {}", text("behaviour"), text("text")),
        "lost" => format!("{} events could not be written", whole("count")),
        _ => String::new(),
    }
}

fn why_it_stands(one: &Record) -> String {
    let by = one.text("by");
    match one.kind() {
        "stop_engaged" => format!("a person has stopped the robot: {by}"),
        "stop_reset" => format!("a person has released the robot: {by}"),
        "timetable_changed" => format!("{}: {by}", one.text("text")),
        _ => format!(
            "the robot stands although {} runs: {}",
            one.text("behaviour"),
            one.text("reason")
        ),
    }
}

fn fields(one: &Record) -> String {
    let Some(Value::Object(fields)) = one.data.get("data") else {
        return String::new();
    };
    let fields = fields.iter();
    let fields = fields.map(|(name, value)| format!("{name}={}", json_text(value)));
    fields.collect::<Vec<_>>().join(" ")
}

fn time(at: Timestamp, zone: &TimeZone) -> String {
    at.to_zoned(zone.clone())
        .strftime("%Y-%m-%d %H:%M:%S")
        .to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn resolved(text: &str) -> String {
        let now = "2026-11-22T12:00:00Z".parse().unwrap();
        let zone = TimeZone::get("Europe/Rome").unwrap();
        let at = parse_moment(text).unwrap().resolve(now, &zone).unwrap();
        at.to_string()
    }

    #[test]
    fn ages_dates_and_times_are_understood() {
        assert_eq!(resolved("90m"), "2026-11-22T10:30:00Z");
        assert_eq!(resolved("7d"), "2026-11-15T12:00:00Z");
        assert_eq!(resolved("0.5h"), "2026-11-22T11:30:00Z");
        assert_eq!(resolved("2026-11-01"), "2026-10-31T23:00:00Z");
        assert_eq!(resolved("2026-11-01T21:30"), "2026-11-01T20:30:00Z");
        assert_eq!(resolved("2026-11-01 21:30"), "2026-11-01T20:30:00Z");
    }

    #[test]
    fn a_time_in_the_hour_that_the_clock_skips_is_moved_forward() {
        assert_eq!(resolved("2026-03-29T02:30"), "2026-03-29T01:30:00Z");
    }

    #[test]
    fn the_error_for_invalid_text_names_the_expected_form() {
        for text in [
            "",
            "yesterday",
            "7",
            "-1d",
            "7x",
            "2026-13-01",
            "nand",
            "infd",
            "1e9w",
        ] {
            let error = parse_moment(text).unwrap_err();
            assert!(error.contains("7d"), "{text}: {error}");
        }
    }

    proptest! {
        #[test]
        fn no_text_causes_a_panic(text in "\\PC{0,30}") {
            if let Ok(moment) = parse_moment(&text) {
                let _ = moment.resolve(Timestamp::now(), &TimeZone::UTC);
            }
        }
    }

    fn record(seconds: i64, data: serde_json::Value) -> Record {
        Record {
            at: Timestamp::from_second(1_790_000_000 + seconds).unwrap(),
            session: 1,
            robot: Some("SPYKEE0001".to_owned()),
            data: data.as_object().unwrap().clone(),
        }
    }

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

    #[test]
    fn starts_and_ends_make_runs_and_a_killed_run_has_no_end() {
        let records = [
            record(0, json!({"event": "started", "behaviour": "patrol"})),
            record(
                1,
                json!({"event": "started", "behaviour": "guard", "by": "the timetable"}),
            ),
            record(
                5,
                json!({"event": "ended", "behaviour": "guard", "reason": "error", "message": "guard.lua:3: no"}),
            ),
            record(6, json!({"event": "started", "behaviour": "guard"})),
            record(
                9,
                json!({"event": "ended", "behaviour": "patrol", "reason": "cancelled", "by": "the page, token sofa"}),
            ),
        ];
        let runs = View::of_runs(&records, &zone()).rows;
        let summary: Vec<_> = runs
            .iter()
            .map(|run| (run[3].as_str(), run[5].as_str(), !run[1].is_empty()))
            .collect();
        let expected = [
            ("patrol", "cancelled", true),
            ("guard", "error", true),
            ("guard", "", false),
        ];
        assert_eq!(runs[0][6], "the page, token sofa");
        assert_eq!(
            (&*runs[1][4], &*runs[1][6]),
            ("the timetable", "guard.lua:3: no")
        );
        assert_eq!(summary, expected);
        let began_before = View::of_runs(&records[2..3], &zone()).rows;
        assert_eq!(began_before[0][0], "");
    }
}
