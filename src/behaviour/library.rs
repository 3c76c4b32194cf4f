//! Finds the files for `require` in the folder of one behaviour's script. The agent reads them: a
//! host sends a module name and gets text; it has no right to open files there itself. Nothing
//! outside the folder can be reached: see [`Folder`].

use std::collections::BTreeSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parking_lot::Mutex;

use crate::files::{Folder, ReadError};
use crate::script::{MAX_SOURCE, ModuleFile, ModuleName, NoModule};
use crate::yaml::suggestion;

const ENDINGS: [&str; 2] = [".lua", ".luau"];

/// Reads the modules of one behaviour. Clones share the same state.
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

    /// Serves the modules in the folder of this script and below.
    pub fn beside(script: &Path) -> Library {
        Library::new(script.parent().unwrap_or(Path::new("")).to_owned())
    }

    /// Returns every file read so far.
    pub fn files(&self) -> Vec<PathBuf> {
        let files = self.files.lock();
        files.iter().cloned().collect()
    }

    /// Reads a module. Blocks on disk access.
    pub fn fetch(&self, name: &ModuleName) -> Result<ModuleFile, NoModule> {
        let Some(root) = &self.folder else {
            let words = "this behaviour has no folder to load modules from";
            return Err(NoModule(words.to_owned()));
        };
        let root = if root.as_os_str().is_empty() {
            Path::new(".")
        } else {
            root
        };
        let mut path: Vec<&str> = name.segments().collect();
        let Some(last) = path.pop() else {
            return Err(NoModule("a module needs a name".to_owned()));
        };
        let refused = |what| NoModule(format!("module '{}'{what}", name.as_str()));
        let open = Folder::open_linked(root);
        let mut folder =
            open.map_err(|error| NoModule(format!("cannot open {}: {error}", root.display())))?;
        for segment in &path {
            folder = enter(&folder, segment).map_err(refused)?;
        }
        let (file, source) = read(&folder, last).map_err(refused)?;
        path.push(&file);
        let file = path.join("/");
        let mut files = self.files.lock();
        files.insert(root.join(&file));
        Ok(ModuleFile { file, source })
    }
}

/// Opens a subfolder. The error continues the sentence "module 'name'".
fn enter(folder: &Folder, name: &str) -> Result<Folder, String> {
    let name = find(folder, name, &[""])?;
    folder.folder(&name).map_err(|error| match error.kind() {
        ErrorKind::NotADirectory => is_link(&name),
        _ => format!(": cannot open {name}: {error}"),
    })
}

/// Reads a module's file: its name, and at most one byte more than a module may have, so that a
/// longer one can be reported as too long. The error continues the sentence "module 'name'".
fn read(folder: &Folder, name: &str) -> Result<(String, Vec<u8>), String> {
    let name = find(folder, name, &ENDINGS)?;
    match folder.read_beginning(&name, MAX_SOURCE as u64 + 1) {
        Ok(source) => Ok((name, source)),
        Err(ReadError::NoFile("a symbolic link")) => Err(is_link(&name)),
        Err(ReadError::NoFile(_)) => Err(format!(": {name} is not a file")),
        Err(error) => Err(format!(": cannot read {name}: {error}")),
    }
}

/// Returns the name in the folder that is `wanted` plus one of the endings. The comparison is
/// case-sensitive even if the file system is not.
fn find(folder: &Folder, wanted: &str, endings: &[&str]) -> Result<String, String> {
    let names = folder
        .names()
        .map_err(|error| format!(": cannot list its folder: {error}"))?;
    let mut found: Vec<String> = endings
        .iter()
        .map(|ending| format!("{wanted}{ending}"))
        .filter(|name| names.contains(name))
        .collect();
    if found.len() > 1 {
        return Err(format!(
            ": there are {}; keep one of them",
            found.join(" and ")
        ));
    }
    found.pop().ok_or_else(|| missing(&names, wanted))
}

fn missing(names: &BTreeSet<String>, wanted: &str) -> String {
    let hint = if names.contains(wanted) {
        "; it is a folder: name a file in it".to_owned()
    } else {
        let stems = names.iter().map(|name| {
            let stem = ENDINGS.iter().find_map(|ending| name.strip_suffix(ending));
            stem.unwrap_or(name)
        });
        suggestion(wanted, stems)
    };
    format!(" was not found in the behaviour's folder: there is no {wanted}.lua{hint}")
}

fn is_link(name: &str) -> String {
    format!(
        ": {name} is a symbolic link or not a folder; modules must be files in the behaviour's own \
         folder"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::fs::{CWD, Mode, mkfifoat};
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
        mkfifoat(CWD, folder.join("pipe.lua"), Mode::RUSR).unwrap();
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
