//! What the kernel holds a host to: it dies with its parent, may not grow, open or dump much.

use std::io;

use rustix::process::{Resource, Rlimit, Signal};

/// Address space: the program, its libraries and stacks, and all a script may make it allocate.
const ADDRESS_SPACE: u64 = 1 << 30;
/// Open files: the pipe, stderr, the runtime's own, and one that is being saved.
const OPEN_FILES: u64 = 32;
/// The largest file a script can save.
const FILE_SIZE: u64 = 16 << 20;

/// Limits this process, for good. To be called first of all in a host.
///
/// # Errors
/// If the kernel refuses: then no script must be run. Also if the parent is gone already.
pub(super) fn confine() -> io::Result<()> {
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if rustix::process::getppid().is_none_or(|parent| parent.is_init()) {
        return Err(io::Error::other("the agent is gone"));
    }
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
