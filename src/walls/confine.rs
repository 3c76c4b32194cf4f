//! What the kernel holds a confined process to: it dies with its parent, may not grow, has no rights of
//! its user beyond files, and reaches nothing but its pipe, its standard error and its room.
//!
//! Limits must hold, or no script is run. Landlock and seccomp are taken where the kernel has them.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
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

/// Address space: the program, its libraries and stacks, and all a script may make it allocate.
const ADDRESS_SPACE: u64 = 1 << 30;
/// Open files: the pipe, stderr, the runtime's own, and one that is being saved.
const OPEN_FILES: u64 = 32;
/// The largest file a script can save.
const FILE_SIZE: u64 = 16 << 20;
/// Of -1000 (never) to 1000 (always first); the agent has 0.
const OOM_SCORE_ADJ: &str = "500";
/// Behind the agent and everything else that is in a hurry.
const NICE: i32 = 5;
/// Threads beyond those that the whole machine has when it starts. The kernel counts those of the user,
/// which are fewer, so an honest process never meets this limit.
const MORE_THREADS: u64 = 256;
/// Processor time of a behaviour, which may run for months: a hundred days of it.
const LIFELONG: u64 = 100 * 86_400;
/// The newest landlock whose meaning is known here; on an older kernel as much as it has.
const LANDLOCK: ABI = ABI::V6;
/// What a kernel with filters for system calls says of them.
const SECCOMP_ACTIONS: &str = "/proc/sys/kernel/seccomp/actions_avail";

/// What a confined process may reach and use. Goes over its command line.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Room {
    /// Folders, or files, that it can read.
    pub read: Vec<PathBuf>,
    /// Folders in which it can also write.
    pub write: Vec<PathBuf>,
    /// Seconds of processor time; 0: as much as a behaviour.
    pub processor: u64,
}

impl Room {
    /// For [`Room::of_arguments`], the parent's number first.
    pub(super) fn arguments(&self) -> Vec<OsString> {
        let numbers = [u64::from(std::process::id()), self.processor];
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

    /// The parent that is to be its own, and the room. `None` if that is no room.
    pub fn of_arguments(arguments: impl Iterator<Item = OsString>) -> Option<(u32, Room)> {
        let mut arguments = arguments;
        let mut number = || arguments.next()?.to_str()?.parse::<u64>().ok();
        let (parent, processor, count) = (number()?, number()?, number()?);
        let mut read: Vec<PathBuf> = arguments.map(PathBuf::from).collect();
        let count = usize::try_from(count).ok().filter(|n| *n <= read.len())?;
        let write = read.split_off(count);
        let room = Room {
            read,
            write,
            processor,
        };
        Some((u32::try_from(parent).ok()?, room))
    }
}

/// Which of the walls that not every kernel has are there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Walls {
    /// Landlock: files outside the room, and the network, are out of reach.
    pub files: bool,
    /// Seccomp: no sockets, no programs, no processes, no signals to others.
    pub calls: bool,
}

/// What the kernel says of its landlock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Landlock {
    /// On, with this version of its interface.
    Version(i32),
    /// Built in and switched off.
    Off,
    /// Not built in.
    Missing,
}

impl Landlock {
    /// Asks the kernel. Takes a thread for a moment: the answer comes with a restriction.
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

impl Walls {
    /// What this kernel offers.
    pub fn offered() -> Walls {
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
                tracing::warn!(
                    "this kernel has no landlock: code that breaks out of a script's sandbox could open \
                     your files (spykee doctor says more)"
                );
            }
            if !walls.calls {
                tracing::warn!(
                    "this kernel has no seccomp filters: code that breaks out of a script's sandbox \
                     could open sockets (spykee doctor says more)"
                );
            }
        });
    }
}

/// No program that this one starts inherits a descriptor that this one got from its parent,
/// beyond its standard ones. To be called first of all in `main`.
pub fn keep_descriptors() {
    close_fds::set_fds_cloexec(3, &[]);
}

/// Limits this thread and all that it starts, for good. To be called first of all in a process, before
/// its second thread.
///
/// # Errors
/// If the kernel refuses a limit: then no script must be run. Also if the parent is gone already.
pub fn confine(parent: u32, room: &Room) -> io::Result<Walls> {
    die_first();
    rustix::thread::set_no_new_privs(true)?;
    drop_capabilities()?;
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    let is_parent = |pid: Pid| u32::try_from(pid.as_raw_nonzero().get()) == Ok(parent);
    if !rustix::process::getppid().is_some_and(is_parent) {
        return Err(io::Error::other("the agent is gone"));
    }
    // What is saved is the user's alone.
    rustix::process::umask(Mode::RWXG | Mode::RWXO);
    // A machine that does not let it be nice runs it all the same.
    let _ = rustix::process::nice(NICE);
    limit(room.processor)?;
    // Nothing of the same user can look into it, and it leaves nothing behind.
    rustix::process::set_dumpable_behavior(DumpableBehavior::NotDumpable)?;
    Ok(Walls {
        files: restrict_files(room).unwrap_or(false),
        calls: calls::restrict(),
    })
}

/// When memory is short a host is killed before the agent. Where the system does not keep such a
/// number it chooses by size.
fn die_first() {
    let _ = std::fs::write("/proc/self/oom_score_adj", OOM_SCORE_ADJ);
}

/// Of all users, root included.
fn drop_capabilities() -> io::Result<()> {
    for capability in CapabilitySet::all().iter() {
        // Only who has rights can give up those of its children; it has none without.
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

fn limit(processor: u64) -> io::Result<()> {
    let mut limits = vec![
        (Resource::As, ADDRESS_SPACE),
        (Resource::Nofile, OPEN_FILES),
        (Resource::Fsize, FILE_SIZE),
        (Resource::Core, 0),
        (Resource::Memlock, 0),
        (Resource::Msgqueue, 0),
        (Resource::Rtprio, 0),
        (Resource::Nice, 0),
        (
            Resource::Cpu,
            if processor == 0 { LIFELONG } else { processor },
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

/// Of all users together: the fourth word of `0.20 0.18 0.12 1/80 11206`.
fn threads() -> Option<u64> {
    let load = std::fs::read_to_string("/proc/loadavg").ok()?;
    let (_, all) = load.split_whitespace().nth(3)?.split_once('/')?;
    all.parse().ok()
}

/// Whether the kernel holds it.
fn restrict_files(room: &Room) -> Result<bool, RulesetError> {
    let ruleset = Ruleset::default()
        .handle_access(AccessFs::from_all(LANDLOCK))?
        .handle_access(AccessNet::from_all(LANDLOCK))?
        .scope(Scope::from_all(LANDLOCK))?
        .create()?;
    let read = AccessFs::ReadFile | AccessFs::ReadDir;
    let write = AccessFs::WriteFile | AccessFs::Truncate;
    let names = AccessFs::MakeReg | AccessFs::RemoveFile | AccessFs::MakeDir | AccessFs::RemoveDir;
    let ruleset = allow(ruleset, &room.read, read)?;
    let ruleset = allow(ruleset, &room.write, read | write | names)?;
    let status = ruleset.restrict_self()?.ruleset;
    Ok(status != RulesetStatus::NotEnforced)
}

/// A folder that is not there cannot be allowed: then nothing can be saved.
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

#[cfg(test)]
mod tests;
