//! What the kernel holds a host to: it dies with its parent, may not grow, and reaches nothing but
//! its pipe, its standard error and the files in its own folder. Whatever breaks out of the VM
//! stands before these walls.
//!
//! Limits must hold, or no script is run. Landlock and seccomp are taken where the kernel has them.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Once;

use landlock::{
    ABI, Access, AccessFs, AccessNet, CompatLevel, Compatible, PathBeneath, PathFd, Ruleset,
    RulesetAttr, RulesetCreated, RulesetCreatedAttr, RulesetError, RulesetStatus, Scope,
};
use rustix::fs::Mode;
use rustix::process::{Resource, Rlimit, Signal};

use super::calls;

/// Address space: the program, its libraries and stacks, and all a script may make it allocate.
const ADDRESS_SPACE: u64 = 1 << 30;
/// Open files: the pipe, stderr, the runtime's own, and one that is being saved.
const OPEN_FILES: u64 = 32;
/// The largest file a script can save.
const FILE_SIZE: u64 = 16 << 20;
/// Of -1000 (never) to 1000 (always first); the agent has 0.
const OOM_SCORE_ADJ: &str = "500";
/// The newest landlock whose meaning is known here; on an older kernel as much as it has.
const LANDLOCK: ABI = ABI::V6;
/// What a kernel with filters for system calls says of them.
const SECCOMP_ACTIONS: &str = "/proc/sys/kernel/seccomp/actions_avail";

/// Which of the walls that not every kernel has are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Walls {
    /// Landlock: files outside the own folder, and the network, are out of reach.
    pub(super) files: bool,
    /// Seccomp: no sockets, no programs, no processes, no signals to others.
    pub(super) calls: bool,
}

impl Walls {
    /// What this kernel offers.
    pub(super) fn offered() -> Walls {
        let required = Ruleset::default()
            .set_compatibility(CompatLevel::HardRequirement)
            .handle_access(AccessFs::from_all(ABI::V1))
            .and_then(Ruleset::create);
        Walls {
            files: required.is_ok(),
            calls: Path::new(SECCOMP_ACTIONS).exists() && calls::are_known(),
        }
    }

    /// Says once in a process's life what this kernel does not offer.
    pub(super) fn say_what_is_missing() {
        static ONCE: Once = Once::new();
        ONCE.call_once(|| {
            let walls = Walls::offered();
            if !walls.files {
                tracing::debug!("this kernel has no landlock: a host could open any file of yours");
            }
            if !walls.calls {
                tracing::debug!("this kernel has no seccomp filters: a host could open sockets");
            }
        });
    }
}

/// Limits this thread and all that it starts, for good; `folders` are where it may read and write. To
/// be called first of all in a host, before its second thread.
///
/// # Errors
/// If the kernel refuses a limit: then no script must be run. Also if the parent is gone already.
pub(super) fn confine(folders: &[PathBuf]) -> io::Result<Walls> {
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if rustix::process::getppid().is_none_or(|parent| parent.is_init()) {
        return Err(io::Error::other("the agent is gone"));
    }
    die_first();
    rustix::thread::set_no_new_privs(true)?;
    // What is saved is the user's alone.
    rustix::process::umask(Mode::RWXG | Mode::RWXO);
    limit()?;
    Ok(Walls {
        files: restrict_files(folders).unwrap_or(false),
        calls: calls::refuse(),
    })
}

/// When memory is short a host is killed before the agent. Where the system does not keep such a
/// number it chooses by size.
fn die_first() {
    let _ = std::fs::write("/proc/self/oom_score_adj", OOM_SCORE_ADJ);
}

fn limit() -> io::Result<()> {
    let limits = [
        (Resource::As, ADDRESS_SPACE),
        (Resource::Nofile, OPEN_FILES),
        (Resource::Fsize, FILE_SIZE),
        (Resource::Core, 0),
    ];
    for (resource, most) in limits {
        let limit = Rlimit {
            current: Some(most),
            maximum: Some(most),
        };
        rustix::process::setrlimit(resource, limit)?;
    }
    Ok(())
}

/// Whether the kernel holds it.
fn restrict_files(folders: &[PathBuf]) -> Result<bool, RulesetError> {
    let ruleset = Ruleset::default()
        .handle_access(AccessFs::from_all(LANDLOCK))?
        .handle_access(AccessNet::from_all(LANDLOCK))?
        .scope(Scope::from_all(LANDLOCK))?
        .create()?;
    let status = allow(ruleset, folders)?.restrict_self()?.ruleset;
    Ok(status != RulesetStatus::NotEnforced)
}

/// A folder that is not there cannot be allowed: then nothing can be saved.
fn allow(ruleset: RulesetCreated, folders: &[PathBuf]) -> Result<RulesetCreated, RulesetError> {
    let read = AccessFs::ReadFile | AccessFs::ReadDir;
    let write = AccessFs::WriteFile | AccessFs::Truncate;
    let names = AccessFs::MakeReg | AccessFs::RemoveFile | AccessFs::MakeDir | AccessFs::RemoveDir;
    let open = folders.iter().filter_map(|folder| PathFd::new(folder).ok());
    let rules = open.map(|folder| Ok(PathBeneath::new(folder, read | write | names)));
    ruleset.add_rules(rules)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rustix::process::{getppid, test_kill_process};
    use std::fs;
    use std::net::{TcpListener, TcpStream, UdpSocket};
    use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
    use std::os::unix::process::CommandExt;
    use std::process::Command;

    /// Set in the process that confines itself; its value is its folder.
    const INSIDE: &str = "SPYKEE_TEST_CONFINED_TO";
    const DONE: &str = "everything was tried";

    fn refused<T>(what: &str, attempt: io::Result<T>) {
        let error = attempt
            .err()
            .unwrap_or_else(|| panic!("{what} was possible"));
        assert_eq!(
            error.kind(),
            io::ErrorKind::PermissionDenied,
            "{what}: {error}"
        );
    }

    /// What it cannot.
    fn try_files(folder: &Path) {
        let parent = folder.parent().unwrap();
        refused("reading a file", fs::read("/etc/passwd"));
        refused("reading itself", fs::read("/proc/self/exe"));
        refused("reading its environment", fs::read("/proc/self/environ"));
        refused(
            "reading its agent's",
            fs::read(format!("/proc/{}/environ", getppid().unwrap())),
        );
        refused("listing a folder", fs::read_dir("/"));
        refused("listing the folder above", fs::read_dir(parent));
        refused("a new file", fs::write(parent.join("other"), "x"));
        refused(
            "changing a neighbour",
            fs::write(parent.join("neighbour"), "x"),
        );
        refused(
            "removing a neighbour",
            fs::remove_file(parent.join("neighbour")),
        );
        fs::write(folder.join("mine"), "x").unwrap();
        let moved = fs::rename(folder.join("mine"), parent.join("mine"));
        assert!(moved.is_err(), "moving a file out was possible");
        let linked = std::os::unix::fs::symlink("/etc/passwd", folder.join("link"));
        refused("a link to elsewhere", linked);
    }

    fn try_calls(folder: &Path) {
        refused("a UDP socket", UdpSocket::bind("127.0.0.1:0"));
        refused("a TCP server", TcpListener::bind("127.0.0.1:0"));
        refused("a TCP client", TcpStream::connect("127.0.0.1:9"));
        refused("a local server", UnixListener::bind(folder.join("socket")));
        refused(
            "a local client",
            UnixStream::connect("/run/dbus/system_bus_socket"),
        );
        refused("a local datagram", UnixDatagram::unbound());
        refused(
            "another program",
            Err::<(), _>(Command::new("/bin/true").exec()),
        );
        refused("a process", Command::new("/bin/true").spawn());
        refused(
            "a signal",
            test_kill_process(getppid().unwrap()).map_err(Into::into),
        );
        let open = std::os::unix::fs::PermissionsExt::from_mode(0o777);
        refused(
            "other permissions",
            fs::set_permissions(folder.parent().unwrap(), open),
        );
    }

    /// What it must be able to do all the same.
    fn live(folder: &Path) {
        let (unfinished, picture) = (folder.join("picture.part"), folder.join("picture.jpg"));
        fs::create_dir_all(folder).unwrap();
        fs::write(&unfinished, vec![7; 100_000]).unwrap();
        fs::rename(&unfinished, &picture).unwrap();
        assert_eq!(fs::read(&picture).unwrap().len(), 100_000);
        let mode =
            std::os::unix::fs::PermissionsExt::mode(&fs::metadata(&picture).unwrap().permissions());
        assert_eq!(mode & 0o077, 0, "others can read it: {mode:o}");
        assert!(fs::read_dir(folder).unwrap().count() > 0);
        fs::remove_file(picture).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .unwrap();
        let waited = std::thread::spawn(move || {
            let pause = std::time::Duration::from_millis(1);
            runtime.block_on(async { tokio::time::sleep(pause).await });
        });
        waited.join().unwrap();
        eprintln!("{DONE}");
    }

    fn inside(folder: &Path) {
        let walls = confine(&[folder.to_owned()]).unwrap();
        assert_eq!(walls, Walls::offered());
        if walls.files {
            try_files(folder);
        }
        if walls.calls {
            try_calls(folder);
        }
        live(folder);
    }

    #[test]
    fn a_confined_process_reaches_its_own_folder_and_nothing_else() {
        if let Some(folder) = std::env::var_os(INSIDE) {
            return inside(Path::new(&folder));
        }
        let outside = Walls::offered();
        if outside
            != (Walls {
                files: true,
                calls: true,
            })
        {
            eprintln!("this kernel does not offer all, the rest is checked: {outside:?}");
        }
        let room = tempfile::tempdir().unwrap();
        let folder = room.path().join("own");
        fs::create_dir(&folder).unwrap();
        fs::write(room.path().join("neighbour"), "untouched").unwrap();
        let test = concat!(
            module_path!(),
            "::a_confined_process_reaches_its_own_folder_and_nothing_else"
        );
        let (_, test) = test.split_once("::").unwrap();
        let output = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", test, "--nocapture"])
            .env(INSIDE, &folder)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && said.contains(DONE), "{said}");
        assert_eq!(
            fs::read(room.path().join("neighbour")).unwrap(),
            b"untouched"
        );
    }
}
