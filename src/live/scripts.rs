//! The behaviours of a run as people at the page see them, with the texts of their scripts.

use std::path::{Path, PathBuf};

use schemars::JsonSchema;
use serde::Serialize;

use crate::files;
use crate::robot::channel::Aboard;

/// Bytes of a script that are shown.
const MAX_LEN: u64 = 256 * 1024;

/// A script of the run.
#[derive(Debug, Clone)]
pub struct Script {
    /// The behaviour's name.
    pub name: String,
    /// Its file.
    pub file: PathBuf,
    /// Its text when it was started.
    pub source: String,
}

/// A behaviour.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Behaviour {
    /// Its name.
    pub name: String,
    /// Its script's file.
    pub file: String,
    /// Who wins when several want to drive.
    pub priority: Option<i16>,
    /// It runs now.
    pub running: bool,
}

/// A script's text.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Text {
    /// The behaviour's name.
    pub name: String,
    /// Its file.
    pub file: String,
    /// Its text.
    pub text: String,
    /// The file has changed since the behaviour was started: lines may be elsewhere.
    pub changed: bool,
}

/// All behaviours: those of the run, and whoever else is aboard.
pub(super) fn behaviours(scripts: &[Script], aboard: &[Aboard]) -> Vec<Behaviour> {
    let on_board = |name: &str| aboard.iter().find(|one| one.name == name);
    let known = scripts.iter().map(|script| Behaviour {
        name: script.name.clone(),
        file: script.file.display().to_string(),
        priority: on_board(&script.name).map(|one| one.priority.0),
        running: on_board(&script.name).is_some(),
    });
    let others = aboard.iter().filter(|one| scripts.iter().all(|script| script.name != one.name));
    let others = others.map(|one| Behaviour {
        name: one.name.clone(),
        file: String::new(),
        priority: Some(one.priority.0),
        running: true,
    });
    known.chain(others).collect()
}

/// The text as it is in its file now, or else as it was started. Waits for the disk.
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
