//! Finds the files for `require` in the folder of one behaviour's script. The agent reads them: a
//! host sends a module name and gets text; it has no right to open files there itself.
//!
//! A path is walked component by component. Each is opened relative to the folder before it, and
//! symbolic links are not followed, so that nothing outside can be reached even if the disk changes
//! meanwhile.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read as _};
use std::os::fd::OwnedFd;
use std::os::unix::ffi::OsStringExt as _;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use rustix::fs::{CWD, Dir, FileType, Mode, OFlags, fstat, openat};
use rustix::io::Errno;

use crate::script::{MAX_SOURCE, ModuleFile, ModuleName, suggestion};

/// Extensions of module files.
const ENDINGS: [&str; 2] = [".lua", ".luau"];
/// Maximum number of folder entries that are read.
const MAX_NAMES: usize = 10_000;

/// Why a module cannot be loaded, in words for the script's author.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// There is no folder to look in.
    #[error("this behaviour has no folder to load modules from")]
    NoFolder,
    /// The name is empty.
    #[error("a module needs a name")]
    NoName,
    /// The behaviour's folder cannot be opened.
    #[error("cannot open {}: {source}", .folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Why.
        source: Errno,
    },
    /// There is no such file.
    #[error(
        "module '{module}' was not found in the behaviour's folder: there is no {wanted}.lua{hint}"
    )]
    Missing {
        /// The module's name, as the script wrote it.
        module: String,
        /// The part of it that is missing.
        wanted: String,
        /// What was probably meant; may be empty.
        hint: String,
    },
    /// Several files have this name.
    #[error("module '{module}': there are {}; keep one of them", .files.join(" and "))]
    Ambiguous {
        /// The module's name, as the script wrote it.
        module: String,
        /// Their names.
        files: Vec<String>,
    },
    /// A component is a symbolic link, which is not followed, or is not a folder.
    #[error(
        "module '{module}': {name} is a symbolic link or not a folder; modules must be files in the \
         behaviour's own folder"
    )]
    Link {
        /// The module's name, as the script wrote it.
        module: String,
        /// The link.
        name: String,
    },
    /// The name belongs to something else, such as a folder or a pipe.
    #[error("module '{module}': {name} is not a file")]
    NotAFile {
        /// The module's name, as the script wrote it.
        module: String,
        /// The name of what is not a file.
        name: String,
    },
    /// A file or folder cannot be opened or read.
    #[error("module '{module}': cannot {verb} {name}: {source}")]
    Io {
        /// The module's name, as the script wrote it.
        module: String,
        /// What failed: `open`, `list` or `read`.
        verb: &'static str,
        /// The file or folder.
        name: String,
        /// Why.
        source: io::Error,
    },
}

/// See the module. Clones share the same state.
#[derive(Debug, Clone, Default)]
pub struct Library {
    folder: Option<PathBuf>,
    files: Arc<Mutex<BTreeSet<PathBuf>>>,
}

impl Library {
    /// Serves the modules in this folder and below.
    pub fn new(folder: PathBuf) -> Library {
        Library {
            folder: Some(folder),
            files: Arc::default(),
        }
    }

    /// Returns every file read so far.
    pub fn files(&self) -> Vec<PathBuf> {
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.iter().cloned().collect()
    }

    /// Reads a module. Blocks on disk access.
    ///
    /// # Errors
    /// See [`LibraryError`].
    pub fn fetch(&self, name: &ModuleName) -> Result<ModuleFile, LibraryError> {
        let Some(folder) = &self.folder else {
            return Err(LibraryError::NoFolder);
        };
        let folder = if folder.as_os_str().is_empty() {
            PathBuf::from(".")
        } else {
            folder.clone()
        };
        let mut segments: Vec<&str> = name.segments().collect();
        let Some(last) = segments.pop() else {
            return Err(LibraryError::NoName);
        };
        let shown = name.as_str();
        let mut at = openat(CWD, &folder, folder_flags(), Mode::empty()).map_err(|source| {
            let folder = folder.clone();
            LibraryError::Folder { folder, source }
        })?;
        for segment in &segments {
            at = enter(&at, segment, shown)?;
        }
        let found = find(&at, last, shown)?;
        let source = read(&at, &found, shown)?;
        let file = segments
            .iter()
            .chain([&&*found])
            .copied()
            .collect::<Vec<_>>();
        let file = file.join("/");
        let mut files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.insert(folder.join(&file));
        Ok(ModuleFile { file, source })
    }
}

fn folder_flags() -> OFlags {
    OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC
}

/// Opens a subfolder, unless it is a symbolic link.
fn enter(at: &OwnedFd, segment: &str, shown: &str) -> Result<OwnedFd, LibraryError> {
    let near = exact(at, segment, &[""], shown)?;
    let Some(segment) = near else {
        return Err(missing(at, segment, shown));
    };
    let flags = folder_flags() | OFlags::NOFOLLOW;
    openat(at, &*segment, flags, Mode::empty()).map_err(|error| refused(&segment, shown, error))
}

/// Returns the module's file name, with its extension.
fn find(at: &OwnedFd, last: &str, shown: &str) -> Result<String, LibraryError> {
    exact(at, last, &ENDINGS, shown)?.ok_or_else(|| missing(at, last, shown))
}

/// Returns the folder entry that is `wanted` plus one of the endings. The comparison is
/// case-sensitive even if the file system is not.
fn exact(
    at: &OwnedFd,
    wanted: &str,
    endings: &[&str],
    shown: &str,
) -> Result<Option<String>, LibraryError> {
    let names = names(at).map_err(|source| failed(shown, "list", "its folder", source))?;
    let mut found: Vec<String> = endings
        .iter()
        .map(|ending| format!("{wanted}{ending}"))
        .filter(|name| names.contains(name))
        .collect();
    if found.len() > 1 {
        let module = shown.to_owned();
        Err(LibraryError::Ambiguous {
            module,
            files: found,
        })
    } else {
        Ok(found.pop())
    }
}

fn names(at: &OwnedFd) -> io::Result<BTreeSet<String>> {
    let mut names = BTreeSet::new();
    for entry in Dir::read_from(at)?.take(MAX_NAMES) {
        let name = OsString::from_vec(entry?.file_name().to_bytes().to_vec());
        names.extend(name.into_string());
    }
    Ok(names)
}

fn missing(at: &OwnedFd, wanted: &str, shown: &str) -> LibraryError {
    let names = names(at).unwrap_or_default();
    let is_folder = names.contains(wanted);
    let stems = names.iter().map(|name| {
        let stem = ENDINGS.iter().find_map(|ending| name.strip_suffix(ending));
        stem.unwrap_or(name)
    });
    let hint = if is_folder {
        "; it is a folder: name a file in it".to_owned()
    } else {
        suggestion(wanted, stems)
    };
    LibraryError::Missing {
        module: shown.to_owned(),
        wanted: wanted.to_owned(),
        hint,
    }
}

fn refused(name: &str, shown: &str, error: Errno) -> LibraryError {
    match error {
        Errno::LOOP | Errno::NOTDIR => LibraryError::Link {
            module: shown.to_owned(),
            name: name.to_owned(),
        },
        error => failed(shown, "open", name, error.into()),
    }
}

fn failed(shown: &str, verb: &'static str, name: &str, source: io::Error) -> LibraryError {
    LibraryError::Io {
        module: shown.to_owned(),
        verb,
        name: name.to_owned(),
        source,
    }
}

/// Reads at most one byte more than a module may have, so that a longer one can be reported as too
/// long.
fn read(at: &OwnedFd, name: &str, shown: &str) -> Result<Vec<u8>, LibraryError> {
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = openat(at, name, flags | OFlags::NOCTTY, Mode::empty());
    let file = file.map_err(|error| refused(name, shown, error))?;
    let cannot = |source: io::Error| failed(shown, "read", name, source);
    let stat = fstat(&file).map_err(|error| cannot(error.into()))?;
    if FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile {
        return Err(LibraryError::NotAFile {
            module: shown.to_owned(),
            name: name.to_owned(),
        });
    }
    let mut source = Vec::new();
    File::from(file)
        .take(MAX_SOURCE as u64 + 1)
        .read_to_end(&mut source)
        .map_err(cannot)?;
    Ok(source)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    fn fetch(library: &Library, name: &str) -> Result<ModuleFile, String> {
        let file = library.fetch(&name.to_owned().try_into().unwrap());
        file.map_err(|error| error.to_string())
    }

    #[test]
    fn files_in_the_folder_are_read_and_listed() {
        let root = tempfile::tempdir().unwrap();
        fs::create_dir(root.path().join("lib")).unwrap();
        fs::write(root.path().join("lib/pid.luau"), "return 1").unwrap();
        let library = Library::new(root.path().to_owned());
        let module = fetch(&library, "lib/pid").unwrap();
        assert_eq!(
            (&*module.file, &*module.source),
            ("lib/pid.luau", &b"return 1"[..])
        );
        assert_eq!(library.clone().files(), [root.path().join("lib/pid.luau")]);
    }

    #[test]
    fn files_outside_the_folder_are_not_reachable() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("behaviours");
        fs::create_dir_all(folder.join("real")).unwrap();
        fs::write(root.path().join("secret.lua"), "return 'secret'").unwrap();
        symlink(root.path(), folder.join("up")).unwrap();
        symlink(root.path().join("secret.lua"), folder.join("link.lua")).unwrap();
        symlink("real", folder.join("inside")).unwrap();
        fs::write(folder.join("real/x.lua"), "return 1").unwrap();
        let library = Library::new(folder);
        for name in ["up/secret", "link", "inside/x"] {
            let words = fetch(&library, name).unwrap_err();
            assert!(words.contains("symbolic link"), "{words}");
        }
        assert!(library.files().is_empty());
    }

    #[test]
    fn errors_name_the_problem() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path();
        fs::write(folder.join("pid.lua"), "").unwrap();
        fs::write(folder.join("both.lua"), "").unwrap();
        fs::write(folder.join("both.luau"), "").unwrap();
        fs::create_dir(folder.join("lib")).unwrap();
        fs::create_dir(folder.join("dir.lua")).unwrap();
        rustix::fs::mkfifoat(CWD, folder.join("pipe.lua"), Mode::RUSR).unwrap();
        let library = Library::new(folder.to_owned());
        for (name, words) in [
            ("PID", "did you mean 'pid'?"),
            ("pdi", "did you mean 'pid'?"),
            ("lib", "it is a folder"),
            ("lib/pid", "there is no pid.lua"),
            ("both", "both.lua and both.luau"),
            ("dir", "dir.lua is not a file"),
            ("pipe", "pipe.lua is not a file"),
        ] {
            let said = fetch(&library, name).unwrap_err();
            assert!(said.contains(words), "{name}: {said}");
        }
    }
}
