//! A behaviour's process: the host that runs its VM (child side), its [`Supervisor`] (agent side)
//! and the messages between them. The agent runs no Lua and no decoder; what crashes here, crashes
//! alone.

mod calls;
mod confine;
mod gallery;
mod host;
mod keeper;
mod library;
mod message;
mod pipe;
mod process;
mod supervisor;

pub use host::{STACK, host, host_main};
pub use library::Library;
pub use message::{FromHost, Launch, ToHost};
pub use process::{HOST_ARGUMENT, HostProcess, Launcher};
pub use supervisor::{Handle, Prepared, Supervisor};
