//! Access to untrusted files and folders. Reads only regular files of bounded length: a pipe, a
//! device or a folder is an error and never blocks. Writes stay within one opened folder and follow
//! no symbolic link in it.

use std::fs::{DirBuilder, File};
use std::io::{self, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::Path;

use rustix::fs::{
    AtFlags, CWD, Dir, FileType, Mode, OFlags, Stat, fstat, fstatvfs, fsync, openat, renameat,
    statat, unlinkat,
};
use rustix::io::Errno;

/// Prefix of unfinished files; those left behind by a killed run are removed later.
const UNFINISHED: &str = ".unfinished";
/// Maximum number of folder entries that are read.
const MAX_NAMES: usize = 100_000;

/// Why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// An error of the system.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It is something else, such as a folder or a pipe.
    #[error("it is {0}, not a file")]
    NoFile(&'static str),
    /// The file is longer than the limit.
    #[error("it is longer than {most} bytes")]
    TooLong {
        /// The limit.
        most: u64,
    },
    /// The content is not UTF-8.
    #[error("it is not UTF-8")]
    NoText,
}

impl From<Errno> for ReadError {
    fn from(error: Errno) -> ReadError {
        ReadError::Io(error.into())
    }
}

impl From<ReadError> for io::Error {
    fn from(error: ReadError) -> io::Error {
        match error {
            ReadError::Io(error) => error,
            other => io::Error::new(io::ErrorKind::InvalidData, other.to_string()),
        }
    }
}

/// Reads a regular file of at most `most` bytes. Blocks on nothing but the disk.
///
/// # Errors
/// See [`ReadError`].
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    content(open(CWD, path, OFlags::empty())?, most)
}

/// Reads the beginning of a regular file, at most `most` bytes.
///
/// # Errors
/// See [`ReadError`].
pub fn read_beginning(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    beginning(open(CWD, path, OFlags::empty())?, most)
}

/// Same as [`read_beginning`], but does not follow a symbolic link.
///
/// # Errors
/// See [`ReadError`]; also a symbolic link in its place.
pub fn read_beginning_unlinked(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    beginning(open_unlinked(CWD, path)?, most)
}

/// Same as [`read`], for a text.
///
/// # Errors
/// See [`ReadError`].
pub fn read_text(path: &Path, most: u64) -> Result<String, ReadError> {
    String::from_utf8(read(path, most)?).map_err(|_| ReadError::NoText)
}

/// Reads a private file: it must belong to this user, with no access for the group or others. Does
/// not follow a symbolic link.
///
/// # Errors
/// See [`ReadError`]; also if other users have access to the file.
pub fn read_private(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    let file = open_unlinked(CWD, path)?;
    let stat = fstat(&file)?;
    let others = Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO);
    if others || stat.st_uid != rustix::process::geteuid().as_raw() {
        let words = "other users can read it; only its owner may have access: chmod 600";
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, words).into());
    }
    content(file, most)
}

/// Whether the group or others have access to this file.
pub fn is_shared(path: &Path) -> bool {
    let Ok(stat) = statat(CWD, path, AtFlags::empty()) else {
        return false;
    };
    Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO)
}

/// Opens a file without waiting for the other end of a pipe, and without acquiring a controlling
/// terminal.
fn open(
    at: impl std::os::fd::AsFd,
    path: impl rustix::path::Arg,
    more: OFlags,
) -> Result<OwnedFd, ReadError> {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC | more;
    Ok(openat(at, path, flags, Mode::empty())?)
}

/// Same as [`open`], but does not follow a symbolic link.
fn open_unlinked(
    at: impl std::os::fd::AsFd,
    path: impl rustix::path::Arg,
) -> Result<OwnedFd, ReadError> {
    open(at, path, OFlags::NOFOLLOW).map_err(|error| match error {
        ReadError::Io(error) if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => {
            ReadError::NoFile("a symbolic link")
        }
        error => error,
    })
}

fn content(file: OwnedFd, most: u64) -> Result<Vec<u8>, ReadError> {
    // Read one byte more: the file may grow while it is read.
    let bytes = beginning(file, most.saturating_add(1))?;
    if bytes.len() as u64 > most {
        Err(ReadError::TooLong { most })
    } else {
        Ok(bytes)
    }
}

fn beginning(file: OwnedFd, most: u64) -> Result<Vec<u8>, ReadError> {
    let stat = fstat(&file)?;
    if let Some(kind) = no_file(&stat) {
        return Err(ReadError::NoFile(kind));
    }
    let mut bytes = Vec::new();
    File::from(file).take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Names the type of something that is not a regular file; `None` for a regular file.
fn no_file(stat: &Stat) -> Option<&'static str> {
    Some(match FileType::from_raw_mode(stat.st_mode) {
        FileType::RegularFile => return None,
        FileType::Directory => "a folder",
        FileType::Fifo => "a pipe",
        FileType::Socket => "a socket",
        FileType::Symlink => "a symbolic link",
        FileType::CharacterDevice | FileType::BlockDevice => "a device",
        _ => "something else",
    })
}

/// An open folder. All operations stay within it, whatever changes on the disk meanwhile.
#[derive(Debug)]
pub struct Folder(OwnedFd);

/// A regular file in a folder.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Item {
    /// Time of the last write: seconds since the epoch, and nanoseconds.
    pub written: (i64, i64),
    /// Its name.
    pub name: String,
    /// Its length in bytes.
    pub bytes: u64,
}

impl Folder {
    /// Opens a folder; creates it and its parents, with access for this user only, if it does not
    /// exist.
    ///
    /// # Errors
    /// Any error of the system; a symbolic link in its place.
    pub fn make(path: &Path) -> io::Result<Folder> {
        match Folder::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                DirBuilder::new().recursive(true).mode(0o700).create(path)?;
                Folder::open(path)
            }
            opened => opened,
        }
    }

    /// Opens an existing folder.
    ///
    /// # Errors
    /// Any error of the system; a symbolic link in its place.
    pub fn open(path: &Path) -> io::Result<Folder> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        match openat(CWD, path, flags, Mode::empty()) {
            Ok(folder) => Ok(Folder(folder)),
            Err(Errno::LOOP | Errno::NOTDIR) if is_link(path) => Err(io::Error::other(format!(
                "{} is a symbolic link: it could point anywhere, so nothing is stored there",
                path.display()
            ))),
            Err(error) => Err(error.into()),
        }
    }

    /// Reads a regular file of at most `most` bytes; `None` if there is none of this name.
    ///
    /// # Errors
    /// See [`ReadError`].
    pub fn read(&self, name: &str, most: u64) -> Result<Option<Vec<u8>>, ReadError> {
        match open_unlinked(&self.0, name) {
            Ok(file) => content(file, most).map(Some),
            Err(ReadError::Io(error)) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Creates an empty file, with access for this user only, unless something of this name exists.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn create(&self, name: &str) -> io::Result<()> {
        match self.create_new(name) {
            Ok(_) | Err(Errno::EXIST) => Ok(()),
            Err(error) => Err(error.into()),
        }
    }

    fn create_new(&self, name: &str) -> Result<OwnedFd, Errno> {
        let flags =
            OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        openat(&self.0, name, flags, Mode::RUSR | Mode::WUSR)
    }

    /// Replaces a file atomically: it holds either all of the new content or all of the old. Only
    /// this user has access to it.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn replace(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.put(name, bytes, false)
    }

    /// Same as [`Folder::replace`], and the content is on the disk when it returns.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn replace_durably(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.put(name, bytes, true)
    }

    fn put(&self, name: &str, bytes: &[u8], durably: bool) -> io::Result<()> {
        let unfinished = format!("{UNFINISHED}-{name}");
        let _ = self.remove(&unfinished);
        let mut file = File::from(self.create_new(&unfinished)?);
        let written = file
            .write_all(bytes)
            .and_then(|()| if durably { file.sync_all() } else { Ok(()) });
        let named = written.and_then(|()| Ok(renameat(&self.0, &*unfinished, &self.0, name)?));
        if named.is_err() {
            let _ = self.remove(&unfinished);
        }
        named?;
        if durably { Ok(fsync(&self.0)?) } else { Ok(()) }
    }

    /// Renames a file, replacing a file of the new name.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        Ok(renameat(&self.0, from, &self.0, to)?)
    }

    /// Removes a file; of a symbolic link, the link itself, not its target.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn remove(&self, name: &str) -> io::Result<()> {
        Ok(unlinkat(&self.0, name, AtFlags::empty())?)
    }

    /// Lists its regular files.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn items(&self) -> io::Result<Vec<Item>> {
        let mut items = Vec::new();
        for entry in Dir::read_from(&self.0)?.take(MAX_NAMES) {
            let entry = entry?;
            let Ok(name) = entry.file_name().to_str() else {
                continue;
            };
            items.extend(self.item(name)?);
        }
        Ok(items)
    }

    /// Returns one of its regular files; `None` if there is none of this name.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn item(&self, name: &str) -> io::Result<Option<Item>> {
        let stat = match statat(&self.0, name, AtFlags::SYMLINK_NOFOLLOW) {
            Err(Errno::NOENT) => return Ok(None),
            stat => stat?,
        };
        Ok(no_file(&stat).is_none().then(|| Item {
            written: (
                stat.st_mtime,
                i64::try_from(stat.st_mtime_nsec).unwrap_or(0),
            ),
            name: name.to_owned(),
            bytes: u64::try_from(stat.st_size).unwrap_or(0),
        }))
    }

    /// Removes the unfinished files of killed runs, and files whose names start with `beginning`.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn sweep(&self, beginning: &str) -> io::Result<()> {
        for item in self.items()? {
            if item.name.starts_with(UNFINISHED) || item.name.starts_with(beginning) {
                self.remove(&item.name)?;
            }
        }
        Ok(())
    }

    /// Returns the number of bytes that this user can still write to its disk.
    ///
    /// # Errors
    /// Any error of the system.
    pub fn free(&self) -> io::Result<u64> {
        let disk = fstatvfs(&self.0)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }
}

fn is_link(path: &Path) -> bool {
    path.symlink_metadata()
        .is_ok_and(|about| about.is_symlink())
}

#[cfg(test)]
mod tests;
