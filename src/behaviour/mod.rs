//! The process of a behaviour: the host that runs its VM (child side), its [`Supervisor`] (agent
//! side) and the messages between them. The agent runs no Lua and no image decoder, so a crash in a
//! host affects only its own behaviour.

mod gallery;
mod host;
mod inspection;
mod library;
mod log_limiter;
mod message;
mod name;
mod policy;
mod process;
mod repl_channel;
mod report_limiter;
mod store_writer;
mod supervisor;
mod watch;

pub use host::{STACK, host, host_main};
pub use inspection::{INSPECTION, Inspected, InspectionError, Inspector, inspection_main};
pub use library::{Library, LibraryError};
pub use message::{FromHost, Launch, ToHost};
pub use name::{MAX_NAME, NameError, name_of, validate_name};
pub use policy::{
    RestartDecision, RestartPolicy, RestartTracker, Restarts, UnknownPolicy, is_failure,
};
pub use process::{HOST_ARGUMENT, HostProcess, Launcher, Prepared};
pub use repl_channel::{PromptCommand, PromptMessage, ReplChannel};
pub use supervisor::{Handle, Supervisor};
pub use watch::{Reload, ScriptWatcher, read_source};
