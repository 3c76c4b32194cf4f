//! Drawings: the map of a world, and a robot's path on it.

pub(crate) mod canvas;
pub(crate) mod driven_path;
pub(crate) mod plan;
