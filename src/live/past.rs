//! Past and future: the journal, the pictures that behaviours saved, and the timetable. Reading
//! blocks on the disk, so it runs on separate threads, a few at a time.

use std::path::Path;

use jiff::{SignedDuration, Timestamp};
use schemars::JsonSchema;
use serde::Serialize;

use crate::behaviour::validate_name;
use crate::clock::{self, Clock};
use crate::files::Folder;
use crate::journal::{History, JournalError, Kinds, Record, Span};
use crate::script::picture_name;
use crate::timetable::{Reason, Timetable, predict_starts};
use crate::vision::validate_markers;

/// Maximum number of battery levels in one response; more are thinned out.
const LEVELS: usize = 600;
/// Maximum number of events in one response: the newest.
const EVENTS: u32 = 200;
/// Number of future starts shown.
const STARTS: usize = 6;
/// Maximum size of a picture, in bytes.
const MAX_PICTURE: u64 = 4 << 20;
/// The kinds of events shown.
const KINDS: Kinds = Kinds::Of(&[
    "dock",
    "undock",
    "safety",
    "given_up",
    "start_missed",
    "started",
    "ended",
    "picture",
    "lost",
]);

/// The history of some days.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Past {
    /// Start of the period, in milliseconds since 1970.
    pub since: i64,
    /// End of the period, in milliseconds since 1970.
    pub until: i64,
    /// Time, percent, charging; oldest first, thinned out.
    pub battery: Vec<(i64, f64, bool)>,
    /// The newest events, up to a maximum; oldest first.
    pub events: Vec<Happened>,
}

/// One event.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Happened {
    /// The time, in milliseconds since 1970.
    pub at: i64,
    /// `dock`, `undock`, `safety`, `given_up`, `start_missed`, `started`, `ended`, `picture`, or
    /// `lost`.
    pub kind: String,
    /// The behaviour, if it is an event of one.
    pub behaviour: String,
    /// The result, the action of the watchdog, or the reason.
    pub code: String,
    /// A text, possibly empty; for a picture, its file name.
    pub text: String,
}

/// One future start.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Start {
    /// The local time in the timetable's time zone.
    pub at: String,
    /// The behaviour.
    pub run: String,
    /// When it is ended, if it has not ended on its own.
    pub until: Option<String>,
    /// `quiet`, `overlap` or `unknown`.
    pub notes: Vec<&'static str>,
}

/// Returns the history of the last days, if there is a journal.
///
/// # Errors
/// If the journal cannot be read.
pub(super) fn past(data: &Path, days: u8) -> Result<Option<Past>, JournalError> {
    let Some(history) = History::open(data)? else {
        return Ok(None);
    };
    let until = Timestamp::now();
    let since = until.saturating_sub(SignedDuration::from_hours(24 * i64::from(days)));
    let since = since.unwrap_or(Timestamp::UNIX_EPOCH);
    let span = Span {
        since: Some(since),
        ..Span::default()
    };
    let newest = Span {
        newest: Some(EVENTS),
        ..span.clone()
    };
    let battery = history.battery(&span)?;
    let events = history.records(&KINDS, &newest)?;
    Ok(Some(Past {
        since: since.as_millisecond(),
        until: until.as_millisecond(),
        battery: thin(&battery),
        events: events.iter().map(happened).collect(),
    }))
}

/// Thins out the levels evenly, keeping the newest.
fn thin(levels: &[Record]) -> Vec<(i64, f64, bool)> {
    let step = levels.len().div_ceil(LEVELS).max(1);
    let kept = levels.iter().rev().step_by(step);
    let mut kept: Vec<_> = kept
        .map(|level| {
            let percent = level.number("percent").unwrap_or_default();
            (level.at.as_millisecond(), percent, level.is("charging"))
        })
        .collect();
    kept.reverse();
    kept
}

fn happened(record: &Record) -> Happened {
    let first = |keys: &[&str]| {
        let texts = keys.iter().map(|key| record.text(key));
        texts.into_iter().find(|text| !text.is_empty())
    };
    let code = first(&["end", "action", "reason"]).unwrap_or_default();
    let name = |path: &str| {
        let name = Path::new(path).file_name();
        name.map(|name| name.to_string_lossy().into_owned())
    };
    let text = match record.kind() {
        "picture" => name(record.text("path")).unwrap_or_default(),
        _ => record.text("message").to_owned(),
    };
    Happened {
        at: record.at.as_millisecond(),
        kind: record.kind().to_owned(),
        behaviour: record.text("behaviour").to_owned(),
        code: code.to_owned(),
        text,
    }
}

/// Reads a picture that a behaviour has saved; `None` if there is none of this name.
pub(super) fn picture(data: &Path, behaviour: &str, name: &str) -> Option<Vec<u8>> {
    validate_name(behaviour).ok()?;
    picture_name(name).filter(|clean| clean == name)?;
    let folder = Folder::open(&data.join(behaviour)).ok()?;
    let bytes = folder.read(name, MAX_PICTURE).ok()??;
    validate_markers(&bytes).ok().map(|_| bytes)
}

/// Returns the next starts of the timetable.
pub(super) fn starts(table: &Timetable, known: &[String], clock: Clock) -> Vec<Start> {
    let words = |at: Timestamp| clock::words(&table.zone.time(at));
    let starts = predict_starts(table, known, clock.now(), STARTS);
    starts
        .into_iter()
        .map(|one| Start {
            at: words(one.at),
            run: one.run,
            until: one.until.map(words),
            notes: one.reasons.iter().map(|reason| note(*reason)).collect(),
        })
        .collect()
}

fn note(reason: Reason) -> &'static str {
    match reason {
        Reason::Quiet => "quiet",
        Reason::Overlap => "overlap",
        Reason::Unknown => "unknown",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
