//! Drawings: the map of a world, and a robot's path on it.

pub(crate) mod canvas;
pub(crate) mod journey;
pub(crate) mod plan;
