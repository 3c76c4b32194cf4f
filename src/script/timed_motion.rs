//! The timed motion that is active when a picture arrives.

use tokio::time::Instant;

use crate::robot::MotionId;
use crate::vision::Drive;

/// See the module documentation.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimedMotion {
    pub(super) motion: MotionId,
    pub(super) since: Instant,
    pub(super) drive: Drive,
    /// Metres that the script's tracks have covered so far; backward motion counts as negative.
    pub(super) odometer: f64,
    /// Heading in radians to the left, relative to some moment before the last motion.
    pub(super) heading: f64,
}
