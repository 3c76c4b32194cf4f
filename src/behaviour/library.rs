//! Where `require` finds files: the folder of one behaviour's script, read by the agent. A host names
//! what it wants and gets text; it has no right to open files there itself.
//!
//! A path is walked name by name, each opened within the folder before it and none of them through
//! a symbolic link, so that nothing outside can be reached, whatever changes on the disk meanwhile.

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

/// A module's file ends so.
const ENDINGS: [&str; 2] = [".lua", ".luau"];
/// Names of a folder that are looked at.
const MAX_NAMES: usize = 10_000;

/// See the module. Clones are the same library.
#[derive(Debug, Clone, Default)]
pub struct Library {
    folder: Option<PathBuf>,
    files: Arc<Mutex<BTreeSet<PathBuf>>>,
}

impl Library {
    /// Of the modules in this folder and below.
    pub fn new(folder: PathBuf) -> Library {
        Library {
            folder: Some(folder),
            files: Arc::default(),
        }
    }

    /// Every file that was read so far.
    pub fn files(&self) -> Vec<PathBuf> {
        let files = self.files.lock().unwrap_or_else(PoisonError::into_inner);
        files.iter().cloned().collect()
    }

    /// Reads a module. Blocks for as long as the disk does.
    ///
    /// # Errors
    /// Why it cannot be had, in words for the script's author.
    pub fn fetch(&self, name: &ModuleName) -> Result<ModuleFile, String> {
        let Some(folder) = &self.folder else {
            return Err("this behaviour has no folder to load modules from".to_owned());
        };
        let folder = if folder.as_os_str().is_empty() {
            PathBuf::from(".")
        } else {
            folder.clone()
        };
        let mut segments: Vec<&str> = name.segments().collect();
        let Some(last) = segments.pop() else {
            return Err("a module needs a name".to_owned());
        };
        let shown = name.as_str();
        let mut at = openat(CWD, &folder, folder_flags(), Mode::empty())
            .map_err(|error| format!("cannot open {}: {error}", folder.display()))?;
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

/// A folder within a folder, which is not a link to elsewhere.
fn enter(at: &OwnedFd, segment: &str, shown: &str) -> Result<OwnedFd, String> {
    let near = exact(at, segment, &[""], shown)?;
    let Some(segment) = near else {
        return Err(missing(at, segment, shown));
    };
    let flags = folder_flags() | OFlags::NOFOLLOW;
    openat(at, &*segment, flags, Mode::empty()).map_err(|error| refused(&segment, shown, error))
}

/// The file's name with its ending.
fn find(at: &OwnedFd, last: &str, shown: &str) -> Result<String, String> {
    exact(at, last, &ENDINGS, shown)?.ok_or_else(|| missing(at, last, shown))
}

/// The one name of the folder that is the wanted one with one of the endings, letter by letter: also
/// where the disk itself does not tell large letters from small ones.
fn exact(
    at: &OwnedFd,
    wanted: &str,
    endings: &[&str],
    shown: &str,
) -> Result<Option<String>, String> {
    let names = names(at).map_err(|error| format!("module '{shown}': {error}"))?;
    let mut found: Vec<String> = endings
        .iter()
        .map(|ending| format!("{wanted}{ending}"))
        .filter(|name| names.contains(name))
        .collect();
    if found.len() > 1 {
        Err(format!(
            "module '{shown}': there are {}; keep one of them",
            found.join(" and ")
        ))
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

fn missing(at: &OwnedFd, wanted: &str, shown: &str) -> String {
    let names = names(at).unwrap_or_default();
    let is_folder = names.contains(wanted);
    let stems = names.iter().map(|name| {
        let stem = ENDINGS.iter().find_map(|ending| name.strip_suffix(ending));
        stem.unwrap_or(name)
    });
    let near = if is_folder {
        "; it is a folder: name a file in it".to_owned()
    } else {
        suggestion(wanted, stems)
    };
    format!(
        "module '{shown}' was not found in the behaviour's folder: there is no {wanted}.lua{near}"
    )
}

fn refused(name: &str, shown: &str, error: Errno) -> String {
    match error {
        Errno::LOOP | Errno::NOTDIR => format!(
            "module '{shown}': {name} is a symbolic link or no folder; modules must be files in the behaviour's own folder"
        ),
        error => format!("module '{shown}': cannot open {name}: {error}"),
    }
}

/// One byte more than a module may have, so that a longer one is told as such.
fn read(at: &OwnedFd, name: &str, shown: &str) -> Result<Vec<u8>, String> {
    let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let file = openat(at, name, flags | OFlags::NOCTTY, Mode::empty());
    let file = file.map_err(|error| refused(name, shown, error))?;
    let cannot = |error: io::Error| format!("module '{shown}': cannot read {name}: {error}");
    let stat = fstat(&file).map_err(|error| cannot(error.into()))?;
    if FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile {
        return Err(format!("module '{shown}': {name} is not a file"));
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
        library.fetch(&name.to_owned().try_into().unwrap())
    }

    #[test]
    fn files_of_the_folder_are_read_and_counted() {
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
    fn nothing_outside_is_reached() {
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
    fn what_is_wrong_is_told() {
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
