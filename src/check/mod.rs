//! Checks a script before it runs: syntax, names, API calls, modules. Also explains the VM's error
//! message of a failed script in plain words: [`explain`].
//!
//! The compiler checks the syntax; for the rest the script is parsed into a tree. There are no
//! false positives: what cannot be determined from the file alone is left to the run. The work is
//! bounded whatever the file contains, and no part of the script runs.

mod diagnostic;
mod explain;
mod foreign;
mod kinds;
mod lexer;
mod loops;
mod parameters;
mod parser;
mod passing;
mod required;
mod syntax;
#[cfg(test)]
mod tests;
mod tree;
mod walk;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use tokio::time::Instant;

use crate::api;
use crate::robot::Streams;
use crate::script::{Failure, GivenParam, Options, Script, compile_error, read_text, resolve};
use crate::vision::Colour;

pub use diagnostic::{Diagnostic, Severity};
pub use explain::{explain, explanation};
use lexer::Span;
pub use required::{Required, required};

/// The environment in which a script is checked.
#[derive(Debug, Clone)]
pub struct CheckContext {
    /// Every path (such as `robot.move`) that exists in a live VM.
    paths: BTreeSet<String>,
    /// The colours defined in the config.
    colours: Vec<String>,
    /// The script's file; relative module paths start from its folder.
    file: Option<PathBuf>,
    /// Accept every global: there is no VM that knows them.
    open_globals: bool,
    /// Values given for the parameters that the script declares.
    params: BTreeMap<String, GivenParam>,
    /// The config's settings for the robot's streams.
    streams: Streams,
}

impl CheckContext {
    /// Creates the context for a script with these options in this file.
    pub fn new(options: &Options, file: Option<&Path>) -> CheckContext {
        let script = if file.is_some_and(is_scenario) {
            Script::empty_scenario(options.clone(), Instant::now())
        } else {
            Script::load(b"", options.clone(), Instant::now())
        };
        CheckContext {
            paths: script
                .map(|script| script.known_names())
                .unwrap_or_default(),
            colours: options.colours.keys().cloned().collect(),
            file: file.map(Path::to_path_buf),
            open_globals: false,
            params: options.params.clone(),
            streams: options.streams,
        }
    }

    /// Creates a context from the API definitions only, without a VM.
    fn defined() -> CheckContext {
        let functions = api::functions();
        let constants = api::constants().map(|one| one.path.to_owned());
        CheckContext {
            paths: functions
                .map(|one| one.path.to_owned())
                .chain(constants)
                .collect(),
            colours: Vec::new(),
            file: None,
            open_globals: true,
            params: BTreeMap::new(),
            streams: Streams::default(),
        }
    }

    fn colour_names(&self) -> Vec<String> {
        let known = Colour::NAMES.iter().map(|name| (*name).to_owned());
        self.colours.iter().cloned().chain(known).collect()
    }

    /// Returns why there is no such module; `None` if there may be one.
    fn missing_module(&self, path: &str) -> Option<String> {
        let beside = path.starts_with("./") || path.starts_with("../");
        if !beside {
            return resolve("", path).err().map(|why| why.to_string());
        }
        let folder = self.file.as_ref()?.parent()?;
        let path = path.trim_end_matches(".luau").trim_end_matches(".lua");
        let found = ["lua", "luau"]
            .iter()
            .any(|ending| may_be_file(&folder.join(format!("{path}.{ending}"))));
        (!found).then(|| format!("there is no module '{path}': no file {path}.lua beside this one"))
    }
}

/// Whether this is a file. True also if permission is denied, since this process may have fewer
/// rights than its user.
fn may_be_file(path: &Path) -> bool {
    match path.metadata() {
        Ok(metadata) => metadata.is_file(),
        Err(error) => error.kind() == std::io::ErrorKind::PermissionDenied,
    }
}

/// Returns the errors that prevent a script with these options from running, without the warnings.
/// The options' chunk name is the script's file.
pub fn errors(source: &[u8], options: &Options) -> Vec<Diagnostic> {
    let context = CheckContext::new(options, Some(Path::new(&options.chunk)));
    let mut diagnostics = check(source, &options.chunk, &context);
    diagnostics.retain(|diagnostic| diagnostic.severity == Severity::Error);
    diagnostics
}

/// Whether a file is a scenario that tests behaviours: `*_test.lua`, or the `check.lua` of a
/// lesson.
fn is_scenario(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    name.ends_with("_test.lua") || name == "check.lua"
}

/// Returns everything wrong with a script that can be detected without running it.
pub fn check(source: &[u8], chunk: &str, context: &CheckContext) -> Vec<Diagnostic> {
    let text = match read_text(source, chunk) {
        Ok(text) => text,
        Err(failure) => return vec![unreadable(source, chunk, &failure)],
    };
    if let Some(complaint) = compile_error(text, chunk) {
        return vec![syntax::diagnostic((chunk, text), &complaint)];
    }
    match parser::parse(text) {
        Ok(tree) => walk::walk(&tree, (chunk, text), context),
        Err(_) => Vec::new(),
    }
}

/// Whether a source can be parsed into a tree.
#[cfg(test)]
fn reads(source: &str) -> bool {
    parser::parse(source).is_ok()
}

/// The diagnostic for a file that is not a text.
fn unreadable(source: &[u8], chunk: &str, failure: &Failure) -> Diagnostic {
    let text = String::from_utf8_lossy(source);
    let line = match failure {
        Failure::NotUtf8 { line, .. } | Failure::Control { line, .. } => *line,
        _ => 1,
    };
    let start: usize = text
        .split_inclusive('\n')
        .take(line - 1)
        .map(str::len)
        .sum();
    let span = Span { start, end: start };
    let words = failure.to_string();
    let words = words.strip_prefix(chunk).unwrap_or(&words);
    let words = words.trim_start_matches(|c: char| c == ':' || c == ' ' || c.is_ascii_digit());
    Diagnostic::new((chunk, &text), span, Severity::Error, words)
}
