//! What has happened and what will: the journal, the pictures that behaviours saved, and the
//! timetable. Reading blocks on the disk, so it runs on separate threads, a few at a time.

use std::collections::BTreeMap;
use std::path::Path;

use jiff::{SignedDuration, Timestamp};
use schemars::JsonSchema;
use serde::Serialize;

use crate::behaviour::validate_name;
use crate::clock::{self, Clock};
use crate::files::Folder;
use crate::journal::{JournalError, JournalReader, Record, Span};
use crate::script::picture_name;
use crate::timetable::{Hold, Reason, Timetable, predict_starts};
use crate::vision::validate_markers;

/// Number of parts of a period for its plot, however long it is; each is five minutes of a day.
const PARTS: usize = 288;
const PART_OF_A_DAY: i64 = 5 * 60 * 1000;
/// Maximum number of events in one response: the newest.
const EVENTS: u32 = 200;
/// The kinds of events in the plot.
const PLOTTED: [&str; 4] = ["dock", "safety", "started", "ended"];
const STARTS: usize = 6;
const MAX_PICTURE: u64 = 4 << 20;
/// Maximum number of records that a gallery is made of: the newest.
const GALLERY: u32 = 4000;
/// The kinds of events shown; pictures are in the gallery.
const KINDS: [&str; 13] = [
    "dock",
    "undock",
    "safety",
    "given_up",
    "start_missed",
    "standstill",
    "stop_engaged",
    "stop_reset",
    "timetable_changed",
    "started",
    "ended",
    "notify",
    "lost",
];

/// The history of some days.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct History {
    /// Start of the period, in milliseconds since 1970.
    pub since: i64,
    /// End of the period, in milliseconds since 1970.
    pub until: i64,
    /// The length of each of its parts, in milliseconds.
    pub part: i64,
    /// The parts of the period in which something was recorded, at most 288; oldest first.
    pub parts: Vec<Part>,
    /// The newest events, up to a maximum; oldest first.
    pub events: Vec<HistoryEvent>,
}

/// What happened in a part of the period.
#[derive(Debug, Clone, Default, PartialEq, Serialize, JsonSchema)]
pub(super) struct Part {
    /// Its start, in milliseconds since 1970.
    pub at: i64,
    /// The lowest battery level, in percent; null: unknown.
    pub low: Option<u8>,
    /// The highest battery level, in percent; null: unknown.
    pub high: Option<u8>,
    /// The share of its time in which the robot was charging, 0..=1.
    pub charging: f64,
    /// The share of its time in which a behaviour ran, 0..=1.
    pub running: f64,
    /// The number of behaviours that were started.
    pub runs: u32,
    /// The number of dockings that succeeded.
    pub docks: u32,
    /// The number of dockings that failed.
    pub failed_docks: u32,
    /// The number of alarms of the watchdog.
    pub alarms: u32,
}

impl Part {
    fn is_empty(&self) -> bool {
        let nothing = Part {
            at: self.at,
            ..Part::default()
        };
        *self == nothing
    }
}

/// One event.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct HistoryEvent {
    /// The time, in milliseconds since 1970.
    pub at: i64,
    /// `dock`, `undock`, `safety`, `given_up`, `start_missed`, `started`, `ended`, `notify`, `lost`,
    /// `stop_engaged`, `stop_reset`, `timetable_changed`, or `standstill`.
    pub kind: String,
    /// The behaviour, if it is an event of one.
    pub behaviour: String,
    /// The result, the action of the watchdog, or the reason.
    pub code: String,
    /// A text, such as who wanted it, possibly empty.
    pub text: String,
}

/// One future start.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct ScheduledStart {
    /// The local time in the timetable's time zone.
    pub at: String,
    /// The behaviour.
    pub run: String,
    /// When it is ended, if it has not ended on its own.
    pub until: Option<String>,
    /// `quiet`, `overlap`, `unknown` or `skipped`.
    pub notes: Vec<Reason>,
}

/// Returns the history of the last days, if there is a journal. `running` are the behaviours that
/// run now.
pub(super) fn read(
    data: &Path,
    days: u16,
    until: Timestamp,
    running: &[String],
) -> Result<Option<History>, JournalError> {
    let Some(history) = JournalReader::open(data)? else {
        return Ok(None);
    };
    let length = SignedDuration::from_hours(24 * i64::from(days));
    let since = until.saturating_sub(length);
    let since = since.unwrap_or(Timestamp::UNIX_EPOCH);
    let span = Span {
        since: Some(since),
        until: Some(until),
        ..Span::default()
    };
    let mut plot = Plot::new(since, days);
    for level in history.levels(since, until, PARTS as u32)? {
        if let Some(part) = plot.parts.get_mut(level.part as usize) {
            part.low = level.low;
            part.high = level.high;
            part.charging = level.charging;
        }
    }
    history.visit(&PLOTTED, &span, |record| plot.add(&record))?;
    plot.end(until, running);
    let newest = Span {
        newest: Some(EVENTS),
        ..span
    };
    let events = history.records(&KINDS, &newest)?;
    plot.parts.retain(|part| !part.is_empty());
    Ok(Some(History {
        since: plot.since,
        until: until.as_millisecond(),
        part: plot.part,
        parts: plot.parts,
        events: events.iter().map(event).collect(),
    }))
}

/// Sorts the events of a period into its parts.
struct Plot {
    since: i64,
    part: i64,
    parts: Vec<Part>,
    /// When the runs without an end began, by session and behaviour.
    open: BTreeMap<(i64, String), i64>,
    /// The session and the time of the newest record.
    newest: (i64, i64),
}

impl Plot {
    fn new(since: Timestamp, days: u16) -> Plot {
        let since = since.as_millisecond();
        let part = PART_OF_A_DAY * i64::from(days);
        let starts = (0..).map(|number| since + part * number).take(PARTS);
        let parts = starts.map(|at| Part {
            at,
            ..Part::default()
        });
        Plot {
            since,
            part,
            parts: parts.collect(),
            open: BTreeMap::new(),
            newest: (0, since),
        }
    }

    fn add(&mut self, record: &Record) {
        let at = record.at.as_millisecond();
        if record.session != self.newest.0 {
            self.close_runs();
        }
        self.newest = (record.session, at);
        let run = (record.session, record.text("behaviour").to_owned());
        match record.kind() {
            "started" => {
                self.open.insert(run, at);
            }
            "ended" => {
                self.open.remove(&run);
                let seconds = record.number("seconds").unwrap_or_default();
                self.add_run(at.saturating_sub((1000.0 * seconds) as i64), at);
            }
            _ => {}
        }
        let number = usize::try_from((at - self.since) / self.part).ok();
        let Some(part) = number.and_then(|number| self.parts.get_mut(number)) else {
            return;
        };
        match (record.kind(), record.text("end"), record.text("action")) {
            ("started", _, _) => part.runs += 1,
            ("dock", "done" | "already_docked", _) => part.docks += 1,
            // Somebody ended it, or the link did: it has not failed.
            ("dock", "cancelled" | "preempted" | "disconnected", _) => {}
            ("dock", _, _) => part.failed_docks += 1,
            ("safety", _, "alarm") => part.alarms += 1,
            _ => {}
        }
    }

    /// Ends the runs of an agent that was killed: with its last record.
    fn close_runs(&mut self) {
        for began in std::mem::take(&mut self.open).into_values() {
            self.add_run(began, self.newest.1);
        }
    }

    /// Ends the runs that go on with the period, and all others with the last record.
    fn end(&mut self, until: Timestamp, running: &[String]) {
        for ((_, name), began) in std::mem::take(&mut self.open) {
            let last = if running.contains(&name) {
                until.as_millisecond()
            } else {
                self.newest.1
            };
            self.add_run(began, last);
        }
    }

    fn add_run(&mut self, from: i64, to: i64) {
        let first = usize::try_from((from - self.since) / self.part).unwrap_or(0);
        for part in self.parts.iter_mut().skip(first) {
            if part.at >= to {
                return;
            }
            let covered = to.min(part.at + self.part) - from.max(part.at);
            let share = covered.max(0) as f64 / self.part as f64;
            // Several behaviours may run at the same time.
            part.running = (part.running + share).min(1.0);
        }
    }
}

fn event(record: &Record) -> HistoryEvent {
    let first = |keys: &[&str]| {
        let texts = keys.iter().map(|key| record.text(key));
        texts.into_iter().find(|text| !text.is_empty())
    };
    let code = first(&["end", "action", "reason"]).unwrap_or_default();
    let text = match record.kind() {
        "timetable_changed" => format!("{} ({})", record.text("text"), record.text("by")),
        _ => first(&["message", "text", "by"])
            .unwrap_or_default()
            .to_owned(),
    };
    HistoryEvent {
        at: record.at.as_millisecond(),
        kind: record.kind().to_owned(),
        behaviour: record.text("behaviour").to_owned(),
        code: code.to_owned(),
        text,
    }
}

/// The pictures of a period.
#[derive(Debug, Clone, Default, PartialEq, Serialize, JsonSchema)]
pub(super) struct Gallery {
    /// Those that scripts have sent to people; newest first.
    pub alarms: Vec<SavedPicture>,
    /// All others, by run; newest run first.
    pub runs: Vec<RunPictures>,
}

/// The pictures of a run.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct RunPictures {
    /// The behaviour.
    pub behaviour: String,
    /// When it was started, or saved its first picture of the period; milliseconds since 1970.
    pub began: i64,
    /// Oldest first.
    pub pictures: Vec<SavedPicture>,
}

/// A picture that a behaviour has saved.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct SavedPicture {
    /// The time, in milliseconds since 1970.
    pub at: i64,
    /// The behaviour.
    pub behaviour: String,
    /// The name of its file.
    pub name: String,
    /// What people were told with it; empty if it was not sent.
    pub text: String,
}

/// Returns the pictures of a period, if there is a journal.
pub(super) fn gallery(
    data: &Path,
    since: Timestamp,
    until: Timestamp,
) -> Result<Option<Gallery>, JournalError> {
    let Some(history) = JournalReader::open(data)? else {
        return Ok(None);
    };
    let span = Span {
        since: Some(since),
        until: Some(until),
        newest: Some(GALLERY),
        ..Span::default()
    };
    let records = history.records(&["started", "picture", "notify"], &span)?;
    Ok(Some(gallery_of(&records)))
}

fn gallery_of(records: &[Record]) -> Gallery {
    let mut gallery = Gallery::default();
    let mut began = BTreeMap::new();
    for record in records {
        let at = record.at.as_millisecond();
        let behaviour = record.text("behaviour").to_owned();
        if record.kind() == "started" {
            began.insert(behaviour, at);
            continue;
        }
        let saved = |path: &str| {
            let name = Path::new(path).file_name()?.to_string_lossy().into_owned();
            Some(SavedPicture {
                at,
                behaviour: behaviour.clone(),
                name,
                text: record.text("text").to_owned(),
            })
        };
        if record.kind() == "notify" {
            gallery.alarms.extend(saved(record.text("picture")));
            continue;
        }
        let Some(picture) = saved(record.text("path")) else {
            continue;
        };
        let began = *began.entry(behaviour.clone()).or_insert(at);
        let is_run = |run: &&mut RunPictures| run.behaviour == behaviour && run.began == began;
        match gallery.runs.iter_mut().find(is_run) {
            Some(run) => run.pictures.push(picture),
            None => gallery.runs.push(RunPictures {
                behaviour,
                began,
                pictures: vec![picture],
            }),
        }
    }
    for run in &mut gallery.runs {
        let is_alarm = |one: &SavedPicture| {
            let mut alarms = gallery.alarms.iter();
            alarms.any(|alarm| alarm.behaviour == one.behaviour && alarm.name == one.name)
        };
        run.pictures.retain(|picture| !is_alarm(picture));
    }
    gallery.runs.retain(|run| !run.pictures.is_empty());
    gallery.alarms.reverse();
    gallery.runs.reverse();
    gallery
}

/// Reads a picture that a behaviour has saved; `None` if there is none of this name.
pub(super) fn picture(data: &Path, behaviour: &str, name: &str) -> Option<Vec<u8>> {
    validate_name(behaviour).ok()?;
    picture_name(name).filter(|clean| clean == name)?;
    let folder = Folder::open(&data.join(behaviour)).ok()?;
    let bytes = folder.read(name, MAX_PICTURE).ok()??;
    validate_markers(&bytes).ok().map(|_| bytes)
}

pub(super) fn starts(
    table: &Timetable,
    hold: &Hold,
    known: &[String],
    clock: Clock,
) -> Vec<ScheduledStart> {
    let words = |at: Timestamp| clock::describe(&table.zone.time(at));
    let starts = predict_starts(table, hold, known, clock.now(), STARTS);
    starts
        .into_iter()
        .map(|one| ScheduledStart {
            at: words(one.at),
            run: one.run,
            until: one.until.map(words),
            notes: one.reasons,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    const DAY: i64 = 24 * 60 * 60 * 1000;

    fn record(session: i64, at: i64, data: Value) -> Record {
        Record {
            at: Timestamp::from_millisecond(at).unwrap(),
            session,
            robot: None,
            data: data.as_object().unwrap().clone(),
        }
    }

    /// The plot of a day with these records; its end, and what runs then.
    fn plot(records: &[Record], until: i64, running: &[&str]) -> Vec<Part> {
        let mut plot = Plot::new(Timestamp::UNIX_EPOCH, 1);
        records.iter().for_each(|record| plot.add(record));
        let running: Vec<String> = running.iter().map(|name| (*name).to_owned()).collect();
        plot.end(Timestamp::from_millisecond(until).unwrap(), &running);
        plot.parts
    }

    fn minutes(parts: &[Part]) -> f64 {
        let minutes: f64 = parts.iter().map(|part| 5.0 * part.running).sum();
        (10.0 * minutes).round() / 10.0
    }

    #[test]
    fn dockings_and_alarms_are_counted_where_they_happened() {
        let dock = |at, end| record(1, at, json!({"event": "dock", "end": end}));
        let alarm = json!({"event": "safety", "action": "alarm"});
        let records = [
            dock(0, "done"),
            dock(PART_OF_A_DAY - 1, "base_not_found"),
            dock(PART_OF_A_DAY, "already_docked"),
            dock(PART_OF_A_DAY, "cancelled"),
            record(1, DAY - 1, alarm),
            dock(DAY, "done"),
            record(1, 5, json!({"event": "safety", "action": "go_home"})),
        ];
        let parts = plot(&records, DAY, &[]);
        assert_eq!(parts.len(), PARTS);
        assert_eq!((parts[0].docks, parts[0].failed_docks), (1, 1));
        assert_eq!((parts[1].docks, parts[1].failed_docks), (1, 0));
        assert_eq!((parts[PARTS - 1].alarms, parts[PARTS - 1].docks), (1, 0));
        let filled = parts.iter().filter(|part| !part.is_empty());
        assert_eq!(filled.count(), 3);
    }

    #[test]
    fn runs_count_from_their_start_to_their_end_even_if_it_was_not_recorded() {
        let minute = |minute: i64| minute * 60 * 1000;
        let started = |session, at| {
            record(
                session,
                at,
                json!({"event": "started", "behaviour": "patrol"}),
            )
        };
        let end = json!({"event": "ended", "behaviour": "patrol", "seconds": 720.0});
        let ended = record(1, minute(20), end);
        let whole = plot(&[started(1, minute(8)), ended.clone()], DAY, &[]);
        assert_eq!(minutes(&whole), 12.0);
        assert_eq!((whole[1].running, whole[2].running), (0.4, 1.0));
        assert_eq!(whole.iter().map(|part| part.runs).sum::<u32>(), 1);
        let began_before = plot(&[record(1, minute(2), ended.data.clone().into())], DAY, &[]);
        assert_eq!(minutes(&began_before), 2.0);
        let open = [started(1, minute(8))];
        assert_eq!(minutes(&plot(&open, minute(30), &["patrol"])), 22.0);
        assert_eq!(minutes(&plot(&open, minute(30), &[])), 0.0, "it was killed");
        let dock = record(1, minute(10), json!({"event": "dock", "end": "done"}));
        let killed = [started(1, minute(8)), dock, started(2, minute(50))];
        assert_eq!(minutes(&plot(&killed, minute(60), &["patrol"])), 12.0);
    }

    #[test]
    fn pictures_are_sorted_by_run_and_those_that_were_sent_come_first() {
        let started =
            |at, behaviour| record(1, at, json!({"event": "started", "behaviour": behaviour}));
        let saved = |at, behaviour, name| {
            let path = format!("/data/{behaviour}/{name}.jpg");
            record(
                1,
                at,
                json!({"event": "picture", "behaviour": behaviour, "path": path}),
            )
        };
        let told = record(
            1,
            21,
            json!({"event": "notify", "behaviour": "guard", "text": "something moves", "picture": "/data/guard/a.jpg"}),
        );
        let silent =
            json!({"event": "notify", "behaviour": "guard", "text": "hello", "picture": null});
        let gallery = gallery_of(&[
            saved(5, "guard", "old"),
            started(10, "patrol"),
            saved(11, "patrol", "1"),
            saved(12, "patrol", "2"),
            saved(20, "guard", "a"),
            told,
            record(1, 22, silent),
            started(30, "patrol"),
            saved(31, "patrol", "3"),
        ]);
        let alarm = &gallery.alarms[0];
        assert_eq!((gallery.alarms.len(), &*alarm.text), (1, "something moves"));
        let runs = gallery.runs.iter().map(|run| {
            let names = run.pictures.iter().map(|one| one.name.as_str());
            (&*run.behaviour, run.began, names.collect::<Vec<_>>())
        });
        let runs: Vec<_> = runs.collect();
        assert_eq!(
            runs,
            [
                ("patrol", 30, vec!["3.jpg"]),
                ("patrol", 10, vec!["1.jpg", "2.jpg"]),
                ("guard", 5, vec!["old.jpg"]),
            ]
        );
    }

    #[test]
    fn only_pictures_in_the_behaviours_own_folder_are_accessible() {
        let data = tempfile::tempdir().unwrap();
        let jpeg = include_bytes!("../../tests/fixtures/ball-422.jpg");
        std::fs::create_dir(data.path().join("patrol")).unwrap();
        std::fs::write(data.path().join("patrol/1.jpg"), jpeg).unwrap();
        std::fs::write(data.path().join("patrol/text.jpg"), "no picture").unwrap();
        std::fs::write(data.path().join("secret.jpg"), jpeg).unwrap();
        assert_eq!(
            picture(data.path(), "patrol", "1.jpg").as_deref(),
            Some(&jpeg[..])
        );
        for (behaviour, name) in [
            ("patrol", "../secret.jpg"),
            ("..", "secret.jpg"),
            (".", "secret.jpg"),
            ("", "secret.jpg"),
            ("patrol", "2.jpg"),
            ("patrol", "text.jpg"),
            ("patrol/..", "secret.jpg"),
        ] {
            assert_eq!(
                picture(data.path(), behaviour, name),
                None,
                "{behaviour} {name}"
            );
        }
    }
}
