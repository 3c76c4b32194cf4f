//! A run that is on can be asked: a private socket in the data folder, by which other programs of the
//! same user ask for one thing each. What they ask for goes to the run's own pilot, as requests of a
//! person, whose priority is above that of every behaviour; the watchdog's rules hold for them too.
//!
//! The socket is served off the driving core. Clients are few at a time, each asks once, in time and in
//! bounded length, or is hung up on. A run on another computer is asked by its JSON API, with the same
//! errands and answers.

mod client;
mod desk;
mod errand;
mod error;
mod folder;
mod pipe;
mod report;
mod web;

pub use client::{Client, runs};
pub use desk::{Desk, Run};
pub use errand::{Answer, Change, Errand, Listed, MAX_SPEECH, Next, Overview};
pub use error::AskError;
pub use report::{Level, Report, Runs, Start};
pub use web::{Remote, RemoteError};
