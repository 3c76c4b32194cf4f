//! The robot's measures, which its surroundings must leave room for.

/// The robot's body seen from above is a circle of this radius, metres.
pub const RADIUS: f64 = 0.15;
/// Between the middles of the tracks, metres.
pub const TRACK_WIDTH: f64 = 0.24;
