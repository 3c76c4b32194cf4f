//! Faults of the connection between a client and the robot, and of the robot itself.

mod corrupt;
mod entry;
pub(crate) mod fault;
pub(crate) mod list;
pub(crate) mod proxy;
mod proxy_direction;
pub(crate) mod scheduler;
mod throttled_writer;
pub(crate) mod timing;
