//! What was and what will be: the journal's days, the pictures that behaviours kept, and the timetable.
//! Reading waits for the disk, so it is done on a thread of its own, a few at a time.

use std::path::Path;

use jiff::{SignedDuration, Timestamp};
use schemars::JsonSchema;
use serde::Serialize;

use crate::behaviour::validate_name;
use crate::clock::{self, Clock};
use crate::files::Folder;
use crate::journal::{History, JournalError, Kinds, Record, Span};
use crate::script::picture_name;
use crate::timetable::{Reason, Timetable, outlook};
use crate::vision::validate_markers;

/// Levels of the battery in one answer; more are thinned out.
const LEVELS: usize = 600;
/// Events in one answer: the newest.
const EVENTS: u32 = 200;
/// Starts that are foreseen.
const STARTS: usize = 6;
/// Bytes of a picture.
const MAX_PICTURE: u64 = 4 << 20;
/// What people want to see of the past.
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

/// The days that the journal remembers.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Past {
    /// From when, milliseconds since 1970.
    pub since: i64,
    /// Until when.
    pub until: i64,
    /// When, percent, charging; oldest first, thinned out.
    pub battery: Vec<(i64, f64, bool)>,
    /// What happened; oldest first, the newest so many.
    pub events: Vec<Happened>,
}

/// One thing that happened.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Happened {
    /// When, milliseconds since 1970.
    pub at: i64,
    /// `dock`, `undock`, `safety`, `given_up`, `start_missed`, `started`, `ended`, `picture` or `lost`.
    pub kind: String,
    /// Whose, if it is a behaviour's.
    pub behaviour: String,
    /// How it ended, what the watchdog did, or why.
    pub code: String,
    /// In words, perhaps none; of a picture its file's name.
    pub text: String,
}

/// One start to come.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub(super) struct Start {
    /// When, by the robot's own clock on the wall.
    pub at: String,
    /// The behaviour.
    pub run: String,
    /// When it is ended, if it has not ended by itself.
    pub until: Option<String>,
    /// `quiet`, `overlap` or `unknown`.
    pub notes: Vec<&'static str>,
}

/// The newest days, if there is a journal.
///
/// # Errors
/// It cannot be read.
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

/// Evenly, with the newest.
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

/// A picture that a behaviour has kept; `None` if there is none of this name.
pub(super) fn picture(data: &Path, behaviour: &str, name: &str) -> Option<Vec<u8>> {
    validate_name(behaviour).ok()?;
    picture_name(name).filter(|clean| clean == name)?;
    let folder = Folder::open(&data.join(behaviour)).ok()?;
    let bytes = folder.read(name, MAX_PICTURE).ok()??;
    validate_markers(&bytes).ok().map(|_| bytes)
}

/// What the timetable will do from now on.
pub(super) fn starts(table: &Timetable, known: &[String], clock: Clock) -> Vec<Start> {
    let words = |at: Timestamp| clock::words(&table.zone.time(at));
    let starts = outlook(table, known, clock.now(), STARTS);
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
    fn no_name_leads_out_of_a_behaviours_own_pictures() {
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
