//! Points, poses, lines and circles on the floor, and the robot's dimensions. Metres and radians; x
//! to the right, y up, angles left positive. Imports nothing from the rest of the simulator.

mod measures;
pub(crate) mod obstacles;
mod point;
mod segment;

pub use measures::{RADIUS, TRACK_WIDTH};
pub(crate) use point::wrap;
pub use point::{Point, Pose};
pub(crate) use segment::{Segment, in_rectangle, rectangle};
