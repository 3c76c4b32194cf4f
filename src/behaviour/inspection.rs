//! Looks at a script as [`check`](crate::check) does, in a confined process of its own: the
//! compiler reads untrusted source text.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::host::STACK;
use crate::check::{CheckContext, Finding, Required, Severity, check, required};
use crate::script::Options;
use crate::walls::{self, Room, Worker, WorkerError};

/// What its process is started for.
pub const INSPECTION: &str = "check";
/// A text of the longest kind takes a small part of it.
const LIMIT: Duration = Duration::from_secs(10);

#[derive(Serialize, Deserialize)]
struct Question {
    source: Vec<u8>,
    options: Options,
    /// Where it is, as seen from the behaviour's folder.
    folder: String,
}

/// What was found in one file.
#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Inspected {
    /// In the order of the file.
    pub findings: Vec<Finding>,
    /// The modules that it requires.
    pub required: Vec<Required>,
}

/// Why a text could not be looked at.
#[derive(Debug, thiserror::Error)]
pub enum InspectionError {
    /// Question or answer is no message.
    #[error(transparent)]
    Message(#[from] postcard::Error),
    /// The process gave no answer.
    #[error(transparent)]
    Worker(#[from] WorkerError),
}

/// Starts such processes.
#[derive(Debug, Clone)]
pub struct Inspector(Worker);

impl Inspector {
    /// Of this executable, which must be `spykee`.
    pub fn new(executable: PathBuf) -> Inspector {
        Inspector(Worker::new(executable, INSPECTION))
    }

    /// Of the running executable.
    ///
    /// # Errors
    /// If the system does not tell where it is.
    pub fn of_this_executable() -> io::Result<Inspector> {
        Worker::of_this_executable(INSPECTION).map(Inspector)
    }

    /// Looks at a text; `folder` is where its file is, as seen from the behaviour's folder. Blocks.
    ///
    /// # Errors
    /// See [`InspectionError`].
    pub fn inspect(
        &self,
        source: &[u8],
        options: &Options,
        folder: &str,
    ) -> Result<Inspected, InspectionError> {
        let question = Question {
            source: source.to_vec(),
            options: options.clone(),
            folder: folder.to_owned(),
        };
        let question = postcard::to_allocvec(&question)?;
        let room = Room {
            processor: LIMIT.as_secs(),
            ..Room::default()
        };
        let answer = self.0.ask(&room, &question, LIMIT, &|| true)?;
        Ok(postcard::from_bytes(&answer)?)
    }

    /// What refuses a script with these options; mere warnings are left out.
    ///
    /// # Errors
    /// As of [`Inspector::inspect`].
    pub fn errors(
        &self,
        source: &[u8],
        options: &Options,
    ) -> Result<Vec<Finding>, InspectionError> {
        let mut findings = self.inspect(source, options, "")?.findings;
        findings.retain(|finding| finding.severity == Severity::Error);
        Ok(findings)
    }
}

/// The life of such a process. The arguments are its room.
pub fn inspection_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    walls::answer(arguments, STACK, |question| {
        let Question {
            source,
            options,
            folder,
        } = postcard::from_bytes(question).map_err(io::Error::other)?;
        let surroundings = CheckContext::new(&options, Some(Path::new(&options.chunk)));
        let inspected = Inspected {
            findings: check(&source, &options.chunk, &surroundings),
            required: required(&source, &folder),
        };
        postcard::to_allocvec(&inspected).map_err(io::Error::other)
    })
}
