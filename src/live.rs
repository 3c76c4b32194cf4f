//! The page, to see a robot and steer it from a browser, and what programs use by HTTP: the JSON
//! API, health and metrics.
//!
//! It has a thread and a runtime of its own. The driving core never waits for it: it reads channels
//! in which the newest value wins, and a person's requests go through a seat in front of the pilot
//! like those of any behaviour, with the same watchdog. A slow viewer loses frames, then the
//! connection.
//!
//! A person who steers by hand sends setpoints; each is valid for 0.3 s (`wheel`). STOP is not a
//! setpoint but a latch: it holds the robot until a person releases it.

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
