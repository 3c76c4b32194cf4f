//! The world in which a robot is simulated: its YAML definition, derived data, and what moves in it
//! besides the robot.

pub(crate) mod builtin;
pub(crate) mod code;
pub(crate) mod document;
pub(crate) mod dynamics;
pub(crate) mod fixtures;
pub(crate) mod objects;
pub(crate) mod paint;
pub(crate) mod reader;
pub(crate) mod route;
pub(crate) mod schedule;
pub(crate) mod settings;
pub(crate) mod spot;
pub(crate) mod station;
pub(crate) mod station_distances;
mod validate;
