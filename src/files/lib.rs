//! Access to untrusted files and folders. Reads only regular files of bounded length: a pipe, a
//! device or a folder is an error and never blocks. An opened [`Folder`] is never left: no symbolic
//! link in it is followed, even if the disk changes meanwhile.
#![cfg_attr(test, allow(clippy::unwrap_used, clippy::expect_used))]

use std::collections::BTreeSet;
use std::fs::{DirBuilder, File};
use std::io::{self, Read as _, Write as _};
use std::os::fd::{AsFd, AsRawFd as _, BorrowedFd, OwnedFd};
use std::os::unix::fs::DirBuilderExt as _;
use std::path::Path;

use rustix::fs::{
    AtFlags, CWD, Dir, FileType, Mode, OFlags, Stat, chmodat, fstat, fstatvfs, fsync, openat,
    renameat, statat, unlinkat,
};
use rustix::io::Errno;
use rustix::path::Arg;

/// Prefix of unfinished files; those left behind by a killed run are removed later.
const UNFINISHED: &str = ".unfinished";
/// Maximum number of folder entries that are read.
const MAX_NAMES: usize = 100_000;

#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    #[error("{0}")]
    Io(#[from] io::Error),
    #[error("it is {0}, not a file")]
    NoFile(&'static str),
    #[error("it is longer than {most} bytes")]
    TooLong { most: u64 },
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
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    whole(open(CWD, path, OFlags::empty())?, most)
}

/// Reads the beginning of a regular file, at most `most` bytes.
pub fn read_beginning(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    beginning(open(CWD, path, OFlags::empty())?, most)
}

/// Same as [`read_beginning`], but refuses a symbolic link.
pub fn read_beginning_unlinked(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    beginning(open(CWD, path, OFlags::NOFOLLOW)?, most)
}

pub fn read_text(path: &Path, most: u64) -> Result<String, ReadError> {
    String::from_utf8(read(path, most)?).map_err(|_| ReadError::NoText)
}

/// Reads a JPEG that a script may have saved; `None` if it no longer exists or is none. No link in its
/// folder is followed.
pub fn read_jpeg(path: &Path, most: u64) -> Option<Vec<u8>> {
    let name = path.file_name()?.to_str()?;
    let read = Folder::open(path.parent()?).ok()?.read(name, most);
    let bytes = read.ok().flatten()?;
    Some(bytes).filter(|bytes| bytes.starts_with(&[0xff, 0xd8]))
}

/// Reads a private file: it must belong to this user, with no access for the group or others.
/// Refuses a symbolic link.
pub fn read_private(path: &Path, most: u64) -> Result<Vec<u8>, ReadError> {
    let file = open(CWD, path, OFlags::NOFOLLOW)?;
    let stat = fstat(&file)?;
    if has_access_for_others(&stat) || stat.st_uid != rustix::process::geteuid().as_raw() {
        let words = "other users can read it; only its owner may have access: chmod 600";
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, words).into());
    }
    whole(file, most)
}

/// Whether the group or others have access to this file.
pub fn is_shared(path: &Path) -> bool {
    statat(CWD, path, AtFlags::empty()).is_ok_and(|stat| has_access_for_others(&stat))
}

fn has_access_for_others(stat: &Stat) -> bool {
    Mode::from_raw_mode(stat.st_mode).intersects(Mode::RWXG | Mode::RWXO)
}

/// Opens a file without waiting for the other end of a pipe, and without acquiring a controlling
/// terminal.
fn open(at: impl AsFd, path: impl Arg, more: OFlags) -> Result<OwnedFd, ReadError> {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::NOCTTY | OFlags::CLOEXEC | more;
    match openat(at, path, flags, Mode::empty()) {
        Err(Errno::LOOP) if more.contains(OFlags::NOFOLLOW) => {
            Err(ReadError::NoFile("a symbolic link"))
        }
        opened => Ok(opened?),
    }
}

fn whole(file: OwnedFd, most: u64) -> Result<Vec<u8>, ReadError> {
    // Read one byte more: the file may grow while it is read.
    let bytes = beginning(file, most.saturating_add(1))?;
    if bytes.len() as u64 > most {
        Err(ReadError::TooLong { most })
    } else {
        Ok(bytes)
    }
}

fn beginning(file: OwnedFd, most: u64) -> Result<Vec<u8>, ReadError> {
    if let Some(kind) = no_file(&fstat(&file)?) {
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

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Item {
    /// Time of the last write: seconds since the epoch, and nanoseconds.
    pub written: (i64, i64),
    pub name: String,
    pub bytes: u64,
}

impl Folder {
    /// Opens a folder; creates it and its parents, with access for this user only, if it does not
    /// exist.
    pub fn make(path: &Path) -> io::Result<Folder> {
        match Folder::open(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                DirBuilder::new().recursive(true).mode(0o700).create(path)?;
                Folder::open(path)
            }
            opened => opened,
        }
    }

    pub fn open(path: &Path) -> io::Result<Folder> {
        match open_folder(CWD, path, OFlags::NOFOLLOW) {
            Err(Errno::LOOP | Errno::NOTDIR) if is_link(path) => Err(io::Error::other(format!(
                "{} is a symbolic link: it could point anywhere, so nothing is stored there",
                path.display()
            ))),
            opened => Ok(Folder(opened?)),
        }
    }

    /// Opens an existing folder to read in it; its own path may be a symbolic link.
    pub fn open_linked(path: &Path) -> io::Result<Folder> {
        Ok(Folder(open_folder(CWD, path, OFlags::empty())?))
    }

    pub fn folder(&self, name: &str) -> io::Result<Folder> {
        match open_folder(&self.0, name, OFlags::NOFOLLOW) {
            Err(Errno::LOOP) => Err(Errno::NOTDIR.into()),
            opened => Ok(Folder(opened?)),
        }
    }

    /// The path of a socket in it, for as long as this is open: its own may be too long for a
    /// socket's address.
    pub fn socket_path(&self, name: &str) -> String {
        format!("/proc/self/fd/{}/{name}", self.0.as_raw_fd())
    }

    /// Binds a socket in it, with access for this user only, in place of one that is left. `bind`
    /// gets its path. Nobody finds a socket that refuses connections meanwhile.
    pub fn bind<Socket>(
        &self,
        name: &str,
        bind: impl FnOnce(&str) -> io::Result<Socket>,
    ) -> io::Result<Socket> {
        let unfinished = format!("{UNFINISHED}-{name}");
        let _ = self.remove(&unfinished);
        let socket = bind(&self.socket_path(&unfinished))?;
        let user = Mode::RUSR | Mode::WUSR;
        let private = chmodat(&self.0, &*unfinished, user, AtFlags::empty());
        self.finish(&unfinished, name, private.map_err(io::Error::from))?;
        Ok(socket)
    }

    /// Gives an unfinished file or socket its name, or removes it if it could not be made.
    fn finish(&self, unfinished: &str, name: &str, made: io::Result<()>) -> io::Result<()> {
        let named = made.and_then(|()| self.rename(unfinished, name));
        if named.is_err() {
            let _ = self.remove(unfinished);
        }
        named
    }

    /// Reads a regular file of at most `most` bytes; `None` if there is none of this name.
    pub fn read(&self, name: &str, most: u64) -> Result<Option<Vec<u8>>, ReadError> {
        match open(&self.0, name, OFlags::NOFOLLOW) {
            Ok(file) => whole(file, most).map(Some),
            Err(ReadError::Io(error)) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error),
        }
    }

    /// Reads the beginning of a regular file, at most `most` bytes.
    pub fn read_beginning(&self, name: &str, most: u64) -> Result<Vec<u8>, ReadError> {
        beginning(open(&self.0, name, OFlags::NOFOLLOW)?, most)
    }

    /// Creates an empty file, with access for this user only, unless something of this name exists.
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
    pub fn replace(&self, name: &str, bytes: &[u8]) -> io::Result<()> {
        self.put(name, bytes, false)
    }

    /// Same as [`Folder::replace`], and the content is on the disk when it returns.
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
        self.finish(&unfinished, name, written)?;
        if durably { Ok(fsync(&self.0)?) } else { Ok(()) }
    }

    /// Waits until the disk has the names in it.
    pub fn sync(&self) -> io::Result<()> {
        Ok(fsync(&self.0)?)
    }

    /// Renames a file, replacing a file of the new name.
    pub fn rename(&self, from: &str, to: &str) -> io::Result<()> {
        Ok(renameat(&self.0, from, &self.0, to)?)
    }

    /// Removes a file; of a symbolic link, the link itself, not its target.
    pub fn remove(&self, name: &str) -> io::Result<()> {
        Ok(unlinkat(&self.0, name, AtFlags::empty())?)
    }

    /// Lists the names of everything in it that are UTF-8.
    pub fn names(&self) -> io::Result<BTreeSet<String>> {
        let mut names = BTreeSet::new();
        for entry in Dir::read_from(&self.0)?.take(MAX_NAMES) {
            names.extend(entry?.file_name().to_str().map(str::to_owned));
        }
        Ok(names)
    }

    pub fn items(&self) -> io::Result<Vec<Item>> {
        let mut items = Vec::new();
        for name in self.names()? {
            items.extend(self.item(&name)?);
        }
        Ok(items)
    }

    /// Returns one of its regular files; `None` if there is none of this name.
    pub fn item(&self, name: &str) -> io::Result<Option<Item>> {
        let stat = match statat(&self.0, name, AtFlags::SYMLINK_NOFOLLOW) {
            Err(Errno::NOENT) => return Ok(None),
            stat => stat?,
        };
        if no_file(&stat).is_some() {
            return Ok(None);
        }
        Ok(Some(Item {
            written: (
                stat.st_mtime,
                i64::try_from(stat.st_mtime_nsec).unwrap_or(0),
            ),
            name: name.to_owned(),
            bytes: u64::try_from(stat.st_size).unwrap_or(0),
        }))
    }

    /// Removes the unfinished files of killed runs.
    pub fn sweep(&self) -> io::Result<()> {
        for item in self.items()? {
            if item.name.starts_with(UNFINISHED) {
                self.remove(&item.name)?;
            }
        }
        Ok(())
    }

    /// Returns the number of bytes that this user can still write to its disk.
    pub fn free(&self) -> io::Result<u64> {
        let disk = fstatvfs(&self.0)?;
        Ok(disk.f_bavail.saturating_mul(disk.f_frsize))
    }
}

impl AsFd for Folder {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

fn open_folder(at: impl AsFd, path: impl Arg, more: OFlags) -> rustix::io::Result<OwnedFd> {
    let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC | more;
    openat(at, path, flags, Mode::empty())
}

fn is_link(path: &Path) -> bool {
    path.symlink_metadata()
        .is_ok_and(|about| about.is_symlink())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    #[test]
    fn only_regular_files_of_bounded_length_are_read() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        fs::write(path("file"), "12345").unwrap();
        assert_eq!(read(&path("file"), 5).unwrap(), b"12345");
        assert!(matches!(
            read(&path("file"), 4),
            Err(ReadError::TooLong { most: 4 })
        ));
        let mode = Mode::RUSR | Mode::WUSR;
        rustix::fs::mknodat(CWD, path("pipe"), FileType::Fifo, mode, 0).unwrap();
        for (name, what) in [
            (path("pipe"), "a pipe"),
            (root.path().to_owned(), "a folder"),
            ("/dev/zero".into(), "a device"),
        ] {
            let error = read(&name, 100).unwrap_err().to_string();
            assert!(error.contains(what), "{error}");
        }
        fs::write(path("bytes"), [0xff]).unwrap();
        assert!(matches!(
            read_text(&path("bytes"), 5),
            Err(ReadError::NoText)
        ));
    }

    #[test]
    fn a_private_file_is_accessible_to_its_owner_only_and_not_a_link() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("secret");
        let link = root.path().join("link");
        fs::write(&file, "x").unwrap();
        symlink(&file, &link).unwrap();
        let allow = |mode| fs::set_permissions(&file, fs::Permissions::from_mode(mode)).unwrap();
        for mode in [0o640, 0o604, 0o620, 0o610] {
            allow(mode);
            assert!(is_shared(&file));
            assert!(read_private(&file, 10).is_err(), "{mode:o}");
        }
        allow(0o600);
        assert!(!is_shared(&file));
        assert_eq!(read_private(&file, 10).unwrap(), b"x");
        assert!(read_private(&link, 10).is_err());
    }

    #[test]
    fn a_link_is_followed_only_where_that_is_asked_for() {
        let root = tempfile::tempdir().unwrap();
        let file = root.path().join("file");
        let link = root.path().join("link");
        fs::write(&file, "12345").unwrap();
        symlink(&file, &link).unwrap();
        assert_eq!(read_beginning(&link, 3).unwrap(), b"123");
        assert_eq!(read_beginning_unlinked(&file, 3).unwrap(), b"123");
        let error = read_beginning_unlinked(&link, 3).unwrap_err();
        assert_eq!(error.to_string(), "it is a symbolic link, not a file");
    }

    #[test]
    fn a_folder_that_is_a_link_is_refused_and_links_in_it_are_not_followed() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        fs::create_dir(path("elsewhere")).unwrap();
        symlink(path("elsewhere"), path("data")).unwrap();
        for opened in [Folder::open(&path("data")), Folder::make(&path("data"))] {
            let error = opened.unwrap_err().to_string();
            assert!(error.contains("symbolic link"), "{error}");
        }
        let folder = Folder::make(&path("deep/er")).unwrap();
        fs::write(path("secret"), "secret").unwrap();
        symlink(path("secret"), path("deep/er/a.jpg")).unwrap();
        assert!(folder.read("a.jpg", 100).is_err());
        assert_eq!(folder.items().unwrap(), []);
        folder.replace("a.jpg", b"new").unwrap();
        assert_eq!(fs::read(path("secret")).unwrap(), b"secret");
        assert_eq!(folder.read("a.jpg", 100).unwrap().unwrap(), b"new");
        // Also under the temporary name of an unfinished file.
        symlink(path("secret"), path("deep/er/.unfinished-b.jpg")).unwrap();
        folder.replace_durably("b.jpg", b"new").unwrap();
        assert_eq!(fs::read(path("secret")).unwrap(), b"secret");
        assert_eq!(folder.read("none", 100).unwrap(), None);
        let mode = |name: &str| fs::metadata(path(name)).unwrap().permissions().mode() & 0o777;
        assert_eq!((mode("deep/er"), mode("deep/er/b.jpg")), (0o700, 0o600));
    }

    #[test]
    fn only_a_missing_file_is_created() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        let folder = Folder::open(root.path()).unwrap();
        folder.create("a").unwrap();
        assert_eq!(fs::read(path("a")).unwrap(), b"");
        let mode = fs::metadata(path("a")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        fs::write(path("a"), "kept").unwrap();
        folder.create("a").unwrap();
        assert_eq!(fs::read(path("a")).unwrap(), b"kept");
        symlink(path("none"), path("link")).unwrap();
        folder.create("link").unwrap();
        assert!(is_link(&path("link")) && !path("none").exists());
    }

    #[test]
    fn unfinished_files_are_removed() {
        let root = tempfile::tempdir().unwrap();
        let folder = Folder::open(root.path()).unwrap();
        fs::write(root.path().join(".unfinished-a"), "x").unwrap();
        folder.replace("b", b"12").unwrap();
        folder.sweep().unwrap();
        let names: Vec<_> = folder
            .items()
            .unwrap()
            .into_iter()
            .map(|item| (item.name, item.bytes))
            .collect();
        assert_eq!(names, [("b".to_owned(), 2)]);
        assert!(folder.free().unwrap() > 0);
    }
}
