//! The guardian: a tiny process beside the agent that stops the robot when the agent cannot.
//!
//! The agent gives it a duplicate of the robot's socket, the *last words* of the watchdog whenever
//! they change, and a heartbeat. If the agent is gone (killed, out of memory) or its driving core
//! has not beaten for 0.3 s (stopped, hung), the guardian sends the last words in its place. It
//! runs in its own session and survives every signal that is meant for the agent. It answers each
//! beat, and tells the agent that it has written, so that an agent that resumes does not rely on
//! what it sent before. A guardian that has died, or no longer answers, is replaced by another one;
//! until that one is there nothing may drive.
//!
//! From the first command that may move the robot until a stop was executed, a stop is *owed*. If
//! the agent is gone meanwhile, the guardian asks the robot two questions behind the last words and
//! waits for their answers; if they do not come it dials the robot and logs in itself, for at most
//! ten minutes (`debt.rs`).
//!
//! It handles bytes only: the watchdog decides what they mean, and the writer knows where a message
//! ends; it gives the guardian the rest of a partly written message. Only a person's STOP for an
//! agent that hangs is the guardian's own.
//!
//! It has a link from the robot's acceptance of the login on, until that link is lost.

mod client;
mod dead_man;
mod debt;
mod message;
mod process;
mod record;
mod robot_link;
mod starter;
mod stop_socket;

pub use client::{Guardian, GuardianAct, HEARTBEAT_INTERVAL};
pub use dead_man::HEARTBEAT_TIMEOUT;
pub use message::Route;
pub use process::{GUARDIAN_ARGUMENT, guardian_main};
pub use record::{record_path, unpaid_stop};
pub use starter::GuardianFiles;
pub use stop_socket::{StopAnswer, request_stop};
