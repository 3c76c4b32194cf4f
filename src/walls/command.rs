//! The command line of a confined process.

use std::io;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use super::{Room, Walls};

/// The command that starts `executable` with its hidden arguments, so that it confines itself to the room; and
/// our end of the socket that is its standard input. It has an empty environment and nothing else open. What
/// the kernel lacks for the walls is said, once.
///
/// # Errors
/// If the system gives no socket.
pub fn command(
    executable: &Path,
    hidden: &[&str],
    room: &Room,
) -> io::Result<(Command, UnixStream)> {
    Walls::say_what_is_missing();
    let (ours, theirs) = UnixStream::pair()?;
    let mut command = Command::new(executable);
    command
        .args(hidden)
        .args(room.arguments())
        .env_clear()
        // Every thread of glibc reserves 64 MiB of address space for its own heap otherwise.
        .env("MALLOC_ARENA_MAX", "1")
        .stdin(Stdio::from(OwnedFd::from(theirs)))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        // Ctrl-C in a terminal is for the parent, which ends it in order.
        .process_group(0);
    Ok((command, ours))
}
