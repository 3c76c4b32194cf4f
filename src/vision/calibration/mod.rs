//! The camera's field of view and distortion from pictures of a chessboard: its inner corners are found
//! ([`find_chessboard`]), and the [`Camera`](super::Camera) is sought that shows them where they were
//! seen ([`calibrate`]); or something of known width from known distances tells the field of view
//! ([`field_of_view`]). Pure, and slow: for a person's command.

mod corners;
mod distance;
mod grid;
mod linear;
mod pose;
mod solve;

pub use distance::{DistanceError, Measure, field_of_view};
pub use grid::{Board, find_chessboard};
pub use solve::{Calibrated, CalibrationError, Sighting, calibrate};
