//! Why a call of a scenario's script is refused, in words for its author.

use std::io;
use std::path::PathBuf;

use crate::behaviour::NameError;
use crate::clock::ClockError;
use crate::sim::DocumentError;

/// Why a call of a scenario's script is refused.
#[derive(Debug, thiserror::Error)]
pub(super) enum CallError {
    #[error("it does not exist")]
    Unknown,
    #[error("this can be asked inside of a scenario only, in its function(sim) ... end")]
    Outside,
    #[error("the name must have 1 to 200 bytes")]
    NoName,
    #[error("'{name}' is in line {line} already")]
    Twice { name: String, line: u32 },
    #[error("at most {0} scenarios fit into one file")]
    TooMany(usize),
    #[error("the behaviours have written more than {0} lines: the later ones are not kept")]
    LinesMissed(usize),
    #[error("there is no ball in this world")]
    NoBall,
    #[error("the ball's number must be between 1 and {balls}, got {number}")]
    BallNumber { balls: usize, number: f64 },
    #[error(
        "behaviours are running already: name all of them in one call, or call sim:stop() before"
    )]
    Running,
    #[error(transparent)]
    Date(#[from] ClockError),
    #[error("{0}")]
    Fault(String),
    #[error(transparent)]
    World(#[from] WorldError),
    #[error(transparent)]
    Cast(#[from] CastError),
}

/// Why a world cannot be had.
#[derive(Debug, thiserror::Error)]
pub(super) enum WorldError {
    #[error("{0} is no world: it leads to a file of another kind")]
    Elsewhere(String),
    #[error(transparent)]
    Document(#[from] DocumentError),
    #[error(
        "there is no world '{name}'{near} (built-in: {known}; or a file, such as \
         \"house.yaml\")"
    )]
    Unknown {
        name: String,
        near: String,
        known: String,
    },
}

/// Why a behaviour that a scenario names cannot be run.
#[derive(Debug, thiserror::Error)]
pub(super) enum CastError {
    #[error("name a behaviour, such as sim:run(\"patrol.lua\")")]
    NoSubject,
    #[error(transparent)]
    Name(#[from] NameError),
    #[error("two behaviours are called '{0}': give one of them another name")]
    Twins(String),
    #[error(transparent)]
    Table(#[from] serde_json::Error),
    #[error(
        "a behaviour must be a file or a table such as {{ file = \"patrol.lua\", params = {{ speed = \
         50 }} }}"
    )]
    Kind,
    #[error("no behaviour can be named here: sim:run() runs the one")]
    NoFolder,
    #[error("{} is no behaviour: its name must end in .lua", .0.display())]
    NoScript(PathBuf),
    #[error("cannot read the behaviour {}: {source}", path.display())]
    Read { path: PathBuf, source: io::Error },
    #[error("the behaviour cannot work:\n{0}")]
    Mistakes(String),
}
