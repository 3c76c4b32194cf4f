//! The behaviours of a run for the page, with the texts of their scripts.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::Instant;

use crate::agent::{BehaviourState, BehaviourStatus};
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
pub struct RunDefinition {
    /// Its scripts.
    pub scripts: Vec<Script>,
    /// Its timetable and the clock that it uses, if it has one.
    pub timetable: Option<(Timetable, Clock)>,
}

impl From<Vec<Script>> for RunDefinition {
    fn from(scripts: Vec<Script>) -> RunDefinition {
        RunDefinition {
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
    pub declared_params: Vec<DeclaredParam>,
    /// How it last ended.
    pub exit: Option<End>,
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

pub(super) fn behaviours(
    scripts: &[Script],
    statuses: &[BehaviourStatus],
    declared: &DeclaredParams,
    now: Instant,
) -> Vec<Behaviour> {
    let statuses = statuses.iter();
    let one = |behaviour_status: &BehaviourStatus| {
        let declared = declared.get(&behaviour_status.name).map(Vec::as_slice);
        behaviour(
            find(scripts, &behaviour_status.name),
            behaviour_status,
            declared.unwrap_or_default(),
            now,
        )
    };
    statuses.map(one).collect()
}

pub(super) fn find<'a>(scripts: &'a [Script], name: &str) -> Option<&'a Script> {
    scripts.iter().find(|script| script.name == name)
}

fn behaviour(
    script: Option<&Script>,
    behaviour_status: &BehaviourStatus,
    declared: &[DeclaredParam],
    now: Instant,
) -> Behaviour {
    let (state, running) = match behaviour_status.state {
        BehaviourState::Idle => ("idle", None),
        BehaviourState::Loading => ("loading", None),
        BehaviourState::Running { since, .. } => (
            "running",
            Some(now.saturating_duration_since(since).as_secs()),
        ),
        BehaviourState::Ending => ("ending", None),
    };
    let file = script.map(|script| script.file.display().to_string());
    let exit = behaviour_status.exit.as_ref().map(|exit| {
        let text = exit.message.clone();
        let text = text.unwrap_or_else(|| exit.reason.sentence().to_owned());
        let line = file.as_deref().and_then(|file| line_of(&text, file));
        End {
            reason: exit.reason.name(),
            text,
            line,
        }
    });
    Behaviour {
        name: behaviour_status.name.clone(),
        file,
        priority: behaviour_status.priority.0,
        state,
        running,
        params: script.map_or_else(Vec::new, |script| script.params.clone()),
        declared_params: declared.to_vec(),
        exit,
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
