//! The kernel's walls round a process of ours that deals with other people's scripts: a behaviour's
//! host, a check, a scenario. What breaks out of the VM stands before these walls.
//!
//! No capabilities, no descriptors but the pipe and standard error, no files but those of its room, no
//! network, a short list of system calls, no new code in memory, and limits on what may be used up.
//! What if the kernel has no landlock or no seccomp? Then those two are missing, which is said once,
//! and the rest stands.

mod calls;
mod command;
mod confine;
mod worker;

pub use command::command;
pub use confine::{Landlock, Room, Walls, confine, keep_descriptors};
pub use worker::{Answer, WORKER_ARGUMENT, Worker, WorkerError, answer};
