//! Untrusted files and folders. Reads only regular files of bounded length: a pipe, a device or a
//! folder instead is an error and never blocks. Writes stay within one opened folder and follow no
//! symbolic link in it.

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

/// Unfinished files begin so; what a run that was killed has left of them is swept away.
const UNFINISHED: &str = ".unfinished";
/// What is read from a folder at most, in names.
const MAX_NAMES: usize = 100_000;

/// Why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The system says so.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// It is something else, such as a folder or a pipe.
    #[error("it is {0}, not a file")]
    NoFile(&'static str),
    /// Longer than is read.
    #[error("it is longer than {most} bytes")]
    TooLong {
        /// What is read at most.
        most: u64,
    },
    /// Bytes that are no UTF-8.
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

/// All bytes of a regular file of at most `most` bytes. Never waits for anything but the disk.
///
/// # Errors
/// See [`ReadError`].
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    content(open(CWD, path, OFlags::empty())?, most)
}

/// The beginning of a regular file, at most `most` bytes of it.
///
/// # Errors
/// See [`ReadError`].
pub fn read_beginning(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    beginning(open(CWD, path, OFlags::empty())?, most)
}

/// As [`read`], of a text.
///
/// # Errors
/// See [`ReadError`].
pub fn read_text(path: &Path, most: u64) -> Result<String, ReadError> {
    String::from_utf8(read(path, most)?).map_err(|_| ReadError::NoText)
}

/// The content of a file that others may not read, nor write: it belongs to this user, and its mode
/// gives nothing to the group or others. Not through a symbolic link.
///
/// # Errors
/// See [`ReadError`]; a file that others can read is one of them.
pub fn read_private(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    let file = open(CWD, path, OFlags::NOFOLLOW).map_err(|error| match error {
        ReadError::Io(error) if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => {
            ReadError::NoFile("a symbolic link")
        }
        error => error,
    })?;
    let stat = fstat(&file)?;
    let others = Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO);
    if others || stat.st_uid != rustix::process::geteuid().as_raw() {
        let words = "others can read it; it must be its owner's alone: chmod 600";
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, words).into());
    }
    content(file, most)
}

/// Whether the group or others may read or change this file.
pub fn is_shared(path: &Path) -> bool {
    let Ok(stat) = statat(CWD, path, AtFlags::empty()) else {
        return false;
    };
    Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO)
}

/// Opened without waiting for the other end of a pipe, and without becoming a terminal's program.
fn open(
    at: impl std::os::fd::AsFd,
    path: impl rustix::path::Arg,
    more: OFlags,
) -> Result<OwnedFd, ReadError> {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC | more;
    Ok(openat(at, path, flags, Mode::empty())?)
}

fn content(file: OwnedFd, most: u64) -> Result<Vec<u8>, ReadError> {
    // One byte more: a file may grow while it is read.
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

/// What something is that is no regular file.
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

/// A folder that is open. What is done in it stays in it, whatever changes on the disk meanwhile.
#[derive(Debug)]
pub struct Folder(OwnedFd);

/// A regular file in a folder.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Item {
    /// When it was written last: seconds of the epoch and nanoseconds.
    pub written: (i64, i64),
    /// Its name.
    pub name: String,
    /// Its length.
    pub bytes: u64,
}

impl Folder {
    /// Makes a folder, and those above it, for this user alone; one that is there stays as it is.
    ///
    /// # Errors
    /// Whatever the system says; a symbolic link in its place.
    pub fn make(path: &Path) -> io::Result<Folder> {
        match Folder::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                DirBuilder::new().recursive(true).mode(0o700).create(path)?;
                Folder::open(path)
            }
            opened => opened,
        }
    }

    /// Opens a folder that is there.
    ///
    /// # Errors
    /// Whatever the system says; a symbolic link in its place.
    pub fn open(path: &Path) -> io::Result<Folder> {
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        match openat(CWD, path, flags, Mode::empty()) {
            Ok(folder) => Ok(Folder(folder)),
            Err(Errno::LOOP | Errno::NOTDIR) if is_link(path) => Err(io::Error::other(format!(
                "{} is a symbolic link: it could lead anywhere, so nothing is kept there",
                path.display()
            ))),
            Err(error) => Err(error.into()),
        }
    }

    /// The content of a regular file of at most `most` bytes; `None` if there is none of this name.
    ///
    /// # Errors
    /// See [`ReadError`].
    pub fn read(&self, name: &str, most: u64) -> Result<Option<Vec<u8>>, ReadError> {
        match open(&self.0, name, OFlags::NOFOLLOW) {
            Ok(file) => content(file, most).map(Some),
            Err(ReadError::Io(error)) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(ReadError::Io(error))
                if error.raw_os_error() == Some(Errno::LOOP.raw_os_error()) =>
            {
                Err(ReadError::NoFile("a symbolic link"))
            }
            Err(error) => Err(error),
        }
    }

    /// All of the new content under this name, or still what was there; readable by this user only.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn replace(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.put(name, bytes, false)
    }

    /// As [`Folder::replace`], and on the disk when it returns.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn replace_durably(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.put(name, bytes, true)
    }

    fn put(&self, name: &str, bytes: &[u8], durably: bool) -> io::Result<()> {
        let unfinished = format!("{UNFINISHED}-{name}");
        let _ = self.remove(&unfinished);
        let flags =
            OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let file = openat(&self.0, &*unfinished, flags, Mode::RUSR | Mode::WUSR)?;
        let mut file = File::from(file);
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

    /// Gives a file another name, in the place of one that has it.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        Ok(renameat(&self.0, from, &self.0, to)?)
    }

    /// Removes a file; a symbolic link itself, not what it leads to.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn remove(&self, name: &str) -> io::Result<()> {
        Ok(unlinkat(&self.0, name, AtFlags::empty())?)
    }

    /// Its regular files.
    ///
    /// # Errors
    /// Whatever the system says.
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

    /// One of its regular files; `None` if there is none of this name.
    ///
    /// # Errors
    /// Whatever the system says.
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

    /// Removes what runs that were killed have left unfinished.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn sweep(&self, beginning: &str) -> io::Result<()> {
        for item in self.items()? {
            if item.name.starts_with(UNFINISHED) || item.name.starts_with(beginning) {
                self.remove(&item.name)?;
            }
        }
        Ok(())
    }

    /// Bytes that this user can still write to its disk.
    ///
    /// # Errors
    /// Whatever the system says.
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
