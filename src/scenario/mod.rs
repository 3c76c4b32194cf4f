//! Scenarios: tests of behaviours in a world, written in Luau in `*_test.lua` files and run in a
//! [`simulation`](crate::simulation). The script of a scenario has its own VM, with `scenario`,
//! `expect` and `sim` in place of `robot`. [`ScenarioFile`] runs in this process, where only the VM
//! confines the scripts; [`ScenarioProcess`] in processes confined by the kernel.

mod behaviours;
mod process;
mod run_record;
mod running_api;
mod scenario_file;
mod scenario_run;

use std::io;
use std::path::PathBuf;

pub use process::{SCENARIO_PROCESS, ScenarioProcess, scenario_process_main};
pub use scenario_file::{Options, Scenario, ScenarioFile, ScenarioFileError};
pub use scenario_run::{Cause, Failure, RunSettings, ScenarioResult, Snapshot};

use crate::behaviour::NameError;
use crate::clock::ClockError;
use crate::sim::DocumentError;

/// An error of a call by a scenario's script, with a message for its author.
#[derive(Debug, thiserror::Error)]
enum CallError {
    #[error("it does not exist")]
    Unknown,
    #[error("this call works only inside a scenario, in its function(sim) ... end")]
    Outside,
    #[error("the name must have 1 to 200 bytes")]
    NoName,
    #[error("'{name}' is already declared in line {line}")]
    DuplicateName { name: String, line: u32 },
    #[error("a file can have at most {0} scenarios")]
    TooMany(usize),
    #[error("the behaviours have written more than {0} lines: later ones are not kept")]
    LinesMissed(usize),
    #[error("there is no ball in this world")]
    NoBall,
    #[error("the ball's number must be between 1 and {balls}, got {number}")]
    BallNumber { balls: usize, number: f64 },
    #[error(
        "behaviours are running already: name all of them in one call, or call sim:stop() first"
    )]
    Running,
    #[error(transparent)]
    Date(#[from] ClockError),
    #[error("{0}")]
    Fault(String),
    #[error("{0} is not a world: it links to a file of another kind")]
    Elsewhere(String),
    #[error(transparent)]
    Document(#[from] DocumentError),
    #[error(
        "there is no world '{name}'{near} (built-in: {known}; or a file, such as \
         \"house.yaml\")"
    )]
    UnknownWorld {
        name: String,
        near: String,
        known: String,
    },
    #[error("name a behaviour, such as sim:run(\"patrol.lua\")")]
    NoSubject,
    #[error(transparent)]
    Name(#[from] NameError),
    #[error("two behaviours are called '{0}': give one of them another name")]
    DuplicateBehaviour(String),
    #[error(transparent)]
    Table(#[from] serde_json::Error),
    #[error(
        "a behaviour must be a file or a table such as {{ file = \"patrol.lua\", params = {{ speed = \
         50 }} }}"
    )]
    Kind,
    #[error("behaviours cannot be named here: call sim:run() without arguments")]
    NoFolder,
    #[error("{} is not a behaviour: its name must end in .lua or .luau", .0.display())]
    NoScript(PathBuf),
    #[error("there is no {}", .0.display())]
    NoFile(PathBuf),
    #[error("cannot read the behaviour {}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("the behaviour has errors:\n{0}")]
    Mistakes(String),
}
