//! The command line of a confined process.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use super::{Restrictions, SandboxPolicy};

/// Returns the command that starts `executable` with its hidden arguments, so that it confines
/// itself by the policy, and our end of the socket that is its standard input. The process has an
/// empty environment (except for one setting of the C library) and inherits no other descriptors.
/// Logs once per process which restrictions the kernel does not support.
///
/// # Errors
/// If the system cannot create the socket pair.
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
