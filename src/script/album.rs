//! The data folder: pictures that a script saves. Names cannot leave the folder, and what it holds
//! is bounded.

use std::fs::{self, DirBuilder, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

/// What a file counts as at least, in bytes: folders full of tiny files are full too.
const LEAST: u64 = 4096;

/// Why a picture was not saved.
#[derive(Debug)]
pub(super) enum NotSaved {
    /// The folder would hold more than it may.
    Quota,
    /// The system's reason.
    Io(io::Error),
}

impl From<io::Error> for NotSaved {
    fn from(error: io::Error) -> NotSaved {
        NotSaved::Io(error)
    }
}

/// See the module.
#[derive(Debug)]
pub(super) struct Album {
    folder: Option<PathBuf>,
    quota: u64,
    /// What the folder holds, once that was counted.
    used: Option<u64>,
}

impl Album {
    /// `None`: nothing can be saved.
    pub(super) fn new(folder: Option<PathBuf>, quota: u64) -> Album {
        Album {
            folder,
            quota,
            used: None,
        }
    }

    /// Writes a file, in the place of one of the same name.
    pub(super) fn save(&mut self, name: &str, bytes: &[u8]) -> Result<PathBuf, NotSaved> {
        let Some(folder) = &self.folder else {
            return Err(io::Error::other("there is no data folder").into());
        };
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)?;
        let used = match self.used {
            Some(used) => used,
            None => size_of_all(folder)?,
        };
        let path = folder.join(name);
        let before = fs::symlink_metadata(&path).map_or(0, |file| weight(file.len()));
        let after = used.saturating_sub(before) + weight(bytes.len() as u64);
        if after > self.quota {
            self.used = Some(used);
            return Err(NotSaved::Quota);
        }
        write_privately(folder, &path, bytes)?;
        self.used = Some(after);
        Ok(path)
    }
}

/// What names of pictures look like.
pub(crate) const NAMES: &str =
    "the name may have letters, digits, '-', '_' and '.', and not begin with '.'";

/// The file's name, `.jpg` behind it unless it has an ending; `None` if it could leave the folder or
/// trouble a shell.
pub(crate) fn file_name(name: &str) -> Option<String> {
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if name.is_empty() || name.starts_with(['.', '-']) || !name.chars().all(plain) {
        return None;
    }
    let has_ending = name.to_ascii_lowercase().ends_with(".jpg");
    Some(if has_ending {
        name.to_owned()
    } else {
        format!("{name}.jpg")
    })
}

fn weight(bytes: u64) -> u64 {
    bytes.max(LEAST)
}

fn size_of_all(folder: &Path) -> io::Result<u64> {
    let mut sum = 0;
    for entry in fs::read_dir(folder)? {
        sum += weight(entry?.metadata()?.len());
    }
    Ok(sum)
}

/// All of a file in this folder or none of it, readable by its owner only.
pub(crate) fn write_privately(folder: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let unfinished = folder.join(".unfinished");
    let _ = fs::remove_file(&unfinished);
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(&unfinished)?;
    file.write_all(bytes)?;
    fs::rename(unfinished, path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn names_stay_in_the_folder() {
        assert_eq!(file_name("ball").as_deref(), Some("ball.jpg"));
        assert_eq!(file_name("ball-1.JPG").as_deref(), Some("ball-1.JPG"));
        for name in [
            "", ".", "..", "../x", "a/b", "a\\b", "-x", ".x", "a b", "ä", "a\0",
        ] {
            assert_eq!(file_name(name), None, "{name:?}");
        }
    }

    #[test]
    fn the_folder_is_bounded_and_private() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("data");
        let mut album = Album::new(Some(folder.clone()), 3 * LEAST);
        for name in ["a.jpg", "b.jpg", "a.jpg", "c.jpg"] {
            album.save(name, &[1, 2, 3]).unwrap();
        }
        assert!(matches!(album.save("d.jpg", &[1]), Err(NotSaved::Quota)));
        let mut again = Album::new(Some(folder.clone()), 3 * LEAST);
        assert!(matches!(again.save("d.jpg", &[1]), Err(NotSaved::Quota)));
        let path = again.save("b.jpg", &[9]).unwrap();
        assert_eq!(fs::read(&path).unwrap(), [9]);
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!((mode(&path), mode(&folder)), (0o600, 0o700));
    }

    #[test]
    fn without_a_folder_nothing_is_saved() {
        let result = Album::new(None, 1000).save("a.jpg", &[1]);
        assert!(matches!(result, Err(NotSaved::Io(_))));
    }
}
