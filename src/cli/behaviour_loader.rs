//! The behaviours that a command runs, from files and the config's entries, each with a spec
//! from which it can be started again while the agent runs.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};

use tokio::sync::mpsc;

use super::Failure;
use crate::agent::{Behaviour, BehaviourSpec, RosterError};
use crate::behaviour::{self, Launch, Library, RestartPolicy, ScriptWatcher};
use crate::clock::{Clock, Zone};
use crate::config::{Config, Entry};
use crate::script::{self, GivenParam, ParamOrigin, ParamValue};
use crate::yaml::suggestion;

/// A watched behaviour file and the channel for its reloads.
pub(super) type Watch = (ScriptWatcher, mpsc::Sender<Vec<u8>>);

pub(super) struct BehaviourLoader<'a> {
    pub(super) config: &'a Config,
    /// The config's file, for messages.
    pub(super) file: Option<&'a Path>,
    pub(super) params: &'a [Param],
    /// Folder for marked copies of the frames that the behaviours look at.
    pub(super) annotate: Option<&'a Path>,
    pub(super) restart: Option<RestartPolicy>,
    pub(super) checked: bool,
    /// Whether each behaviour is reloaded when its file is saved.
    pub(super) watch: bool,
    /// Seed of the first behaviour; each following one gets the next number.
    pub(super) seed: u64,
    /// The clock from which scripts get the time of day.
    pub(super) clock: Clock,
    /// The time zone of that clock.
    pub(super) zone: Zone,
}

pub(super) struct LoadedBehaviours {
    pub(super) behaviours: Vec<Behaviour>,
    pub(super) specs: Vec<BehaviourSpec>,
    pub(super) watches: Vec<Watch>,
}

impl BehaviourLoader<'_> {
    pub(super) fn load(&self, entries: &[Entry]) -> Result<LoadedBehaviours, Failure> {
        let mut names = Vec::new();
        let mut watches = Vec::new();
        let mut behaviours = Vec::new();
        for (entry, seed) in entries.iter().zip(self.seed..) {
            // Before the file is read, so that no save is missed.
            let watched = self.watch.then(|| ScriptWatcher::new(entry.file.clone()));
            let mut behaviour = self.behaviour(entry, seed, &mut names)?;
            if let Some(watched) = watched {
                let (reloads, received) = mpsc::channel(1);
                behaviour.reloads = Some(received);
                let watched = watched.with_modules(behaviour.launch.library.clone());
                watches.push((watched, reloads));
            }
            behaviours.push(behaviour);
        }
        // Overrides values from the config. Of two values for one name the last is used.
        for param in self.params {
            let of = owner(param, &behaviours)?;
            let given = GivenParam {
                value: ParamValue::Text(param.value.clone()),
                origin: ParamOrigin::CommandLine,
            };
            let params = &mut behaviours[of].launch.options.params;
            params.insert(param.name.clone(), given);
        }
        let specs = behaviours.iter().zip(entries);
        let specs = specs
            .map(|(behaviour, entry)| spec(behaviour, entry.file.clone(), self.checked))
            .collect();
        Ok(LoadedBehaviours {
            behaviours,
            specs,
            watches,
        })
    }

    fn behaviour(
        &self,
        entry: &Entry,
        seed: u64,
        names: &mut Vec<String>,
    ) -> Result<Behaviour, Failure> {
        let source = read_source(&entry.file)?;
        let name = unique(entry.name().map_err(Failure::usage)?, names);
        let data = self.config.data_folder().join(&name);
        let data = std::path::absolute(data).map_err(Failure::internal)?;
        let options = script::Options {
            params: params(entry, self.file),
            annotate_dir: marked_folder(self.annotate, &name, &data)?,
            data_dir: Some(data),
            clock: self.clock.offset_millis(),
            time_zone: self.zone.name().to_owned(),
            ..self
                .config
                .script(name, entry.file.display().to_string(), seed)
        };
        Ok(Behaviour {
            priority: entry.priority,
            launch: Launch {
                source,
                options,
                library: Library::beside(&entry.file),
            },
            restart: self.restart.unwrap_or(entry.restart),
            checked: self.watch && self.checked,
            reloads: None,
        })
    }
}

/// The same behaviour with its file read again at each start.
fn spec(behaviour: &Behaviour, file: PathBuf, checked: bool) -> BehaviourSpec {
    let name = behaviour.launch.options.name.clone();
    let first = Behaviour {
        checked,
        ..behaviour.again()
    };
    BehaviourSpec::new(name, first.priority, move || {
        let mut again = first.again();
        again.launch.source = behaviour::read_source(&file).map_err(|error| {
            RosterError::CannotLoad(format!("cannot read {}: {error}", file.display()))
        })?;
        Ok(again)
    })
}

pub(super) fn params(entry: &Entry, config: Option<&Path>) -> BTreeMap<String, GivenParam> {
    entry.given(&config.map_or_else(String::new, |config| config.display().to_string()))
}

/// The private folder for a behaviour's marked frames. It is created here so that an error is
/// reported before the robot moves.
fn marked_folder(
    annotate: Option<&Path>,
    name: &str,
    data: &Path,
) -> Result<Option<PathBuf>, Failure> {
    let Some(folder) = annotate else {
        return Ok(None);
    };
    let folder = std::path::absolute(folder.join(name)).map_err(Failure::internal)?;
    let refused = |why: &dyn Display| {
        let what = format_args!(
            "--annotate cannot keep frames in {}: {why}",
            folder.display()
        );
        Failure::usage(what).help("name a folder that is only for marked frames")
    };
    if folder == data {
        return Err(refused(&"the behaviour's own pictures are there"));
    }
    let made = DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(&folder);
    made.map_err(|error| refused(&error))?;
    Ok(Some(folder))
}

/// Makes the name unique: two behaviours of one name would share a data folder.
fn unique(name: String, names: &mut Vec<String>) -> String {
    let mut candidate = name.clone();
    for number in 2.. {
        if !names.contains(&candidate) {
            break;
        }
        candidate = format!("{name}-{number}");
    }
    names.push(candidate.clone());
    candidate
}

/// Reads a script; the error has help for the user.
pub(super) fn read_source(path: &Path) -> Result<Vec<u8>, Failure> {
    behaviour::read_source(path).map_err(|error| {
        Failure::unreadable_file("the behaviour", path, error)
            .help("ready-made behaviours are in behaviours/")
    })
}

/// `--param NAME=VALUE`: a value for a parameter that a script declares with `params.declare`,
/// optionally of one of several behaviours. Name and value are validated against the declaration
/// when the script runs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Param {
    behaviour: Option<String>,
    name: String,
    value: String,
}

impl Param {
    /// Parses `NAME=VALUE` or `BEHAVIOUR.NAME=VALUE`.
    pub(super) fn parse(text: &str) -> Result<Param, &'static str> {
        const EXPECTED: &str = "expected NAME=VALUE, such as speed=50, or BEHAVIOUR.NAME=VALUE";
        let (key, value) = text.split_once('=').ok_or(EXPECTED)?;
        let (behaviour, name) = match key.rsplit_once('.') {
            Some((behaviour, name)) => (Some(behaviour), name),
            None => (None, key),
        };
        if name.is_empty() || behaviour == Some("") {
            return Err(EXPECTED);
        }
        Ok(Param {
            behaviour: behaviour.map(str::to_owned),
            name: name.to_owned(),
            value: value.to_owned(),
        })
    }
}

/// The index of the behaviour that a value is for.
fn owner(param: &Param, behaviours: &[Behaviour]) -> Result<usize, Failure> {
    let names = || {
        behaviours
            .iter()
            .map(|one| one.launch.options.name.as_str())
    };
    let known = || names().collect::<Vec<_>>().join(", ");
    let Param {
        behaviour,
        name,
        value,
    } = param;
    match behaviour {
        None if behaviours.len() == 1 => Ok(0),
        None => {
            let what = format!("--param {name}={value}: for which behaviour?");
            let first = names().next().unwrap_or_default();
            let help = format!(
                "write --param {first}.{name}={value} (behaviours: {})",
                known()
            );
            Err(Failure::usage(what).help(help))
        }
        Some(wanted) => names().position(|name| name == wanted).ok_or_else(|| {
            let near = suggestion(wanted, names());
            let what =
                format!("--param {wanted}.{name}={value}: there is no behaviour '{wanted}'{near}");
            Failure::usage(what).help(format!("behaviours: {}", known()))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_may_contain_anything_and_behaviour_names_may_contain_dots() {
        let parsed = |text: &str| {
            let Param {
                behaviour,
                name,
                value,
            } = Param::parse(text).unwrap();
            (behaviour.unwrap_or_default(), name, value)
        };
        let texts = |a: &str, b: &str, c: &str| (a.to_owned(), b.to_owned(), c.to_owned());
        assert_eq!(parsed("speed=50"), texts("", "speed", "50"));
        assert_eq!(parsed("say=a=b.c"), texts("", "say", "a=b.c"));
        assert_eq!(parsed("patrol.v2.speed="), texts("patrol.v2", "speed", ""));
        for wrong in ["speed", "=5", ".speed=5", "patrol.=5"] {
            assert!(Param::parse(wrong).is_err(), "{wrong}");
        }
    }
}
