//! The timed motion that is on when a picture comes.

use tokio::time::Instant;

use crate::robot::MotionId;
use crate::vision::Drive;

/// See the module.
#[derive(Debug, Clone, Copy)]
pub(super) struct Going {
    pub(super) motion: MotionId,
    pub(super) since: Instant,
    pub(super) drive: Drive,
    /// Metres that the script's tracks have made so far, backwards ones taken off.
    pub(super) odometer: f64,
    /// Radians to the left since some time before the last motion.
    pub(super) heading: f64,
}
