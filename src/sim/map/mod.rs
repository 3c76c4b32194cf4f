//! Pictures for people: the map of a world, and the way that a robot went on it.

pub(crate) mod canvas;
pub(crate) mod journey;
pub(crate) mod plan;
