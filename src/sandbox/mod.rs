//! The kernel-enforced sandbox of a process that runs untrusted scripts: a behaviour's host, a
//! check, a scenario. Code that breaks out of the VM is still confined by it.
//!
//! A confined process has no capabilities, no file descriptors except the pipe and standard error,
//! no files except those that its policy allows, no network, a short allow-list of system calls, no
//! new executable memory, and resource limits. On a kernel without landlock or seccomp these two
//! restrictions are missing, which is logged once; all others still apply.

mod calls;
mod confine;
mod worker;

pub use confine::command;
pub use confine::{Landlock, Restrictions, SandboxPolicy, confine, keep_descriptors};
pub use worker::{Reply, WORKER_ARGUMENT, Worker, WorkerError, answer};
