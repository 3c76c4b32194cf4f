//! The web page for watching and steering a robot, and the HTTP interface for programs: the JSON
//! API, health and metrics.
//!
//! It runs on a separate thread with its own runtime. The driving core never waits for it: it reads
//! channels in which the newest value replaces older ones, and a person's requests go through a
//! client of the pilot like those of any behaviour, under the same watchdog. A slow viewer loses
//! frames first, then the connection.
//!
//! A person who drives by hand sends setpoints; each is valid for 0.3 s (`viewer`). STOP is
//! not a setpoint but an emergency stop: it holds the robot until a person releases it.

mod api;
mod book;
mod broadcast;
mod connection;
mod history;
mod log;
mod messages;
mod metrics;
mod mjpeg;
mod scripts;
mod server;
mod viewer;
mod world;

pub use book::installed;
pub use broadcast::FrameRate;
pub use log::{EventField, EventFields, LIGHTS_AND_SOUNDS, LOG_BEGINS, LogTap, tap};
pub use messages::{schema, understood};
pub use scripts::{RunDefinition, Script};
pub use server::{Live, LiveError, WebContext, page_files, serve_privately, served};
