//! Runs [`check`](crate::check) on a script in a separate, confined process, since the compiler
//! reads untrusted source text.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::host::STACK;
use crate::check::{CheckContext, Diagnostic, Required, check, required};
use crate::sandbox::{self, SandboxPolicy, Worker, WorkerError};
use crate::script::Options;

/// The hidden argument that selects this purpose of the process.
pub const INSPECTION: &str = "check";
/// Time limit of an inspection; a text of the maximum length takes a small part of it.
const LIMIT: Duration = Duration::from_secs(10);

#[derive(Debug, Default, Serialize, Deserialize)]
pub struct Inspected {
    pub diagnostics: Vec<Diagnostic>,
    pub required: Vec<Required>,
}

#[derive(Debug, Clone)]
pub struct Inspector(Worker);

impl Inspector {
    pub fn new(executable: PathBuf) -> Inspector {
        Inspector(Worker::new(executable, INSPECTION))
    }

    pub fn of_this_executable() -> io::Result<Inspector> {
        Worker::of_this_executable(INSPECTION).map(Inspector)
    }

    /// Inspects a text. `folder` is the folder of its file, relative to the behaviour's folder.
    /// Blocks.
    pub fn inspect(
        &self,
        source: &[u8],
        options: &Options,
        folder: &str,
    ) -> Result<Inspected, WorkerError> {
        let broken = |error: postcard::Error| WorkerError::Broken(error.to_string());
        let question = postcard::to_allocvec(&(source, options, folder)).map_err(broken)?;
        let policy = SandboxPolicy {
            cpu_seconds: LIMIT.as_secs(),
            ..SandboxPolicy::default()
        };
        let answer = self.0.ask(&policy, &question, LIMIT, &|| true)?;
        postcard::from_bytes(&answer).map_err(broken)
    }
}

/// Inspects a text in this process.
pub(super) fn inspect(source: &[u8], options: &Options, folder: &str) -> Inspected {
    let context = CheckContext::new(options, Some(Path::new(&options.chunk)));
    Inspected {
        diagnostics: check(source, &options.chunk, &context),
        required: required(source, folder),
    }
}

/// Runs an inspection process. The arguments describe its `SandboxPolicy`.
pub fn inspection_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    sandbox::answer(arguments, STACK, |question| {
        let (source, options, folder): (Vec<u8>, Options, String) =
            postcard::from_bytes(question).map_err(io::Error::other)?;
        let inspected = inspect(&source, &options, &folder);
        postcard::to_allocvec(&inspected).map_err(io::Error::other)
    })
}
