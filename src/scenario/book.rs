//! A file of scenarios: what it declares, before anything of it is played.

use std::cell::RefCell;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use serde::{Deserialize, Serialize};
use tokio::time::Instant;

use super::arguments::Arguments;
use super::options::Options;
use super::refusal::{CallError, WorldError};
use crate::behaviour::{Library, read_source};
use crate::check;
use crate::robot::EndReason;
use crate::script::{
    self, Ending, NoModule, Output, Script, Stage, StageAnswer, StageCall, suggestion,
};
use crate::sim::World;

/// Scenarios of one file.
const MAX_SCENARIOS: usize = 1000;
/// A scenario's own script may think so long without waiting; it stops no robot meanwhile.
const BUDGET_MS: u64 = 2000;

/// A file of scenarios.
#[derive(Debug, Clone)]
pub struct Book {
    file: PathBuf,
    /// What it names is looked for there; a text has none.
    folder: Option<PathBuf>,
    source: Vec<u8>,
    scenarios: Vec<Scenario>,
}

/// One scenario, as it was declared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Scenario {
    /// Unique in its file.
    pub name: String,
    /// How it is set up.
    pub options: Options,
    /// Where it was declared, from 1.
    pub line: u32,
    /// From 0.
    pub(super) index: usize,
}

impl Scenario {
    /// Those it is to be played with.
    pub fn seeds(&self) -> RangeInclusive<u64> {
        1..=self.options.seeds
    }
}

/// Why a file's scenarios cannot be played.
#[derive(Debug, thiserror::Error)]
pub enum BookError {
    /// Not readable.
    #[error("cannot read the scenarios {path}: {source}")]
    Read {
        /// Which.
        path: String,
        /// The system's words.
        source: std::io::Error,
    },
    /// It does not load, it fails, or what it declares is wrong: file, line and what to do.
    #[error("{0}")]
    Invalid(String),
}

impl Book {
    /// Reads a file and sees what it declares.
    ///
    /// # Errors
    /// See [`BookError`].
    pub fn read(file: &Path) -> Result<Book, BookError> {
        let source = read_source(file).map_err(|source| BookError::Read {
            path: file.display().to_string(),
            source,
        })?;
        let folder = file.parent().unwrap_or(Path::new(""));
        Book::new(file, Some(folder.to_owned()), source)
    }

    /// Of a text that is in no file, such as one within the program. It sees no files beside it:
    /// no modules, only built-in worlds.
    ///
    /// # Errors
    /// [`BookError::Invalid`].
    pub fn of_text(name: &str, text: &str) -> Result<Book, BookError> {
        Book::new(Path::new(name), None, text.into())
    }

    fn new(file: &Path, folder: Option<PathBuf>, source: Vec<u8>) -> Result<Book, BookError> {
        let book = Book::undeclared(file, folder, source);
        let scenarios = book.declared()?;
        Ok(book.with(scenarios))
    }

    /// Nothing of it was looked at yet.
    pub(super) fn undeclared(file: &Path, folder: Option<PathBuf>, source: Vec<u8>) -> Book {
        Book {
            file: file.to_owned(),
            folder,
            source,
            scenarios: Vec::new(),
        }
    }

    /// With what it declares.
    pub(super) fn with(self, scenarios: Vec<Scenario>) -> Book {
        Book { scenarios, ..self }
    }

    pub(super) fn source(&self) -> &[u8] {
        &self.source
    }

    /// In the order of the file.
    pub fn scenarios(&self) -> &[Scenario] {
        &self.scenarios
    }

    /// Where it was read from, or the name of its text.
    pub fn file(&self) -> &Path {
        &self.file
    }

    pub(super) fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// The behaviour beside it that has its name without `_test`.
    pub(super) fn subject(&self) -> Option<PathBuf> {
        let stem = self.file.file_stem()?.to_str()?;
        let name = format!("{}.lua", stem.strip_suffix("_test")?);
        let file = self.folder()?.join(name);
        file.is_file().then_some(file)
    }

    /// One line of it.
    pub(super) fn line(&self, number: u32) -> Option<String> {
        let text = String::from_utf8_lossy(&self.source);
        let line = text.lines().nth(number.checked_sub(1)? as usize)?;
        Some(line.to_owned())
    }

    pub(super) fn script(
        &self,
        seed: u64,
        stage: Rc<dyn Stage>,
    ) -> Result<Script, script::Failure> {
        let mut options = script::Options {
            seed,
            ..script::Options::new("scenario", self.file.display().to_string())
        };
        options.limits.callback_budget_ms = BUDGET_MS;
        let mut script = Script::on_stage(&self.source, options, stage, Instant::now())?;
        script.explain_with(check::explain);
        Ok(script)
    }

    /// Serves what a script of this book sends out; its lines are handed to `line`.
    pub(super) fn serve(&self, script: &mut Script, mut line: impl FnMut(String)) {
        for output in script.take_output() {
            match output {
                Output::Log(written) => line(written.text),
                Output::Module(name) => {
                    let folder = self.folder.clone();
                    let file = folder
                        .map_or_else(Library::default, Library::new)
                        .fetch(&name)
                        .map_err(|error| NoModule(error.to_string()));
                    script.deliver_module(&name, file, Instant::now());
                }
                Output::Intent(_)
                | Output::Evaluated(_)
                | Output::Params(_)
                | Output::Remark(_) => {}
            }
        }
    }

    /// Runs the file once to see what it declares.
    pub(super) fn declared(&self) -> Result<Vec<Scenario>, BookError> {
        let invalid = |text: String| Err(BookError::Invalid(text));
        let shown = self.file.display();
        let stage = Rc::new(Declaring {
            folder: self.folder().map(Path::to_owned),
            found: RefCell::default(),
        });
        let mut script = match self.script(0, stage.clone()) {
            Ok(script) => script,
            Err(failure) => return invalid(failure.to_string()),
        };
        while script.is_ready() {
            script.run_ready(Instant::now());
            self.serve(&mut script, |_| {});
        }
        match script.ended() {
            Some(Ending {
                reason: EndReason::Done,
                ..
            }) => {}
            Some(ending) => {
                return invalid(
                    ending
                        .message
                        .unwrap_or_else(|| format!("{shown}: it failed")),
                );
            }
            None => {
                return invalid(format!(
                    "{shown}: it waits before its scenarios are declared; wait inside of them only"
                ));
            }
        }
        let found = stage.found.take();
        if found.is_empty() {
            invalid(format!(
                "{shown}: there is no scenario in it, such as\n\
                 scenario(\"hits nothing\", {{ limit = 60 }}, function(sim) ... end)"
            ))
        } else {
            Ok(found)
        }
    }
}

/// Takes down what is declared and plays nothing.
struct Declaring {
    folder: Option<PathBuf>,
    found: RefCell<Vec<Scenario>>,
}

impl Stage for Declaring {
    fn answer(&self, call: StageCall<'_>) -> StageAnswer {
        if call.name != "scenario" {
            return Err(CallError::Outside.into());
        }
        let given = Arguments(call.arguments);
        let name = given.text(0).unwrap_or_default();
        if name.trim().is_empty() {
            return Err(CallError::NoName.into());
        }
        let options = Options::of(given.value(1));
        load_world(options.world.as_deref(), self.folder.as_deref())?;
        let mut found = self.found.borrow_mut();
        if let Some(twin) = found.iter().find(|other| other.name == name) {
            let (name, line) = (name.to_owned(), twin.line);
            return Err(CallError::Twice { name, line }.into());
        }
        if found.len() == MAX_SCENARIOS {
            return Err(CallError::TooMany(MAX_SCENARIOS).into());
        }
        let index = found.len();
        found.push(Scenario {
            name: name.to_owned(),
            options,
            line: call.place.map_or(1, |place| place.line),
            index,
        });
        Ok(false.into())
    }
}

/// The world of a name, or of a file in this folder.
pub(super) fn load_world(name: Option<&str>, folder: Option<&Path>) -> Result<World, WorldError> {
    let Some(name) = name else {
        return Ok(World::default_world());
    };
    if let Some(world) = World::ready(name) {
        return Ok(world);
    }
    let is_world = |path: &Path| {
        path.extension()
            .is_some_and(|end| end == "yaml" || end == "yml")
    };
    if let Some(folder) = folder.filter(|_| is_world(Path::new(name))) {
        let path = folder.join(name);
        // Messages quote what is wrong: nothing else is looked into, through a link neither.
        if path.canonicalize().is_ok_and(|path| !is_world(&path)) {
            return Err(WorldError::Elsewhere(name.to_owned()));
        }
        return Ok(World::load(&path)?);
    }
    let near = suggestion(name, World::ready_names());
    let known = World::ready_names().collect::<Vec<_>>().join(", ");
    Err(WorldError::Unknown {
        name: name.to_owned(),
        near,
        known,
    })
}
