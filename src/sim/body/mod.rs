//! The simulated robot: its parts, and [`robot::Robot`], which combines them. Takes commands and
//! time steps and returns reports; uses neither sockets nor a clock.

mod battery;
pub(crate) mod chassis;
mod contacts;
mod docking;
mod environment;
pub(crate) mod firmware;
pub(crate) mod log;
mod memory;
mod microphone;
mod power;
pub(crate) mod robot;
mod speaker;
pub(crate) mod state;
pub(crate) mod trace;
mod track_slip;
mod video;
