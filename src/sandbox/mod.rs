//! The kernel's sandbox of a process that runs untrusted scripts: a behaviour's host, a check, a
//! scenario. It has no capabilities, no descriptors but its pipe and standard error, no files but
//! those of its policy, no network, few system calls, no new executable memory, and resource
//! limits. On a kernel without landlock or seccomp these two are missing, which is logged once.

mod calls;
mod confine;
mod worker;

pub use confine::command;
pub use confine::{Landlock, Restrictions, SandboxPolicy, confine, keep_descriptors};
pub use worker::{Reply, WORKER_ARGUMENT, Worker, WorkerError, answer};
