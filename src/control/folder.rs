//! The private socket of a run, and the folder of these sockets: one for each run, named after its
//! process ID.

use std::io;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use rustix::fs::{Mode, fchmod, fstat};

use super::routes::routes;
use super::run::Run;
use crate::{files, http};

/// Name of the folder, in the data folder beside those of the behaviours.
const NAME: &str = ".run";
const SUFFIX: &str = ".sock";
/// The same of the socket of a run's guardian.
const GUARDIAN_SUFFIX: &str = ".guardian";
const PRIVATE: u32 = 0o700;
/// Maximum number of runs per data folder that are considered.
const MAX_RUNS: usize = 32;

/// Where the guardian of the run with this process ID listens for a person's STOP.
pub(super) fn guardian_socket(data: &Path, pid: u32) -> PathBuf {
    data.join(NAME).join(guardian_name(pid))
}

#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    open: files::Folder,
    /// Whether the data folder was created by this call.
    new: bool,
}

impl Folder {
    /// Opens the folder, and creates it if necessary.
    /// Fails if the folder belongs to another user.
    pub(super) fn make(data: &Path) -> io::Result<Folder> {
        let new = !data.exists();
        files::Folder::make(&data.join(NAME))?;
        let folder = Folder::open(data)?;
        fchmod(&folder.open, Mode::from_raw_mode(PRIVATE))?;
        Ok(Folder { new, ..folder })
    }

    /// Opens the folder.
    /// Fails if the folder does not exist or belongs to another user.
    pub(super) fn open(data: &Path) -> io::Result<Folder> {
        let path = data.join(NAME);
        let open = files::Folder::open(&path)?;
        let owner = fstat(&open)?.st_uid;
        if owner != rustix::process::geteuid().as_raw() {
            let what = format!("{} belongs to another user", path.display());
            return Err(io::Error::new(io::ErrorKind::PermissionDenied, what));
        }
        let new = false;
        Ok(Folder { path, open, new })
    }

    fn bind(&self) -> io::Result<ControlServer> {
        let name = name_of(std::process::id());
        self.sweep();
        let listener = self.open.bind(&name, |path| UnixListener::bind(path))?;
        listener.set_nonblocking(true)?;
        let path = self.path.join(name);
        let new = self.new;
        Ok(ControlServer {
            listener,
            path,
            new,
        })
    }

    /// Connects to all runs that listen, each with its process ID.
    pub(super) fn connect_all(&self) -> Vec<(u32, UnixStream)> {
        let mut streams = Vec::new();
        for name in self.names(SUFFIX) {
            let pid = name.strip_suffix(SUFFIX).and_then(|pid| pid.parse().ok());
            if let (Some(pid), Ok(stream)) = (pid, self.connect(&name)) {
                streams.push((pid, stream));
            }
        }
        streams
    }

    pub(super) fn connect_to(&self, pid: u32) -> io::Result<UnixStream> {
        self.connect(&name_of(pid))
    }

    fn connect(&self, name: &str) -> io::Result<UnixStream> {
        let stream = UnixStream::connect(self.open.socket_path(name))?;
        stream.set_nonblocking(true)?;
        Ok(stream)
    }

    /// Removes the sockets of killed runs and guardians.
    fn sweep(&self) {
        let guardians = self.names(GUARDIAN_SUFFIX);
        for name in self.names(SUFFIX).into_iter().chain(guardians) {
            let refused = |error: &io::Error| error.kind() == io::ErrorKind::ConnectionRefused;
            if self.connect(&name).is_err_and(|error| refused(&error)) {
                let _ = self.open.remove(&name);
            }
        }
    }

    fn names(&self, suffix: &str) -> Vec<String> {
        let names = self.open.names().unwrap_or_default().into_iter();
        let pid = |name: &String| name.strip_suffix(suffix)?.parse::<u32>().ok();
        let sockets = names.filter(|name| pid(name).is_some());
        sockets.take(MAX_RUNS).collect()
    }
}

fn guardian_name(pid: u32) -> String {
    format!("{pid}{GUARDIAN_SUFFIX}")
}

fn name_of(pid: u32) -> String {
    format!("{pid}{SUFFIX}")
}

/// The private socket of a run. Dropping it removes the socket, and the folders created for it if they
/// are then empty.
#[derive(Debug)]
pub struct ControlServer {
    listener: UnixListener,
    path: PathBuf,
    /// Whether the data folder was created for it.
    new: bool,
}

impl ControlServer {
    /// Opens the socket in this data folder. Blocks on the disk: must not be called on the driving
    /// core.
    /// If it fails, the run accepts no requests.
    pub fn open(data: &Path) -> io::Result<ControlServer> {
        Folder::make(data)?.bind()
    }

    /// Where the guardian of this run listens for a person's STOP (see
    /// [`request_stop`](crate::guardian::request_stop)). Its folder exists, as the guardian needs.
    pub fn guardian_socket(&self) -> PathBuf {
        self.path.with_file_name(guardian_name(std::process::id()))
    }

    /// Serves programs of the same user; returns only on an error.
    pub async fn serve(self, run: Run) -> io::Result<()> {
        let listener = tokio::net::UnixListener::from_std(self.listener.try_clone()?)?;
        http::serve_private(listener, routes(run)).await;
        Ok(())
    }
}

impl Drop for ControlServer {
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
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    #[test]
    fn the_socket_is_private_and_removed_with_its_run() {
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
    fn only_sockets_of_killed_runs_are_removed() {
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
    fn a_run_that_begins_keeps_its_socket_while_another_one_removes_those_of_killed_runs() {
        let home = tempfile::tempdir().unwrap();
        let folder = Folder::make(home.path()).unwrap();
        // The end of a run removes an empty folder.
        std::fs::write(folder.path.join("kept"), "").unwrap();
        let ended = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            let begins = scope.spawn(|| {
                let is_kept = |bound: ControlServer| bound.path.exists();
                let lost = (0..10_000).filter(|_| !folder.bind().is_ok_and(is_kept));
                let lost = lost.count();
                ended.store(true, std::sync::atomic::Ordering::Relaxed);
                lost
            });
            while !ended.load(std::sync::atomic::Ordering::Relaxed) {
                folder.sweep();
            }
            assert_eq!(begins.join().unwrap(), 0);
        });
    }

    #[test]
    fn a_folder_that_others_may_access_is_made_private() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join(NAME);
        std::fs::create_dir(&path).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o777)).unwrap();
        Folder::make(home.path()).unwrap();
        assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o700);
    }
}
