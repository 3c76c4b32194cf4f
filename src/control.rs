//! A run that is on can be asked: a private socket in the data folder, by which other programs of the
//! same user ask for one thing each. What they ask for goes to the run's own pilot, as requests of a
//! person, whose priority is above that of every behaviour; the watchdog's rules hold for them too.
//!
//! The socket is served off the driving core. Clients are few at a time, each asks once, in time and in
//! bounded length, or is hung up on.

mod client;
mod desk;
mod errand;
mod folder;
mod pipe;

pub use client::{AskError, Client, runs};
pub use desk::{Desk, Run};
pub use errand::{Answer, Change, Errand, Listed, MAX_SPEECH, Overview};
