//! The camera's field of view and distortion from pictures of a chessboard: its inner corners are found
//! ([`find_chessboard`]), and the [`Camera`](super::Camera) is sought that shows them where they were
//! seen ([`calibrate`]). Pure, and slow: for a person's command.

mod corners;
mod grid;
mod linear;
mod pose;
mod solve;

pub use grid::{Board, find_chessboard};
pub use solve::{Calibrated, CalibrationError, Sighting, calibrate};
