//! The process of a behaviour: the host that runs its VM (child side), its [`Supervisor`] (agent
//! side) and the messages between them. The agent runs no Lua and no image decoder, so a crash in a
//! host affects only its own behaviour.

mod account;
mod gallery;
mod host;
mod inspection;
mod library;
mod limiter;
mod name;
mod policy;
mod process;
mod script_checker;
mod store_writer;
mod supervisor;
mod watch;

pub use account::Accounts;
pub use host::{Launch, PromptCommand, STACK, ToHost, host, host_main};
pub use inspection::{INSPECTION, Inspector, inspection_main};
pub use library::Library;
pub use name::{MAX_NAME, NameError, name_of, validate_name};
pub use policy::{RestartDecision, RestartPolicy, RestartTracker, Restarts, is_failure};
pub use process::{HOST_ARGUMENT, HostContext, Launcher, Prepared};
pub use script_checker::ScriptChecker;
pub use supervisor::{Handle, PromptMessage, ReplChannel, Supervisor};
pub use watch::{ScriptWatcher, read_source};
