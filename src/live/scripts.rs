//! The behaviours of a run for the page, with the texts of their scripts.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::Serialize;
use tokio::time::Instant;

use crate::agent::BehaviourStatus;
use crate::clock::Clock;
use crate::control::BehaviourListing;
use crate::files;
use crate::robot::DeclaredParam;
use crate::timetable::Timetable;

/// Maximum length of a script that is shown, in bytes.
const MAX_LEN: u64 = 256 * 1024;

#[derive(Debug, Clone)]
pub struct Script {
    /// The behaviour's name.
    pub name: String,
    pub file: PathBuf,
    /// Its text at the start of the behaviour.
    pub source: String,
    /// The given values of its parameters.
    pub params: Vec<(String, String)>,
}

/// Further information about a run, which may change.
#[derive(Debug, Clone, Default)]
pub struct RunDefinition {
    pub scripts: Vec<Script>,
    /// Its timetable and the clock that it uses, if it has one.
    pub timetable: Option<(Timetable, Clock)>,
}

/// A behaviour for the page.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(super) struct Behaviour {
    /// Its state.
    #[serde(flatten)]
    pub listing: BehaviourListing,
    /// The path of its script.
    pub file: Option<String>,
    /// The parameters of its config or command line, as texts.
    pub params: Vec<(String, String)>,
    /// The parameters that it has declared as live.
    pub declared_params: Vec<DeclaredParam>,
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

pub(super) fn find<'a>(scripts: &'a [Script], name: &str) -> Option<&'a Script> {
    scripts.iter().find(|script| script.name == name)
}

impl Behaviour {
    pub(super) fn new(
        script: Option<&Script>,
        status: &BehaviourStatus,
        declared_params: Vec<DeclaredParam>,
        now: Instant,
    ) -> Behaviour {
        let file = script.map(|script| script.file.display().to_string());
        let mut listing = BehaviourListing::new(status, now);
        if let (Some(exit), Some(file)) = (&mut listing.exit, &file) {
            exit.line = line_of(&exit.text, file);
        }
        Behaviour {
            listing,
            file,
            params: script.map_or_else(Vec::new, |script| script.params.clone()),
            declared_params,
        }
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
    let now = files::read_text(&script.file, MAX_LEN).ok();
    let changed = now.as_ref().is_some_and(|now| *now != script.source);
    Text {
        name: script.name.clone(),
        file: script.file.display().to_string(),
        text: now.unwrap_or_else(|| script.source.clone()),
        changed,
    }
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
