//! A file of scenarios: its declarations, before any scenario runs.

use std::cell::RefCell;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use serde_json::Value;
use tokio::time::Instant;

use super::CallError;
use super::running_api::{Arguments, seconds};
use crate::behaviour::{Library, read_source};
use crate::check;
use crate::robot::EndReason;
use crate::script::{
    self, FromHost, NoModule, ScenarioApi, ScenarioCall, ScenarioCallResult, Script, ScriptExit,
};
use crate::sim::World;
use crate::yaml::suggestion;

const MAX_SCENARIOS: usize = 1000;
/// CPU budget of a scenario's own script between waits. It can be long, because this script does
/// not control a robot.
const BUDGET_MS: u64 = 2000;

#[derive(Debug, Clone)]
pub struct ScenarioFile {
    file: PathBuf,
    /// Folder for relative file names; `None` for a text.
    folder: Option<PathBuf>,
    pub(super) source: Vec<u8>,
    scenarios: Vec<Scenario>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scenario {
    pub name: String,
    pub options: Options,
    pub line: u32,
    pub(super) index: usize,
}

impl Scenario {
    pub fn seeds(&self) -> RangeInclusive<u64> {
        1..=self.options.seeds
    }
}

#[derive(Debug, thiserror::Error)]
pub enum ScenarioFileError {
    #[error("cannot read the scenarios {path}: {source}")]
    Read {
        path: String,
        source: std::io::Error,
    },
    /// The script does not load, it fails, or its declarations are wrong; names file, line and
    /// remedy.
    #[error("{0}")]
    Invalid(String),
}

impl ScenarioFile {
    pub fn read(file: &Path) -> Result<ScenarioFile, ScenarioFileError> {
        ScenarioFile::read_undeclared(file)?.declared()
    }

    /// Creates a scenario file from a text that is not in a file, for example one built into the
    /// program. It can use no other files: no modules, and only built-in worlds.
    /// Fails with [`ScenarioFileError::Invalid`].
    pub fn of_text(name: &str, text: &str) -> Result<ScenarioFile, ScenarioFileError> {
        ScenarioFile::undeclared(Path::new(name), None, text.into()).declared()
    }

    fn declared(self) -> Result<ScenarioFile, ScenarioFileError> {
        let scenarios = self.read_declarations()?;
        Ok(self.with_scenarios(scenarios))
    }

    pub(super) fn read_undeclared(file: &Path) -> Result<ScenarioFile, ScenarioFileError> {
        let source = read_source(file).map_err(|source| ScenarioFileError::Read {
            path: file.display().to_string(),
            source,
        })?;
        let folder = file.parent().unwrap_or(Path::new(""));
        Ok(ScenarioFile::undeclared(
            file,
            Some(folder.to_owned()),
            source,
        ))
    }

    pub(super) fn undeclared(
        file: &Path,
        folder: Option<PathBuf>,
        source: Vec<u8>,
    ) -> ScenarioFile {
        ScenarioFile {
            file: file.to_owned(),
            folder,
            source,
            scenarios: Vec::new(),
        }
    }

    pub(super) fn with_scenarios(self, scenarios: Vec<Scenario>) -> ScenarioFile {
        ScenarioFile { scenarios, ..self }
    }

    pub fn scenarios(&self) -> &[Scenario] {
        &self.scenarios
    }

    pub fn file(&self) -> &Path {
        &self.file
    }

    pub(super) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Returns the behaviour in the same folder with the file's name without `_test`.
    pub(super) fn subject(&self) -> Option<PathBuf> {
        let stem = self.file.file_stem()?.to_str()?;
        let name = format!("{}.lua", stem.strip_suffix("_test")?);
        let file = self.folder()?.join(name);
        Some(file).filter(|file| file.is_file())
    }

    pub(super) fn line(&self, number: u32) -> Option<String> {
        let text = String::from_utf8_lossy(&self.source);
        let line = text.lines().nth(number.checked_sub(1)? as usize)?;
        Some(line.to_owned())
    }

    /// Explains an error of the file's script on this line in plain words; `None` if it needs no
    /// explanation.
    pub(super) fn explanation(&self, line: u32, words: &str) -> Option<check::Diagnostic> {
        let file = self.file.display();
        let source = String::from_utf8_lossy(&self.source);
        let text = format!("{file}:{line}: {words}");
        check::explanation(&text, &file.to_string(), &source)
    }

    pub(super) fn script(
        &self,
        seed: u64,
        api: Rc<dyn ScenarioApi>,
    ) -> Result<Script, script::Failure> {
        let mut options = script::Options {
            seed,
            ..script::Options::new("scenario", self.file.display().to_string())
        };
        options.limits.callback_budget_ms = BUDGET_MS;
        let mut script = Script::with_scenario_api(&self.source, options, api, Instant::now())?;
        script.explain_with(check::explain);
        Ok(script)
    }

    /// Handles the output of a script of this file; passes log lines to `line`.
    pub(super) fn serve(&self, script: &mut Script, mut line: impl FnMut(String)) {
        for output in script.take_output() {
            match output {
                FromHost::Log(written) => line(written.text),
                FromHost::Module(name) => {
                    let folder = self.folder.clone();
                    let file = folder
                        .map_or_else(Library::default, Library::new)
                        .fetch(&name)
                        .map_err(|error| NoModule(error.to_string()));
                    script.deliver_module(&name, file, Instant::now());
                }
                _ => {}
            }
        }
    }

    pub(super) fn read_declarations(&self) -> Result<Vec<Scenario>, ScenarioFileError> {
        let invalid = |text: String| Err(ScenarioFileError::Invalid(text));
        let shown = self.file.display();
        let api = Rc::new(DeclarationApi {
            folder: self.folder().map(Path::to_owned),
            found: RefCell::default(),
        });
        let mut script = match self.script(0, api.clone()) {
            Ok(script) => script,
            Err(failure) => return invalid(failure.to_string()),
        };
        while script.is_ready() {
            script.run_ready(Instant::now());
            self.serve(&mut script, |_| {});
        }
        match script.ended() {
            Some(ScriptExit {
                reason: EndReason::Done,
                ..
            }) => {}
            Some(exit) => {
                return invalid(
                    exit.message
                        .unwrap_or_else(|| format!("{shown}: it failed")),
                );
            }
            None => {
                return invalid(format!(
                    "{shown}: it waits before its scenarios are declared; wait only inside scenarios"
                ));
            }
        }
        let found = api.found.take();
        if found.is_empty() {
            invalid(format!(
                "{shown}: it declares no scenario, such as\n\
                 scenario(\"hits nothing\", {{ limit = 60 }}, function(sim) ... end)"
            ))
        } else {
            Ok(found)
        }
    }
}

/// Records declarations and runs nothing.
struct DeclarationApi {
    folder: Option<PathBuf>,
    found: RefCell<Vec<Scenario>>,
}

impl ScenarioApi for DeclarationApi {
    fn answer(&self, call: ScenarioCall<'_>) -> ScenarioCallResult {
        if call.name != "scenario" {
            return Err(CallError::Outside.into());
        }
        let given = Arguments(call.arguments);
        let name = given.text(0).unwrap_or_default();
        if name.trim().is_empty() {
            return Err(CallError::NoName.into());
        }
        let options = Options::parse(given.value(1));
        load_world(options.world.as_deref(), self.folder.as_deref())?;
        let mut found = self.found.borrow_mut();
        if let Some(twin) = found.iter().find(|other| other.name == name) {
            let name = name.to_owned();
            let line = twin.line;
            return Err(CallError::DuplicateName { name, line }.into());
        }
        if found.len() == MAX_SCENARIOS {
            return Err(CallError::TooMany(MAX_SCENARIOS).into());
        }
        let index = found.len();
        found.push(Scenario {
            name: name.to_owned(),
            options,
            line: call.location.map_or(1, |location| location.line),
            index,
        });
        Ok(false.into())
    }
}

/// Loads the built-in world with this name, or a world file in this folder.
pub(super) fn load_world(name: Option<&str>, folder: Option<&Path>) -> Result<World, CallError> {
    let Some(name) = name else {
        return Ok(World::default_world());
    };
    if let Some(world) = World::builtin(name) {
        return Ok(world);
    }
    let is_world = |path: &Path| {
        path.extension()
            .is_some_and(|end| end == "yaml" || end == "yml")
    };
    if let Some(folder) = folder
        && is_world(Path::new(name))
    {
        let path = folder.join(name);
        // Error messages quote the content, so only world files may be read, also through links.
        if path.canonicalize().is_ok_and(|path| !is_world(&path)) {
            return Err(CallError::Elsewhere(name.to_owned()));
        }
        return Ok(World::load(&path)?);
    }
    let near = suggestion(name, World::builtin_names());
    let known = World::builtin_names().collect::<Vec<_>>().join(", ");
    Err(CallError::UnknownWorld {
        name: name.to_owned(),
        near,
        known,
    })
}

/// Options of a scenario. The API table defines bounds and defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Name of a built-in world, or a file in the scenario's folder; the default world if `None`.
    pub world: Option<String>,
    /// The battery's level at the start, 0..=100 percent; the world's if `None`.
    pub battery: Option<f64>,
    /// Number of seeds: the scenario is run with the seeds from 1 to this.
    pub seeds: u64,
    /// Limit in virtual time.
    pub limit: Duration,
    pub points: u32,
    /// Frames per second of the robot's camera; the world's if `None`.
    pub fps: Option<f64>,
    /// Whether the scenario continues when a behaviour fails.
    pub may_fail: bool,
}

impl Options {
    /// Reads the options from a validated table.
    pub(super) fn parse(table: &Value) -> Options {
        let number = |key: &str| table[key].as_f64();
        Options {
            world: table["world"].as_str().map(str::to_owned),
            battery: number("battery"),
            seeds: number("seeds").unwrap_or_default() as u64,
            limit: seconds(&table["limit"]),
            points: number("points").unwrap_or_default() as u32,
            fps: number("fps"),
            may_fail: table["may_fail"] == true,
        }
    }
}
