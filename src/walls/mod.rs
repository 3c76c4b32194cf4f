//! The kernel's walls round a process that handles other people's scripts: a behaviour's host, a
//! check, a scenario. Code that breaks out of the VM is still confined by these walls.
//!
//! No capabilities, no descriptors but the pipe and standard error, no files but those of its room,
//! no network, a short list of system calls, no new code in memory, and resource limits. On a
//! kernel without landlock or seccomp these two are missing, which is logged once; the rest holds.

mod calls;
mod command;
mod confine;
mod worker;

pub use command::command;
pub use confine::{Landlock, Room, Walls, confine, keep_descriptors};
pub use worker::{Answer, WORKER_ARGUMENT, Worker, WorkerError, answer};
