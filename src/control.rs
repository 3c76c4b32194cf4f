//! Requests to an active run: other programs of the same user connect to a private socket in the
//! data folder and send one request each. The run's own pilot handles them as a person's requests,
//! with a priority above every behaviour; the watchdog's rules apply to them too.
//!
//! The socket is not served on the driving core. The number of clients served at a time is limited;
//! each sends one request of bounded length within a timeout, or is disconnected. A run on another
//! computer accepts the same requests and gives the same answers through its JSON API.

mod client;
mod emergency_stop;
mod folder;
mod pipe;
mod report;
mod request;
mod server;
mod web;

pub use client::{AskError, Client, StopAnswer, StoppedRun, runs, stop_runs};
pub use emergency_stop::EmergencyStop;
pub use folder::guardian_socket;
pub use report::{Level, Report, RunningBehaviourReport, Start, StopReport};
pub use request::{BehaviourListing, Change, MAX_SPEECH, Next, Overview, RunRequest, RunResponse};
pub use server::{ControlServer, Run};
pub use web::{Remote, TokenError};
