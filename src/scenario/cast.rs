//! The behaviours that a scenario runs: from their files to what an agent takes.

use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::agent::Behaviour;
use crate::behaviour::{Launch, Library, read_source};
use crate::check::{self, Finding};
use crate::clock::Zone;
use crate::config::{Config, Entry};
use crate::script;

/// Makes behaviours.
pub(super) struct Cast {
    pub(super) config: Config,
    /// Paths are relative to it; without it only the subject can be run.
    pub(super) folder: Option<PathBuf>,
    /// What is run when none is named.
    pub(super) subject: Option<PathBuf>,
    /// What behaviours keep, until the scenario is over.
    pub(super) data: PathBuf,
    pub(super) seed: u64,
    /// What errors say of where values came from.
    pub(super) origin: String,
}

impl Cast {
    /// Those that a call names, or the subject.
    pub(super) fn behaviours(&self, named: &[Value]) -> Result<Vec<Behaviour>, String> {
        let mut entries = named
            .iter()
            .filter(|value| !value.is_null())
            .map(|value| self.entry(value))
            .collect::<Result<Vec<Entry>, String>>()?;
        if entries.is_empty() {
            let subject = self.subject.clone();
            let subject = subject.ok_or("name a behaviour, such as sim:run(\"patrol.lua\")")?;
            entries.push(Entry::of(subject));
        }
        let mut names = Vec::new();
        for entry in &entries {
            let name = entry.name().map_err(|error| error.to_string())?;
            names.push(name.clone());
            if names[..names.len() - 1].contains(&name) {
                return Err(format!(
                    "two behaviours are called '{name}': give one of them another name"
                ));
            }
        }
        let seeds = self.seed..;
        let behaviours = entries.iter().zip(seeds);
        behaviours
            .map(|(entry, seed)| self.behaviour(entry, seed))
            .collect()
    }

    fn entry(&self, value: &Value) -> Result<Entry, String> {
        let mut entry = match value {
            Value::String(path) => Entry::of(PathBuf::from(path)),
            Value::Object(_) => {
                serde_json::from_value(value.clone()).map_err(|error| error.to_string())?
            }
            _ => {
                let what = "a behaviour must be a file or a table such as { file = \"patrol.lua\", \
                            params = { speed = 50 } }";
                return Err(what.to_owned());
            }
        };
        let folder = self.folder.as_ref();
        let folder = folder.ok_or("no behaviour can be named here: sim:run() runs the one")?;
        entry.file = folder.join(&entry.file);
        Ok(entry)
    }

    /// Whose clock counts: the same on every computer.
    pub(super) fn zone(&self) -> Zone {
        self.config.time_zone.clone().unwrap_or_else(Zone::utc)
    }

    fn behaviour(&self, entry: &Entry, seed: u64) -> Result<Behaviour, String> {
        let file = &entry.file;
        let named = is_script(file) && file.canonicalize().map_or(true, |file| is_script(&file));
        if !named {
            return Err(format!(
                "{} is no behaviour: its name must end in .lua",
                file.display()
            ));
        }
        let source = read_source(file)
            .map_err(|error| format!("cannot read the behaviour {}: {error}", file.display()))?;
        let name = entry.name().map_err(|error| error.to_string())?;
        let chunk = file.display().to_string();
        let options = script::Options {
            params: entry.given(&self.origin),
            data_dir: Some(self.data.join(&name)),
            time_zone: self.zone().name().to_owned(),
            ..self.config.script(name, chunk, seed)
        };
        refuse_mistakes(&source, &options)?;
        let folder = file.parent().unwrap_or(Path::new(""));
        Ok(Behaviour {
            priority: entry.priority,
            launch: Launch {
                source,
                options,
                library: Library::new(folder.to_owned()),
            },
            checked: false,
            restart: entry.restart,
            reloads: None,
        })
    }
}

/// By its name. Messages tell what is wrong in a script and where: nothing else is looked into.
fn is_script(file: &Path) -> bool {
    file.extension()
        .is_some_and(|ending| ending == "lua" || ending == "luau")
}

/// As before every run.
fn refuse_mistakes(source: &[u8], options: &script::Options) -> Result<(), String> {
    let errors = check::errors(source, options);
    let errors: Vec<String> = errors.iter().map(Finding::text).collect();
    if errors.is_empty() {
        Ok(())
    } else {
        Err(format!(
            "the behaviour cannot work:\n{}",
            errors.join("\n\n")
        ))
    }
}
