//! Checks scripts together with the modules that they require.

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use super::host::Launch;
use super::inspection::{Inspected, Inspector, inspect};
use crate::check::{Diagnostic, Severity};
use crate::script::{ModuleFile, Options};

/// Checks each file once.
#[derive(Debug)]
pub struct ScriptChecker {
    /// Inspects in a confined process; `None`: in this one.
    inspector: Option<Inspector>,
    pub seen: BTreeSet<PathBuf>,
    pub diagnostics: Vec<Diagnostic>,
}

impl ScriptChecker {
    pub fn new(inspector: Option<Inspector>) -> ScriptChecker {
        ScriptChecker {
            inspector,
            seen: BTreeSet::new(),
            diagnostics: Vec::new(),
        }
    }

    /// Checks a behaviour's own file, then its modules. Blocks. Fails, with the reason, if a file
    /// cannot be checked.
    pub fn behaviour(&mut self, launch: &Launch) -> Result<(), String> {
        let Launch {
            source,
            options,
            library,
        } = launch;
        let folder = Path::new(&options.chunk).parent().unwrap_or(Path::new(""));
        // Each with its folder, relative to the behaviour's.
        let mut files = VecDeque::from([(source.clone(), options.clone(), String::new())]);
        while let Some((source, options, inner)) = files.pop_front() {
            let chunk = options.chunk.as_str();
            let file = Path::new(chunk);
            let file = file.canonicalize().unwrap_or_else(|_| file.to_owned());
            if !self.seen.insert(file) {
                continue;
            }
            let Inspected {
                diagnostics: mut found,
                required,
            } = match &self.inspector {
                Some(inspector) => inspector
                    .inspect(&source, &options, &inner)
                    .map_err(|why| format!("{chunk}: cannot be checked: {why}"))?,
                None => inspect(&source, &options, &inner),
            };
            found.sort_by_key(|diagnostic| (diagnostic.line, diagnostic.column));
            for module in required {
                match library.fetch(&module.name) {
                    Ok(file) => files.push_back(of_module(file, folder, &options)),
                    Err(why) => {
                        // It exists, but is refused, such as one behind a symbolic link. Those that do
                        // not exist are already among what was found.
                        let refused = module.refused(&source, chunk, &why.to_string());
                        let is_new = |one: &Diagnostic| {
                            let mut found = found.iter();
                            !found.any(|it| (it.line, it.column) == (one.line, one.column))
                        };
                        self.diagnostics.extend(refused.filter(is_new));
                    }
                }
            }
            self.diagnostics.extend(found);
        }
        Ok(())
    }

    /// The errors, which prevent a script from running, without the warnings.
    pub fn errors(&self) -> impl Iterator<Item = &Diagnostic> {
        let is_error = |one: &&Diagnostic| one.severity == Severity::Error;
        self.diagnostics.iter().filter(is_error)
    }
}

/// The file of a module: it has the behaviour's options, but no parameters.
fn of_module(module: ModuleFile, folder: &Path, options: &Options) -> (Vec<u8>, Options, String) {
    let inner = Path::new(&module.file).parent().unwrap_or(Path::new(""));
    let options = Options {
        chunk: folder.join(&module.file).display().to_string(),
        params: Default::default(),
        ..options.clone()
    };
    (module.source, options, inner.display().to_string())
}
