//! The folder of the sockets: private, one socket for each run, named after its process. Sockets are
//! reached through the open folder: a path may be longer than a socket's address.

use std::fs::{DirBuilder, Permissions};
use std::io;
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::os::unix::fs::{DirBuilderExt as _, PermissionsExt as _};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use rustix::fs::{AtFlags, Mode, OFlags, fchmod, fstat, open, unlinkat};

/// In the data folder, beside the behaviours' own.
const NAME: &str = ".run";
const SUFFIX: &str = ".sock";
/// For its user only.
const PRIVATE: u32 = 0o700;
/// Runs of one data folder that are looked at.
const MOST_RUNS: usize = 32;

/// The open folder.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    open: OwnedFd,
    /// The data folder was not there before.
    new: bool,
}

impl Folder {
    /// Opens the folder, and makes it if need be.
    ///
    /// # Errors
    /// The system's error, or it belongs to another user.
    pub(super) fn make(data: &Path) -> io::Result<Folder> {
        let (path, new) = (data.join(NAME), !data.exists());
        DirBuilder::new()
            .recursive(true)
            .mode(PRIVATE)
            .create(&path)?;
        let folder = Folder::open(data)?;
        fchmod(&folder.open, Mode::from_raw_mode(PRIVATE))?;
        Ok(Folder { new, ..folder })
    }

    /// Opens the folder.
    ///
    /// # Errors
    /// There is none, or it belongs to another user.
    pub(super) fn open(data: &Path) -> io::Result<Folder> {
        let path = data.join(NAME);
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let open = open(&path, flags, Mode::empty())?;
        let owner = fstat(&open)?.st_uid;
        if owner != rustix::process::geteuid().as_raw() {
            let what = format!("{} belongs to another user", path.display());
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, what));
        }
        let new = false;
        Ok(Folder { path, open, new })
    }

    /// A socket of this process.
    ///
    /// # Errors
    /// What the system says.
    pub(super) fn bind(&self) -> io::Result<Bound> {
        let name = name_of(std::process::id());
        self.sweep();
        // Of an earlier process with our number.
        let _ = unlinkat(&self.open, &name, AtFlags::empty());
        let listener = UnixListener::bind(self.way_to(&name))?;
        std::fs::set_permissions(self.path.join(&name), Permissions::from_mode(0o600))?;
        listener.set_nonblocking(true)?;
        let path = self.path.join(name);
        let new = self.new;
        Ok(Bound {
            listener,
            path,
            new,
        })
    }

    /// Connections to all runs that listen.
    pub(super) fn connect_all(&self) -> Vec<UnixStream> {
        let names = self.names().into_iter();
        names.filter_map(|name| self.connect(&name).ok()).collect()
    }

    /// A connection to the run of this process.
    ///
    /// # Errors
    /// It does not listen any more.
    pub(super) fn connect_to(&self, pid: u32) -> io::Result<UnixStream> {
        self.connect(&name_of(pid))
    }

    fn connect(&self, name: &str) -> io::Result<UnixStream> {
        let stream = UnixStream::connect(self.way_to(name))?;
        stream.set_nonblocking(true)?;
        Ok(stream)
    }

    /// Takes away what killed runs have left.
    fn sweep(&self) {
        for name in self.names() {
            let refused = |error: &io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
            if self.connect(&name).is_err_and(|error| refused(&error)) {
                let _ = unlinkat(&self.open, &name, AtFlags::empty());
            }
        }
    }

    fn names(&self) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(&self.path) else {
            return vec![];
        };
        let names = entries.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
        let mut names: Vec<String> = names.filter(|name| name.ends_with(SUFFIX)).collect();
        names.sort();
        names.truncate(MOST_RUNS);
        names
    }

    fn way_to(&self, name: &str) -> String {
        format!("/proc/self/fd/{}/{name}", self.open.as_raw_fd())
    }
}

fn name_of(pid: u32) -> String {
    format!("{pid}{SUFFIX}")
}

/// A socket that listens. Dropping it takes it away, and those folders that it needed and that are
/// empty then.
#[derive(Debug)]
pub(super) struct Bound {
    pub(super) listener: UnixListener,
    path: PathBuf,
    /// The data folder was made for it.
    new: bool,
}

impl Drop for Bound {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
        let folders = if self.new { 2 } else { 1 };
        for folder in self.path.ancestors().skip(1).take(folders) {
            let _ = std::fs::remove_dir(folder);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_socket_is_private_and_gone_with_its_run() {
        let home = tempfile::tempdir().unwrap();
        let data = home.path().join("a".repeat(150)).join("data");
        let folder = Folder::make(&data).unwrap();
        let bound = folder.bind().unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&data.join(NAME)), 0o700);
        assert_eq!(mode(&bound.path), 0o600);
        assert_eq!(folder.connect_all().len(), 1);
        drop(bound);
        assert!(!data.exists());
    }

    #[test]
    fn what_a_killed_run_has_left_is_swept_away_and_nothing_else() {
        let home = tempfile::tempdir().unwrap();
        let folder = Folder::make(home.path()).unwrap();
        let kept = home.path().join("kept");
        std::fs::write(&kept, "").unwrap();
        let stale = folder.path.join("1.sock");
        drop(UnixListener::bind(&stale).unwrap());
        let live = folder.path.join("2.sock");
        let _listens = UnixListener::bind(&live).unwrap();
        assert_eq!(folder.connect_all().len(), 1);
        let bound = folder.bind().unwrap();
        assert!(!stale.exists() && live.exists());
        drop(bound);
        assert!(live.exists() && kept.exists());
    }

    #[test]
    fn a_folder_that_others_may_look_into_is_closed_to_them() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join(NAME);
        std::fs::create_dir(&path).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o777)).unwrap();
        Folder::make(home.path()).unwrap();
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o700);
    }
}
