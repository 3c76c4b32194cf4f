//! The simulated robot: its parts, and [`robot::Robot`], which is all of them together. Commands and time
//! steps go in, reports come out; knows no socket and no clock.

pub(crate) mod battery;
pub(crate) mod chassis;
pub(crate) mod docking;
pub(crate) mod firmware;
pub(crate) mod grip;
pub(crate) mod memory;
pub(crate) mod microphone;
pub(crate) mod robot;
pub(crate) mod speaker;
pub(crate) mod state;
pub(crate) mod trace;
