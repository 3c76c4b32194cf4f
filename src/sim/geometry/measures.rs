//! The robot's dimensions.

/// Radius of the robot's body, a circle seen from above, metres.
pub const RADIUS: f64 = 0.15;
/// Distance between the centre lines of the tracks, metres.
pub const TRACK_WIDTH: f64 = 0.24;
