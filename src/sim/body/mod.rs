//! The simulated robot: its parts, and [`robot::Robot`], which is all of them together. Commands
//! and time steps go in, reports come out; knows no socket and no clock.

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
