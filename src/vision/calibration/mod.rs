//! Measures the camera's field of view and distortion from pictures of a chessboard: finds its
//! inner corners ([`find_chessboard`]) and fits the [`Camera`](super::Camera) to them
//! ([`calibrate`]). Alternatively determines the field of view from an object of known width at
//! known distances ([`field_of_view`]). Without side effects, but slow: intended for terminal
//! commands.

mod corners;
mod distance;
mod grid;
mod linear;
mod pose;
mod solve;

pub use distance::{DistanceError, Measure, field_of_view};
pub use grid::{Board, find_chessboard};
pub use solve::{Calibrated, CalibrationError, Sighting, calibrate};
