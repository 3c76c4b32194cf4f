//! The behaviours that a scenario runs: loads their files for the agent.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::CallError;
use crate::agent::Behaviour;
use crate::behaviour::{Launch, Library, read_source};
use crate::check::{self, Diagnostic};
use crate::clock::Zone;
use crate::config::{Config, Entry};
use crate::script;

pub(super) struct Behaviours {
    pub(super) config: Config,
    /// Base folder of relative paths; without it only the subject can be run.
    pub(super) folder: Option<PathBuf>,
    /// The behaviour to run when none is named.
    pub(super) subject: Option<PathBuf>,
    /// The behaviours' data folder, which exists until the scenario is over.
    pub(super) data: PathBuf,
    pub(super) seed: u64,
    /// Origin of parameter values, for errors.
    pub(super) origin: String,
}

impl Behaviours {
    pub(super) fn load(&self, named: &[Value]) -> Result<Vec<Behaviour>, CallError> {
        let mut entries = named
            .iter()
            .filter(|value| !value.is_null())
            .map(|value| self.entry(value))
            .collect::<Result<Vec<Entry>, CallError>>()?;
        if entries.is_empty() {
            let subject = self.subject.clone();
            let subject = subject.ok_or(CallError::NoSubject)?;
            entries.push(Entry::new(subject));
        }
        let mut names = Vec::new();
        for entry in &entries {
            let name = entry.name()?;
            names.push(name.clone());
            if names[..names.len() - 1].contains(&name) {
                return Err(CallError::DuplicateBehaviour(name));
            }
        }
        let seeds = self.seed..;
        let behaviours = entries.iter().zip(seeds);
        behaviours
            .map(|(entry, seed)| self.behaviour(entry, seed))
            .collect()
    }

    fn entry(&self, value: &Value) -> Result<Entry, CallError> {
        let mut entry = match value {
            Value::String(path) => Entry::new(PathBuf::from(path)),
            Value::Object(_) => serde_json::from_value(value.clone())?,
            _ => return Err(CallError::Kind),
        };
        let folder = self.folder.as_ref();
        let folder = folder.ok_or(CallError::NoFolder)?;
        entry.file = folder.join(&entry.file);
        Ok(entry)
    }

    /// Returns the time zone: the configured one or UTC, independent of the computer.
    pub(super) fn zone(&self) -> Zone {
        self.config.time_zone.clone().unwrap_or_else(Zone::utc)
    }

    fn behaviour(&self, entry: &Entry, seed: u64) -> Result<Behaviour, CallError> {
        let file = &entry.file;
        let named = is_script(file) && file.canonicalize().map_or(true, |file| is_script(&file));
        if !named {
            return Err(CallError::NoScript(file.clone()));
        }
        let source = read_source(file).map_err(|source| match source.kind() {
            ErrorKind::NotFound => CallError::NoFile(file.clone()),
            _ => CallError::Read {
                path: file.clone(),
                source,
            },
        })?;
        let name = entry.name()?;
        let chunk = file.display().to_string();
        let options = script::Options {
            params: entry.given(&self.origin),
            data_dir: Some(self.data.join(&name)),
            time_zone: self.zone().name().to_owned(),
            ..self.config.script(name, chunk, seed)
        };
        reject_errors(&source, &options)?;
        Ok(Behaviour {
            priority: entry.priority,
            launch: Launch {
                source,
                options,
                library: Library::beside(file),
            },
            checked: false,
            restart: entry.restart,
            reloads: None,
        })
    }
}

/// Whether the file name is that of a script. Error messages quote the content, so no other files
/// may be read.
fn is_script(file: &Path) -> bool {
    file.extension()
        .is_some_and(|ending| ending == "lua" || ending == "luau")
}

/// Rejects a behaviour if the checks that precede every run find errors in it.
fn reject_errors(source: &[u8], options: &script::Options) -> Result<(), CallError> {
    let errors = check::errors(source, options);
    let errors: Vec<String> = errors.iter().map(Diagnostic::text).collect();
    if errors.is_empty() {
        Ok(())
    } else {
        Err(CallError::Mistakes(errors.join("\n\n")))
    }
}
