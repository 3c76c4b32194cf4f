//! The simulated robot: its parts, and [`robot::Robot`], which combines them. Takes commands and
//! time steps and returns reports; uses neither sockets nor a clock.

mod battery;
pub(crate) mod chassis;
mod contacts;
mod docking;
pub(crate) mod firmware;
mod grip;
pub(crate) mod log;
mod memory;
mod microphone;
mod power;
pub(crate) mod robot;
mod speaker;
pub(crate) mod state;
mod surroundings;
pub(crate) mod trace;
mod video;
