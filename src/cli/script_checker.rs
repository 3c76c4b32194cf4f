//! Checks scripts and the modules that they require, each file once, in a confined process.

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use super::{Exit, Failure};
use crate::behaviour::{Inspected, Inspector, Library};
use crate::check::{Diagnostic, Required};
use crate::script::{ModuleFile, Options};

pub(super) struct ScriptChecker {
    inspector: Inspector,
    seen: BTreeSet<PathBuf>,
    pub(super) diagnostics: Vec<Diagnostic>,
}

struct File {
    source: Vec<u8>,
    options: Options,
    /// Its folder, relative to the behaviour's folder.
    folder: String,
}

impl ScriptChecker {
    pub(super) fn new() -> Result<ScriptChecker, Failure> {
        let inspector = Inspector::of_this_executable()
            .map_err(|error| Failure::io("find this program's own file", error))?;
        Ok(ScriptChecker {
            inspector,
            seen: BTreeSet::new(),
            diagnostics: Vec::new(),
        })
    }

    pub(super) fn count(&self) -> usize {
        self.seen.len()
    }

    /// Checks a behaviour's own file, then its modules.
    pub(super) fn behaviour(&mut self, source: &[u8], options: &Options) -> Result<(), Failure> {
        let folder = Path::new(&options.chunk).parent().unwrap_or(Path::new(""));
        let (folder, library) = (folder.to_owned(), Library::new(folder.to_owned()));
        let mut files = VecDeque::from([File {
            source: source.to_vec(),
            options: options.clone(),
            folder: String::new(),
        }]);
        while let Some(file) = files.pop_front() {
            if !self.is_new(Path::new(&file.options.chunk)) {
                continue;
            }
            let (found, required) = self.file(&file)?;
            for module in required {
                match library.fetch(&module.name) {
                    Ok(module) => files.push_back(of_module(module, &folder, options)),
                    Err(why) => self.missing(&file, &module, &why.to_string(), &found),
                }
            }
            self.diagnostics.extend(found);
        }
        Ok(())
    }

    fn is_new(&mut self, file: &Path) -> bool {
        let file = file.canonicalize().unwrap_or_else(|_| file.to_owned());
        self.seen.insert(file)
    }

    fn file(&mut self, file: &File) -> Result<(Vec<Diagnostic>, Vec<Required>), Failure> {
        let source = file.source.as_slice();
        let chunk = file.options.chunk.as_str();
        let inspected = self.inspector.inspect(source, &file.options, &file.folder);
        let Inspected {
            diagnostics: mut found,
            required,
        } = inspected.map_err(|why| {
            Failure::new(
                Exit::Check,
                format_args!("{chunk}: cannot be checked: {why}"),
            )
        })?;
        found.sort_by_key(|diagnostic| (diagnostic.line, diagnostic.column));
        Ok((found, required))
    }

    /// Reports a module that exists but is refused, such as one behind a symbolic link. The check
    /// has already reported modules that do not exist.
    fn missing(&mut self, file: &File, module: &Required, why: &str, found: &[Diagnostic]) {
        let chunk = file.options.chunk.as_str();
        let refused = module.refused(&file.source, chunk, why);
        let known = |one: &Diagnostic| {
            let mut found = found.iter();
            found.any(|other| (other.line, other.column) == (one.line, one.column))
        };
        self.diagnostics.extend(refused.filter(|one| !known(one)));
    }
}

/// The file of a module: it has the behaviour's options, but no parameters.
fn of_module(module: ModuleFile, folder: &Path, options: &Options) -> File {
    let inner = Path::new(&module.file).parent().unwrap_or(Path::new(""));
    let inner = inner.display().to_string();
    let chunk = folder.join(&module.file).display().to_string();
    File {
        source: module.source,
        options: Options {
            chunk,
            params: Default::default(),
            ..options.clone()
        },
        folder: inner,
    }
}
