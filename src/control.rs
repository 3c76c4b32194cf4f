//! Requests of persons and programs to an active run. There is one definition of each, served over
//! HTTP on a private socket in the data folder, for programs of the same user, and on the network
//! by the page's server; the page and the broker send the same. The pilot handles them with a
//! priority above every behaviour; the watchdog's rules apply to them too.
//!
//! Neither is served on the driving core.

mod client;
mod emergency_stop;
mod folder;
mod request;
mod response;
mod routes;
mod run;
mod run_status;
mod world_change;

pub use client::{AskError, Client, Remote, StopAnswer, StoppedRun, ask, runs, stop_runs};
pub use emergency_stop::EmergencyStop;
pub use folder::ControlServer;
pub use request::{MAX_SPEECH, RunRequest};
pub use response::RunResponse;
pub use routes::{described, paths, routes};
pub use run::Run;
pub use run_status::{BehaviourListing, RunStatus, describe};
pub use world_change::SimulatedRobot;
