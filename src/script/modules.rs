//! The modules that `require` has loaded or is loading: names, states, and which module waits for
//! which. This module reads no files: the agent does, and only in the folder of the behaviour.

use mlua::prelude::LuaFunction;
use serde::{Deserialize, Serialize};

use super::task::{ModuleId, TaskId};
use crate::yaml::suggestion;

const LONGEST: usize = 200;
/// Largest number of modules of one script, whether they were found or not.
const MAX_MODULES: usize = 128;
/// Largest total size of the modules' sources, in bytes.
const MAX_BYTES: usize = 1 << 20;
const LIBRARY: &str = "@spykee/";

/// The built-in modules, written in Lua. Each begins with a comment on its purpose and use.
pub(super) const BUILT_IN: [(&str, &str); 9] = [
    ("@spykee/bt", include_str!("stdlib/bt.luau")),
    ("@spykee/compass", include_str!("stdlib/compass.luau")),
    ("@spykee/easy", include_str!("stdlib/easy.luau")),
    ("@spykee/floor", include_str!("stdlib/floor.luau")),
    ("@spykee/fsm", include_str!("stdlib/fsm.luau")),
    ("@spykee/map", include_str!("stdlib/map.luau")),
    ("@spykee/pid", include_str!("stdlib/pid.luau")),
    ("@spykee/station", include_str!("stdlib/station.luau")),
    (
        "@spykee/whereabouts",
        include_str!("stdlib/whereabouts.luau"),
    ),
];

/// The names of the built-in modules, without `@spykee/`.
pub fn module_names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| &name[LIBRARY.len()..])
}

/// The built-in rescue behaviour, a whole script. The watchdog grants it the tracks when a robot
/// with a low battery does not find its station.
pub const RESCUE: &str = include_str!("stdlib/rescue.luau");

/// The path of a module's file within the behaviour's folder, without its extension, such as
/// `lib/pid`. It cannot name anything outside the folder.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ModuleName(String);

impl ModuleName {
    pub fn segments(&self) -> impl DoubleEndedIterator<Item = &str> {
        self.0.split('/')
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl From<ModuleName> for String {
    fn from(name: ModuleName) -> String {
        name.0
    }
}

impl TryFrom<String> for ModuleName {
    type Error = &'static str;

    fn try_from(name: String) -> Result<ModuleName, &'static str> {
        let plain = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-' | '.' | ' ');
        let is_segment =
            |one: &str| !one.is_empty() && !one.starts_with('.') && one.chars().all(plain);
        if name.len() <= LONGEST && name.split('/').all(is_segment) {
            Ok(ModuleName(name))
        } else {
            Err("not a module's name")
        }
    }
}

/// Why a module cannot be loaded, as a message for the script's author.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[error("{0}")]
pub struct NoModule(pub String);

#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ModuleFile {
    pub file: String,
    /// The content, not checked yet.
    pub source: Vec<u8>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Target {
    Library(&'static str, &'static str),
    File(ModuleName),
}

/// Resolves a path in a file of this folder, which is relative to the behaviour's folder. The error
/// is for the script's author, like those of [`Modules`].
pub(crate) fn resolve(folder: &str, path: &str) -> Result<Target, String> {
    if path.len() > LONGEST {
        return Err(format!("the path is too long: at most {LONGEST} bytes"));
    }
    if path.starts_with('@') {
        return library(path);
    }
    if !path.starts_with("./") && !path.starts_with("../") {
        let near = names()
            .find(|name| name.strip_prefix("@spykee/") == Some(path))
            .map_or_else(String::new, |name| format!("; did you mean '{name}'?"));
        let known = known_names();
        return Err(format!(
            "there is no module '{path}'{near} (a path begins with ./ or ../, such as \
             require(\"./lib/pid\"), or is one of {known})"
        ));
    }
    let mut segments: Vec<&str> = folder.split('/').filter(|one| !one.is_empty()).collect();
    for segment in path.split('/') {
        match segment {
            "." => {}
            ".." if segments.pop().is_none() => {
                return Err(format!(
                    "'{path}' leaves the behaviour's folder; modules must be in it"
                ));
            }
            ".." => {}
            segment => segments.push(segment),
        }
    }
    let name = segments.join("/");
    let name = [".luau", ".lua"]
        .iter()
        .find_map(|ending| name.strip_suffix(ending))
        .unwrap_or(&name);
    let refused = |_| format!("'{path}' is not a path to a module; use letters, digits, _ and -");
    Ok(Target::File(name.to_owned().try_into().map_err(refused)?))
}

fn names() -> impl Iterator<Item = &'static str> {
    BUILT_IN.iter().map(|(name, _)| *name)
}

fn known_names() -> String {
    names().collect::<Vec<_>>().join(", ")
}

fn library(path: &str) -> Result<Target, String> {
    let found = BUILT_IN.iter().find(|(name, _)| *name == path);
    found
        .map(|(name, source)| Target::Library(name, source))
        .ok_or_else(|| {
            let near = suggestion(path, names());
            let known = known_names();
            format!("there is no module '{path}'{near} (known: {known})")
        })
}

#[derive(Debug, Clone)]
pub(super) enum Progress {
    Requested,
    Ready(LuaFunction),
    Running(TaskId, LuaFunction),
    Loaded,
    Missing(String),
    /// It does not compile, or it failed; with the place.
    Failed(String),
}

struct Module {
    /// Unique: `lib/pid` or `@spykee/pid`.
    key: String,
    chunk: String,
    progress: Progress,
    /// The source, to show its lines in messages; empty until the file has arrived.
    source: String,
}

#[derive(Clone, Copy, PartialEq, Eq)]
struct ModuleWait {
    from: ModuleId,
    to: ModuleId,
    task: TaskId,
}

pub(super) struct Modules {
    all: Vec<Module>,
    waits: Vec<ModuleWait>,
    bytes: usize,
    /// Prefix of file names in messages, such as `behaviours/`.
    prefix: String,
}

pub(super) const MAIN: ModuleId = ModuleId(0);

impl Modules {
    /// Creates the state for the behaviour that messages call `chunk`.
    pub(super) fn new(chunk: &str) -> Modules {
        let (prefix, file) = match chunk.rfind('/') {
            Some(at) => chunk.split_at(at + 1),
            None => ("", chunk),
        };
        let key = file.strip_suffix(".lua").or(file.strip_suffix(".luau"));
        let main = Module {
            key: key.unwrap_or(file).to_owned(),
            chunk: chunk.to_owned(),
            progress: Progress::Loaded,
            source: String::new(),
        };
        Modules {
            all: vec![main],
            waits: Vec::new(),
            bytes: 0,
            prefix: prefix.to_owned(),
        }
    }

    /// The module with this file; the behaviour itself if no module has it.
    pub(super) fn of_chunk(&self, chunk: &str) -> ModuleId {
        let at = self.all.iter().position(|module| module.chunk == chunk);
        at.map_or(MAIN, ModuleId)
    }

    pub(super) fn folder(&self, id: ModuleId) -> &str {
        self.key(id)
            .rsplit_once('/')
            .map_or("", |(folder, _)| folder)
    }

    pub(super) fn key(&self, id: ModuleId) -> &str {
        self.all.get(id.0).map_or("", |module| &module.key)
    }

    pub(super) fn find(&self, key: &str) -> Option<ModuleId> {
        self.all
            .iter()
            .position(|module| module.key == key)
            .map(ModuleId)
    }

    /// Adds a module of this name, which is not loaded yet.
    pub(super) fn add(&mut self, key: &str, progress: Progress) -> Result<ModuleId, String> {
        if self.all.len() > MAX_MODULES {
            return Err(format!("a script may load at most {MAX_MODULES} modules"));
        }
        let chunk = if key.starts_with(LIBRARY) {
            key.to_owned()
        } else {
            format!("{}{key}", self.prefix)
        };
        self.all.push(Module {
            key: key.to_owned(),
            chunk,
            progress,
            source: String::new(),
        });
        Ok(ModuleId(self.all.len() - 1))
    }

    /// Name and text of every module that came from a file.
    pub(super) fn sources(&self) -> impl Iterator<Item = (&str, &str)> {
        let files = self.all.iter().filter(|module| !module.source.is_empty());
        files.map(|module| (module.chunk.as_str(), module.source.as_str()))
    }

    pub(super) fn record_file(
        &mut self,
        id: ModuleId,
        file: &ModuleFile,
    ) -> Result<String, String> {
        self.bytes += file.source.len();
        let chunk = format!("{}{}", self.prefix, file.file);
        if let Some(module) = self.all.get_mut(id.0) {
            module.chunk.clone_from(&chunk);
            module.source = String::from_utf8_lossy(&file.source).into_owned();
        }
        if self.bytes > MAX_BYTES {
            Err(format!(
                "{chunk}: the modules of a script may have {MAX_BYTES} bytes (1 MiB) in total; \
                 these have more"
            ))
        } else {
            Ok(chunk)
        }
    }

    pub(super) fn progress(&self, id: ModuleId) -> Progress {
        let module = self.all.get(id.0);
        module.map_or(Progress::Loaded, |module| module.progress.clone())
    }

    pub(super) fn set(&mut self, id: ModuleId, progress: Progress) {
        if let Some(module) = self.all.get_mut(id.0) {
            module.progress = progress;
        }
    }

    /// Records that a task in `from` requires `to`; `lives` says whether a task still exists. If
    /// the modules wait for each other in a circle, the error names the chain.
    pub(super) fn record_wait(
        &mut self,
        from: ModuleId,
        to: ModuleId,
        task: TaskId,
        lives: impl Fn(TaskId) -> bool,
    ) -> Result<(), String> {
        self.waits.retain(|wait| lives(wait.task));
        if to != MAIN && matches!(self.progress(to), Progress::Loaded) {
            return Ok(());
        }
        if let Some(chain) = self.chain(to, from, &mut Vec::new()) {
            let names: Vec<&str> = chain
                .iter()
                .chain([&to])
                .map(|id| self.chunk(*id))
                .collect();
            let circle = names.join(" -> ");
            return Err(format!(
                "{circle}: modules require each other; move what both need into a third module"
            ));
        }
        if to == MAIN {
            let main = self.chunk(MAIN);
            return Err(format!("{main} is the behaviour itself, and not a module"));
        }
        let wait = ModuleWait { from, to, task };
        if !self.waits.contains(&wait) {
            self.waits.push(wait);
        }
        Ok(())
    }

    /// Records that a required module is loaded, or will never be.
    pub(super) fn remove_wait(&mut self, from: ModuleId, to: ModuleId, task: TaskId) {
        self.waits
            .retain(|wait| *wait != ModuleWait { from, to, task });
    }

    fn chunk(&self, id: ModuleId) -> &str {
        self.all.get(id.0).map_or("", |module| &module.chunk)
    }

    /// The chain from one module to the other along the modules that are required and not loaded
    /// yet.
    fn chain(
        &self,
        from: ModuleId,
        to: ModuleId,
        seen: &mut Vec<ModuleId>,
    ) -> Option<Vec<ModuleId>> {
        if from == to {
            return Some(vec![from]);
        }
        if seen.contains(&from) {
            return None;
        }
        seen.push(from);
        let mut next = self.waits.iter().filter(|wait| wait.from == from);
        let mut rest = next.find_map(|wait| self.chain(wait.to, to, seen))?;
        rest.insert(0, from);
        Some(rest)
    }

    pub(super) fn clear(&mut self) {
        for module in &mut self.all {
            module.progress = Progress::Loaded;
        }
        self.waits.clear();
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn file(folder: &str, path: &str) -> Result<String, String> {
        match resolve(folder, path) {
            Ok(Target::File(name)) => Ok(name.into()),
            Ok(Target::Library(name, _)) => Ok(name.to_owned()),
            Err(error) => Err(error),
        }
    }

    #[test]
    fn paths_are_relative_to_the_requiring_file() {
        assert_eq!(file("", "./lib/pid").unwrap(), "lib/pid");
        assert_eq!(file("lib", "./pid.lua").unwrap(), "lib/pid");
        assert_eq!(file("lib/a", "../../b.luau").unwrap(), "b");
        assert_eq!(file("lib", "@spykee/pid").unwrap(), "@spykee/pid");
    }

    #[test]
    fn no_path_leaves_the_folder() {
        for (folder, path) in [
            ("", "../x"),
            ("lib", "../../x"),
            ("", "./lib/../../x"),
            ("", "/etc/passwd"),
            ("", "./lib//x"),
            ("", "./.hidden"),
            ("", "./.."),
            ("", "./lib/..\\..\\x"),
            ("", "./x\0"),
            ("", "lib/pid"),
            ("", "@spykee/../x"),
            ("", "@spikee/pid"),
            ("", ""),
            ("", "./"),
        ] {
            assert!(file(folder, path).is_err(), "{path:?}");
        }
        assert!(
            file("", "@spykee/pidd")
                .unwrap_err()
                .contains("did you mean '@spykee/pid'")
        );
    }

    proptest! {
        #[test]
        fn resolved_paths_stay_inside_the_folder(folder in "([a-z]{1,3}/){0,3}", path in "[./a-z@\\\\]{0,30}") {
            if let Ok(Target::File(name)) = resolve(&folder, &path) {
                for segment in name.segments() {
                    prop_assert!(!segment.is_empty() && !segment.starts_with('.'));
                }
                prop_assert!(ModuleName::try_from(String::from(name.clone())).is_ok());
            }
        }
    }
}
