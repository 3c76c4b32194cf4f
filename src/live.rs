//! The page: see a robot and steer it from a browser. And beside it what programs ask by HTTP: the
//! JSON API, health and metrics.
//!
//! It has a thread and a runtime of its own. The driving core never waits for it: what a robot shows
//! is taken from channels in which the newest wins, and what a person wants goes through a seat in
//! front of the pilot like that of any behaviour, with the same watchdog. A viewer who is slow loses
//! frames, then his connection.
//!
//! Who steers by hand sends setpoints; each lives 0.3 s (`wheel`). STOP is no setpoint: it holds the
//! robot until a person lets go.

mod api;
mod camera;
mod command;
mod history;
mod hub;
mod log;
mod messages;
mod metrics;
mod openapi;
mod page;
mod past;
mod scripts;
mod server;
mod shapes;
mod state;
mod ticket;
mod viewer;
mod wheel;
mod world;

pub use log::{LogTap, tap};
pub use messages::{schema, understood};
pub use scripts::{Known, Script};
pub use server::{Live, LiveError, Shown};
pub use world::Simulation;
