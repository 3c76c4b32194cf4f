//! What goes wrong between a client and the robot, and with the robot itself.

pub(crate) mod fault;
pub(crate) mod list;
pub(crate) mod mangle;
pub(crate) mod outlet;
pub(crate) mod proxy;
pub(crate) mod timing;
pub(crate) mod troubles;
