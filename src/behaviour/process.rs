//! Starts and ends host processes: this very executable with a hidden argument and the folders it may
//! use, a socket pair as its standard input, an empty environment, and nothing else open.

use std::fs::DirBuilder;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::process::{ExitStatus, Stdio};

use tokio::io::AsyncReadExt;
use tokio::net::UnixStream;
use tokio::process::{Child, ChildStderr, Command};

use super::confine::Walls;

/// The hidden argument by which the executable knows that it is to be a host.
pub const HOST_ARGUMENT: &str = "__host";
/// The most of a dying host's last words that is kept.
const MAX_LAST_WORDS: u64 = 4096;

/// How to start a host.
#[derive(Debug, Clone)]
pub struct Launcher {
    executable: PathBuf,
}

impl Launcher {
    /// Hosts are started from this executable, which must be `spykee`.
    pub fn new(executable: PathBuf) -> Launcher {
        Launcher { executable }
    }

    /// Hosts are started from the running executable.
    ///
    /// # Errors
    /// If the system does not tell where it is.
    pub fn this_executable() -> io::Result<Launcher> {
        std::env::current_exe().map(Launcher::new)
    }

    /// Starts a host that can open no files but those in `folders`, which are made if need be; the
    /// stream is the agent's end of its pipe. To be called from a thread that lives as long as the
    /// agent: the host dies with the thread that started it.
    ///
    /// # Errors
    /// Whatever the system says.
    pub fn start(&self, folders: &[&Path]) -> io::Result<(HostProcess, UnixStream)> {
        Walls::say_what_is_missing();
        folders.iter().for_each(|folder| make_private(folder));
        let (ours, theirs) = std::os::unix::net::UnixStream::pair()?;
        ours.set_nonblocking(true)?;
        let child = Command::new(&self.executable)
            .arg(HOST_ARGUMENT)
            .args(folders)
            .env_clear()
            // Every thread of glibc reserves 64 MiB of address space for its own heap otherwise.
            .env("MALLOC_ARENA_MAX", "1")
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .kill_on_drop(true)
            // Ctrl-C in a terminal is for the agent: it has the script say its last words.
            .process_group(0)
            .spawn()?;
        Ok((HostProcess { child }, UnixStream::from_std(ours)?))
    }
}

/// Makes a folder that only its user can look into; one that is there stays as it is. Without one
/// nothing can be saved, which is no reason not to run.
fn make_private(folder: &Path) {
    let made = DirBuilder::new().recursive(true).mode(0o700).create(folder);
    if let Err(error) = made {
        tracing::debug!("cannot make {}: {error}", folder.display());
    }
}

/// A running host. Dropping it kills it.
#[derive(Debug)]
pub struct HostProcess {
    child: Child,
}

impl HostProcess {
    /// SIGKILL, and waits until the process is reaped.
    pub async fn kill(&mut self) -> io::Result<ExitStatus> {
        self.child.start_kill()?;
        self.child.wait().await
    }

    /// Waits until the process has ended by itself. Cancel-safe.
    pub async fn wait(&mut self) -> io::Result<ExitStatus> {
        self.child.wait().await
    }

    /// What a host that has ended wrote to its standard error: nothing, unless it broke.
    pub async fn last_words(&mut self) -> String {
        let mut words = Vec::new();
        if let Some(stderr) = self.child.stderr.take() {
            let _ = <ChildStderr as AsyncReadExt>::take(stderr, MAX_LAST_WORDS)
                .read_to_end(&mut words)
                .await;
        }
        String::from_utf8_lossy(&words).trim().to_owned()
    }
}
