//! The restrictions that the kernel enforces on a confined process. The resource limits are
//! mandatory: without them no script runs; landlock and seccomp are used where they are supported.

use std::ffi::OsString;
use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Once;

use landlock::{
    ABI, Access, AccessFs, AccessNet, BitFlags, CompatLevel, Compatible, LandlockStatus,
    PathBeneath, PathFd, Ruleset, RulesetAttr, RulesetCreated, RulesetCreatedAttr, RulesetError,
    RulesetStatus, Scope,
};
use rustix::fs::Mode;
use rustix::process::{DumpableBehavior, Pid, Resource, Rlimit, Signal};
use rustix::thread::{CapabilitySet, CapabilitySets};

use super::calls;

/// Address space: the program, its libraries and stacks, and everything a script makes it allocate.
const ADDRESS_SPACE: u64 = 1 << 30;
/// Open files: the pipe, stderr, those of the runtime, and one that is being saved.
const OPEN_FILES: u64 = 32;
/// The same of a process that also serves viewers.
const SERVING_FILES: u64 = 80;
/// The largest file a script can save.
const FILE_SIZE: u64 = 16 << 20;
/// From -1000 (never killed) to 1000 (killed first); the agent has 0.
const OOM_SCORE_ADJ: &str = "500";
/// Niceness: a lower priority than that of the agent and other time-critical processes.
const NICE: i32 = 5;
/// Threads allowed in addition to those of the whole machine at the start. The kernel counts only
/// the user's threads, which are fewer, so a well-behaved process never reaches this limit.
const MORE_THREADS: u64 = 256;
/// CPU time of a behaviour, which may run for months: a hundred days.
const BEHAVIOUR_CPU_SECONDS: u64 = 100 * 86_400;
/// The newest landlock version that this program knows; older kernels apply the part that they
/// support.
const LANDLOCK: ABI = ABI::V6;
/// This file exists on a kernel with seccomp filters.
const SECCOMP_ACTIONS: &str = "/proc/sys/kernel/seccomp/actions_avail";

/// What a confined process may access and use. Passed on its command line.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SandboxPolicy {
    /// Folders or files that it may read.
    pub read: Vec<PathBuf>,
    /// Folders in which it may also write.
    pub write: Vec<PathBuf>,
    /// Limit of CPU time in seconds; 0 for that of a behaviour.
    pub cpu_seconds: u64,
    /// Whether it accepts connections, on a socket that it already has.
    pub serves: bool,
}

impl SandboxPolicy {
    /// The arguments for [`SandboxPolicy::of_arguments`]: the parent's process id first.
    pub(super) fn arguments(&self) -> Vec<OsString> {
        let serves = u64::from(self.serves);
        let numbers = [u64::from(std::process::id()), self.cpu_seconds, serves];
        let numbers = numbers.map(|number| OsString::from(number.to_string()));
        let read = self.read.iter().map(OsString::from);
        let write = self.write.iter().map(OsString::from);
        let between = [OsString::from(self.read.len().to_string())];
        numbers
            .into_iter()
            .chain(between)
            .chain(read)
            .chain(write)
            .collect()
    }

    /// Parses the process id of the expected parent and the policy. `None` if the arguments are
    /// invalid.
    pub(super) fn of_arguments(
        arguments: impl Iterator<Item = OsString>,
    ) -> Option<(u32, SandboxPolicy)> {
        let mut arguments = arguments;
        let mut number = || arguments.next()?.to_str()?.parse::<u64>().ok();
        let parent = number()?;
        let cpu_seconds = number()?;
        let serves = number()? == 1;
        let count = number()?;
        let mut read: Vec<PathBuf> = arguments.map(PathBuf::from).collect();
        let count = usize::try_from(count).ok().filter(|n| *n <= read.len())?;
        let write = read.split_off(count);
        let policy = SandboxPolicy {
            read,
            write,
            cpu_seconds,
            serves,
        };
        Some((u32::try_from(parent).ok()?, policy))
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Restrictions {
    /// Landlock: files that the policy does not allow and the network cannot be accessed.
    pub files: bool,
    /// Seccomp: no sockets, programs, processes or signals to other processes.
    pub calls: bool,
}

/// The kernel's support for landlock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Landlock {
    /// Enabled, with this version of its interface.
    Version(i32),
    Off,
    Missing,
}

impl Landlock {
    /// Queries the kernel. Runs on a temporary thread, because the query restricts the calling
    /// thread.
    pub fn of_this_kernel() -> Landlock {
        let asking = std::thread::spawn(|| {
            let ruleset = Ruleset::default().handle_access(AccessFs::from_all(LANDLOCK));
            let restricted = ruleset?.create()?.restrict_self()?;
            Ok::<_, RulesetError>(restricted.landlock)
        });
        match asking.join() {
            Ok(Ok(LandlockStatus::Available {
                effective_abi,
                kernel_abi,
            })) => Landlock::Version(kernel_abi.unwrap_or(effective_abi as i32)),
            Ok(Ok(LandlockStatus::NotEnabled)) => Landlock::Off,
            _ => Landlock::Missing,
        }
    }
}

impl Restrictions {
    pub fn supported() -> Restrictions {
        let required = Ruleset::default()
            .set_compatibility(CompatLevel::HardRequirement)
            .handle_access(AccessFs::from_all(ABI::V1))
            .and_then(Ruleset::create);
        Restrictions {
            files: required.is_ok(),
            calls: Path::new(SECCOMP_ACTIONS).exists() && calls::is_supported(),
        }
    }

    /// Logs once per process which restrictions this kernel does not support.
    pub(super) fn warn_unsupported() {
        static ONCE: Once = Once::new();
        ONCE.call_once(|| {
            let restrictions = Restrictions::supported();
            if !restrictions.files {
                tracing::warn!(
                    "this kernel has no landlock: code that breaks out of a script's sandbox could open \
                     your files (run `spykee doctor` for details)"
                );
            }
            if !restrictions.calls {
                tracing::warn!(
                    "this kernel has no seccomp filters: code that breaks out of a script's sandbox \
                     could open sockets (run `spykee doctor` for details)"
                );
            }
        });
    }
}

/// Prevents programs that this process starts from inheriting the file descriptors it got from its
/// own parent, except the standard ones. Must be called first in `main`.
pub fn keep_descriptors() {
    close_fds::set_fds_cloexec(3, &[]);
}

/// Permanently restricts this thread and everything it starts, so it must be called before a
/// process starts a second thread. Fails if the kernel refuses a limit, or the parent has exited.
pub(super) fn confine(parent: u32, policy: &SandboxPolicy) -> io::Result<Restrictions> {
    raise_oom_score();
    rustix::thread::set_no_new_privs(true)?;
    drop_capabilities()?;
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    let is_parent = |pid: Pid| u32::try_from(pid.as_raw_nonzero().get()) == Ok(parent);
    if !rustix::process::getppid().is_some_and(is_parent) {
        return Err(io::Error::other("the agent has exited"));
    }
    // Only the user may read saved files.
    rustix::process::umask(Mode::RWXG | Mode::RWXO);
    // If the system refuses the lower priority, the process runs without it.
    let _ = rustix::process::nice(NICE);
    limit(policy)?;
    // Other processes of the same user cannot trace it, and it leaves no core dump.
    rustix::process::set_dumpable_behavior(DumpableBehavior::NotDumpable)?;
    Ok(Restrictions {
        files: restrict_files(policy).unwrap_or(false),
        calls: calls::restrict(policy.serves),
    })
}

/// Makes the kernel kill a host before the agent when memory runs out. Where the system has no such
/// score, it chooses by size.
fn raise_oom_score() {
    let _ = std::fs::write("/proc/self/oom_score_adj", OOM_SCORE_ADJ);
}

fn drop_capabilities() -> io::Result<()> {
    for capability in CapabilitySet::all().iter() {
        // Only a process with capabilities can limit those of its children; without any, this call
        // fails.
        let _ = rustix::thread::remove_capability_from_bounding_set(capability);
    }
    let _ = rustix::thread::clear_ambient_capability_set();
    let none = CapabilitySets {
        effective: CapabilitySet::empty(),
        permitted: CapabilitySet::empty(),
        inheritable: CapabilitySet::empty(),
    };
    Ok(rustix::thread::set_capabilities(None, none)?)
}

fn limit(policy: &SandboxPolicy) -> io::Result<()> {
    let cpu_seconds = policy.cpu_seconds;
    let files = if policy.serves {
        SERVING_FILES
    } else {
        OPEN_FILES
    };
    let mut limits = vec![
        (Resource::As, ADDRESS_SPACE),
        (Resource::Nofile, files),
        (Resource::Fsize, FILE_SIZE),
        (Resource::Core, 0),
        (Resource::Memlock, 0),
        (Resource::Msgqueue, 0),
        (Resource::Rtprio, 0),
        (Resource::Nice, 0),
        (
            Resource::Cpu,
            if cpu_seconds == 0 {
                BEHAVIOUR_CPU_SECONDS
            } else {
                cpu_seconds
            },
        ),
    ];
    limits.extend(threads().map(|threads| (Resource::Nproc, threads + MORE_THREADS)));
    for (resource, most) in limits {
        // A lower hard limit cannot be raised.
        let most = rustix::process::getrlimit(resource)
            .maximum
            .map_or(most, |maximum| maximum.min(most));
        let limit = Rlimit {
            current: Some(most),
            maximum: Some(most),
        };
        rustix::process::setrlimit(resource, limit)?;
    }
    Ok(())
}

/// Threads of all users: the total in the fourth field of `0.20 0.18 0.12 1/80 11206`.
fn threads() -> Option<u64> {
    let load = std::fs::read_to_string("/proc/loadavg").ok()?;
    let (_, all) = load.split_whitespace().nth(3)?.split_once('/')?;
    all.parse().ok()
}

/// Files, network and other processes; returns whether the kernel enforces the rules.
fn restrict_files(policy: &SandboxPolicy) -> Result<bool, RulesetError> {
    let ruleset = Ruleset::default()
        .handle_access(AccessFs::from_all(LANDLOCK))?
        .handle_access(AccessNet::from_all(LANDLOCK))?
        .scope(Scope::from_all(LANDLOCK))?
        .create()?;
    let read = AccessFs::ReadFile | AccessFs::ReadDir;
    let write = AccessFs::WriteFile | AccessFs::Truncate;
    let names = AccessFs::MakeReg | AccessFs::RemoveFile | AccessFs::MakeDir | AccessFs::RemoveDir;
    let ruleset = allow(ruleset, &policy.read, read)?;
    let ruleset = allow(ruleset, &policy.write, read | write | names)?;
    let status = ruleset.restrict_self()?.ruleset;
    Ok(status != RulesetStatus::NotEnforced)
}

/// Adds a rule for each folder or file. One that does not exist gets none and stays inaccessible.
fn allow(
    ruleset: RulesetCreated,
    folders: &[PathBuf],
    access: BitFlags<AccessFs>,
) -> Result<RulesetCreated, RulesetError> {
    let shown = |folder: &PathBuf| {
        if folder.as_os_str().is_empty() {
            PathBuf::from(".")
        } else {
            folder.clone()
        }
    };
    let open = folders
        .iter()
        .filter_map(|one| PathFd::new(shown(one)).ok());
    let rules = open.map(|folder| Ok(PathBeneath::new(folder, access)));
    ruleset.add_rules(rules)
}

/// Returns the command that starts `executable` with its hidden arguments, so that it confines
/// itself by the policy, and our end of the socket that is its standard input. The process has an
/// empty environment (except for one setting of the C library) and inherits no other descriptors.
/// Logs once per process which restrictions the kernel does not support.
pub fn command(
    executable: &Path,
    hidden: &[&str],
    policy: &SandboxPolicy,
) -> io::Result<(Command, UnixStream)> {
    Restrictions::warn_unsupported();
    let (ours, theirs) = UnixStream::pair()?;
    let mut command = Command::new(executable);
    command
        .args(hidden)
        .args(policy.arguments())
        .env_clear()
        // Otherwise glibc reserves 64 MiB of address space for a separate heap for every thread.
        .env("MALLOC_ARENA_MAX", "1")
        .stdin(Stdio::from(OwnedFd::from(theirs)))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        // Ctrl-C in a terminal is meant for the parent, which stops the child in an orderly way.
        .process_group(0);
    Ok((command, ours))
}

#[cfg(test)]
mod tests {
    use std::fs;
    use std::net::{TcpListener, TcpStream, UdpSocket};
    use std::os::unix::net::{UnixDatagram, UnixListener, UnixStream};
    use std::os::unix::process::CommandExt;
    use std::process::Command;

    use rustix::process::{getppid, test_kill_process};

    use super::*;

    /// Set in the process that confines itself; the value is its folder.
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

    /// File accesses that must be refused.
    fn try_files(folder: &Path) {
        let parent = folder.parent().unwrap();
        refused("reading a file", fs::read("/etc/passwd"));
        refused("reading itself", fs::read("/proc/self/exe"));
        refused("reading its environment", fs::read("/proc/self/environ"));
        refused(
            "reading its agent's environment",
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

    /// Operations that must still work.
    fn live(folder: &Path) {
        let unfinished = folder.join("picture.part");
        let picture = folder.join("picture.jpg");
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
        let policy = SandboxPolicy {
            write: vec![folder.to_owned()],
            ..SandboxPolicy::default()
        };
        let supported = Restrictions::supported();
        let parent = getppid().unwrap();
        let elsewhere = confine(u32::MAX, &policy);
        assert!(
            elsewhere.is_err(),
            "confined although the parent is another one"
        );
        let restrictions = confine(parent.as_raw_nonzero().get().unsigned_abs(), &policy).unwrap();
        assert_eq!(restrictions, supported);
        let rights = rustix::thread::capabilities(None);
        assert!(rights.is_err() || rights.is_ok_and(|rights| rights.permitted.is_empty()));
        if restrictions.files {
            try_files(folder);
        }
        if restrictions.calls {
            try_calls(folder);
        }
        live(folder);
    }

    #[test]
    fn a_policy_survives_the_round_trip_over_a_command_line() {
        let paths = |names: &[&str]| names.iter().map(PathBuf::from).collect::<Vec<_>>();
        let policy = SandboxPolicy {
            read: paths(&["a b", "--", ""]),
            write: paths(&["/c"]),
            cpu_seconds: 7,
            serves: true,
        };
        let back = SandboxPolicy::of_arguments(policy.arguments().into_iter());
        assert_eq!(back, Some((std::process::id(), policy)));
        for wrong in [
            &["1", "2"][..],
            &["x", "0", "0"],
            &["1", "0", "1", "2", "only"],
        ] {
            let arguments = wrong.iter().map(OsString::from);
            assert_eq!(SandboxPolicy::of_arguments(arguments), None, "{wrong:?}");
        }
    }

    #[test]
    fn a_confined_process_reaches_its_own_folder_and_nothing_else() {
        if let Some(folder) = std::env::var_os(INSIDE) {
            return inside(Path::new(&folder));
        }
        let outside = Restrictions::supported();
        if outside
            != (Restrictions {
                files: true,
                calls: true,
            })
        {
            eprintln!(
                "this kernel does not support all restrictions, the others are checked: {outside:?}"
            );
        }
        let parent = tempfile::tempdir().unwrap();
        let folder = parent.path().join("own");
        fs::create_dir(&folder).unwrap();
        fs::write(parent.path().join("neighbour"), "untouched").unwrap();
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
        let stderr = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && stderr.contains(DONE), "{stderr}");
        assert_eq!(
            fs::read(parent.path().join("neighbour")).unwrap(),
            b"untouched"
        );
    }
}
