//! Faults of the connection between a client and the robot, and of the robot itself.

mod entry;
pub(crate) mod fault;
mod lane;
pub(crate) mod list;
mod mangle;
mod outlet;
pub(crate) mod proxy;
pub(crate) mod scheduler;
pub(crate) mod timing;
