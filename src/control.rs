//! Requests to an active run: through a private socket in the data folder other programs of the
//! same user send one request each. The run's own pilot handles them as requests of a person, with
//! a priority above every behaviour; the watchdog's rules hold for them too.
//!
//! The socket is not served on the driving core. Few clients are served at a time; each sends one
//! request of bounded length in time, or is disconnected. A run on another computer takes the same
//! errands, and gives the same answers, through its JSON API.

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
