//! The guardian: a tiny process beside the agent that stops the robot when the agent cannot.
//!
//! The agent gives it a duplicate of the robot's socket, the *last words* of the watchdog whenever they
//! change, and a heartbeat. If the agent is gone (killed, out of memory) or its driving core has not
//! beaten for 0.3 s (stopped, hung), the guardian says the last words in its place. It has a session of
//! its own and outlives every signal that is meant for the agent. It answers each beat; in the place of
//! one that is gone, or answers no more, another one is started.
//!
//! Knows bytes only: what the words mean is decided by the watchdog, and where a message ends by the
//! writer, which tells the guardian the rest of one that is half out.

mod client;
mod guard;
mod note;
mod process;
mod starter;

pub use client::{BEAT, Guardian};
pub use process::{GUARDIAN_ARGUMENT, guardian_main};
