//! Finds scenario files: the named files, and all `*_test.lua` in named folders.

use std::path::{Path, PathBuf};

use super::super::Failure;

/// Maximum depth of nested folders.
const MAX_DEPTH: u32 = 16;

/// Collects a file as it is, and all scenario files of a folder in alphabetical order. Skips hidden
/// folders, `target` folders and symbolic links to folders.
///
/// # Errors
/// A path that does not exist or cannot be read.
pub(super) fn collect(path: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let cannot = |error| Failure::unreadable(path, error);
    if std::fs::metadata(path).map_err(cannot)?.is_dir() {
        search(path, 0, files)
    } else {
        files.push(path.to_owned());
        Ok(())
    }
}

fn search(folder: &Path, depth: u32, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let cannot = |error| Failure::unreadable(folder, error);
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(cannot)? {
        paths.push(entry.map_err(cannot)?.path());
    }
    paths.sort();
    for path in paths {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() {
            let skipped = name.starts_with('.') || name == "target" || path.is_symlink();
            if !skipped && depth < MAX_DEPTH {
                search(&path, depth + 1, files)?;
            }
        } else if name.ends_with("_test.lua") {
            // Without `./`, as people would write it.
            let shown = path.strip_prefix("./").map(Path::to_owned);
            files.push(shown.unwrap_or(path));
        }
    }
    Ok(())
}
