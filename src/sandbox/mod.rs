//! The kernel's sandbox of a process that runs untrusted scripts: no capabilities, no descriptors
//! but its pipe and standard error, no files but those of its policy, no network, few system calls,
//! and resource limits. Where the kernel lacks landlock or seccomp, that is logged once.

mod calls;
mod confine;
mod worker;

pub use confine::command;
pub use confine::{Landlock, Restrictions, SandboxPolicy, keep_descriptors};
pub use worker::{WORKER_ARGUMENT, Worker, WorkerError, answer, confined_main};
