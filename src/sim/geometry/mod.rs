//! Points, poses, lines and circles on the floor. Metres and radians; x to the right, y up, angles
//! left positive. Imports nothing of the simulator.

pub(crate) mod obstacles;
mod point;

pub use point::{Point, Pose};
pub(crate) use point::{Segment, in_rectangle, rectangle, wrap};
