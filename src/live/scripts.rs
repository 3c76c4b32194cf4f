//! The behaviours of a run for the page, with the texts of their scripts.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::Instant;

use crate::agent::{Member, MemberState};
use crate::clock::Clock;
use crate::files;
use crate::robot::{DeclaredParam, DeclaredParams};
use crate::timetable::Timetable;

/// Maximum length of a script that is shown, in bytes.
const MAX_LEN: u64 = 256 * 1024;

/// A script of the run.
#[derive(Debug, Clone)]
pub struct Script {
    /// The behaviour's name.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// Its text at the start of the behaviour.
    pub source: String,
    /// The given values of its parameters.
    pub params: Vec<(String, String)>,
}

/// Further information about a run, which may change.
#[derive(Debug, Clone, Default)]
pub struct Known {
    /// Its scripts.
    pub scripts: Vec<Script>,
    /// Its timetable and the clock that it uses, if it has one.
    pub timetable: Option<(Timetable, Clock)>,
}

impl From<Vec<Script>> for Known {
    fn from(scripts: Vec<Script>) -> Known {
        Known {
            scripts,
            timetable: None,
        }
    }
}

/// A behaviour.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Behaviour {
    /// Its name.
    pub name: String,
    /// Its script's file, if known.
    pub file: Option<String>,
    /// Its priority when several behaviours want to drive.
    pub priority: i16,
    /// `idle`, `loading`, `running` or `ending`.
    pub state: &'static str,
    /// How long it has been running, in seconds.
    pub running: Option<u64>,
    /// The given values of its parameters.
    pub params: Vec<(String, String)>,
    /// The parameters that it has declared, while it is running.
    pub knobs: Vec<DeclaredParam>,
    /// How it last ended.
    pub ending: Option<End>,
}

/// How a behaviour ended.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct End {
    /// `done`, `error`, `cpu`, `memory`, `cancelled`, `safety`, `reload` or `shutdown`.
    pub reason: &'static str,
    /// The reason in words.
    pub text: String,
    /// The line of its script, if the text names one.
    pub line: Option<u64>,
}

/// A script's text.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Text {
    /// The behaviour's name.
    pub name: String,
    /// Its file.
    pub file: String,
    /// Its text.
    pub text: String,
    /// Whether the file has changed since the behaviour was started, so that line numbers may
    /// differ.
    pub changed: bool,
}

/// Returns all behaviours that are known or running.
pub(super) fn behaviours(
    scripts: &[Script],
    members: &[Member],
    declared: &DeclaredParams,
    now: Instant,
) -> Vec<Behaviour> {
    let members = members.iter();
    let one = |member: &Member| {
        let declared = declared.get(&member.name).map(Vec::as_slice);
        behaviour(
            find(scripts, &member.name),
            member,
            declared.unwrap_or_default(),
            now,
        )
    };
    members.map(one).collect()
}

pub(super) fn find<'a>(scripts: &'a [Script], name: &str) -> Option<&'a Script> {
    scripts.iter().find(|script| script.name == name)
}

fn behaviour(
    script: Option<&Script>,
    member: &Member,
    declared: &[DeclaredParam],
    now: Instant,
) -> Behaviour {
    let (state, running) = match member.state {
        MemberState::Idle => ("idle", None),
        MemberState::Loading => ("loading", None),
        MemberState::Running { since, .. } => (
            "running",
            Some(now.saturating_duration_since(since).as_secs()),
        ),
        MemberState::Ending => ("ending", None),
    };
    let file = script.map(|script| script.file.display().to_string());
    let ending = member.ending.as_ref().map(|ending| {
        let text = ending.message.clone();
        let text = text.unwrap_or_else(|| ending.reason.sentence().to_owned());
        let line = file.as_deref().and_then(|file| line_of(&text, file));
        End {
            reason: ending.reason.name(),
            text,
            line,
        }
    });
    Behaviour {
        name: member.name.clone(),
        file,
        priority: member.priority.0,
        state,
        running,
        params: script.map_or_else(Vec::new, |script| script.params.clone()),
        knobs: declared.to_vec(),
        ending,
    }
}

/// Returns the line number in a text such as `FILE:12: ...`.
fn line_of(text: &str, file: &str) -> Option<u64> {
    let rest = text.split_once(file)?.1.strip_prefix(':')?;
    let digits: String = rest.chars().take_while(char::is_ascii_digit).collect();
    digits.parse().ok()
}

/// Returns the current text of the file, or the text at the start if the file cannot be read.
/// Blocks on the disk.
pub(super) fn text(script: &Script) -> Text {
    let now = read(&script.file);
    let changed = now.as_ref().is_some_and(|now| *now != script.source);
    Text {
        name: script.name.clone(),
        file: script.file.display().to_string(),
        text: now.unwrap_or_else(|| script.source.clone()),
        changed,
    }
}

fn read(path: &Path) -> Option<String> {
    files::read_text(path, MAX_LEN).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_of_an_error_is_found() {
        let text = "a/b.lua:12: attempt to index nil";
        assert_eq!(line_of(text, "a/b.lua"), Some(12));
        assert_eq!(line_of(text, "c.lua"), None);
        assert_eq!(line_of("a/b.lua: unreadable", "a/b.lua"), None);
    }
}
