//! Whether the tracks have brought the robot to the wall whose foot it saw before it came too
//! close. The position of the robot follows from its tracks, that of the wall from its foot.

use std::time::Duration;

use crate::vision::{Camera, Drive, HalfLuma, RobotPose, Wall, WallFeet};

/// From the centre of the robot to its edge, in metres.
const RADIUS: f64 = 0.15;
/// If the tracks have brought the robot this far into a wall, in metres, it must have been blocked.
const INSIDE: f64 = 0.05;
/// The robot must drive towards the wall with at least this share of its motion.
const TOWARDS: f64 = 0.3;
/// Distances between the robot's edge and a wall, in metres, at which the wall is ahead and does
/// not block the robot yet; farther walls do not count as ahead.
const AWAY: std::ops::Range<f64> = 0.07..1.85;
/// The longest time of pushing that is reported.
const LONGEST: Duration = Duration::from_secs(2);

/// The state of one motion; see the module documentation.
#[derive(Debug, Default)]
pub(super) struct WallAhead {
    odometer: Option<f64>,
    pose: RobotPose,
    feet: WallFeet,
    wall: Option<Wall>,
    /// Whether feet were seen since the wall was last computed.
    has_new_feet: bool,
}

impl WallAhead {
    /// Advances the robot's position to this odometer reading, in metres.
    pub(super) fn drive_on(&mut self, odometer: f64, drive: Drive) {
        let way = odometer - self.odometer.unwrap_or(odometer);
        self.odometer = Some(odometer);
        if drive.forward != 0.0 {
            self.pose = self.pose.after(way, way / drive.forward * drive.turn);
        }
    }

    /// Processes a picture taken from the current position. The wall is only computed where the
    /// robot may be close to one.
    pub(super) fn look(&mut self, half_luma: &HalfLuma, camera: Camera, close: bool) {
        self.has_new_feet |= self.feet.note(half_luma, camera, self.pose);
        if close && self.has_new_feet {
            self.wall = self.feet.wall();
            self.has_new_feet = false;
        }
    }

    /// Whether the robot has not reached the wall yet.
    pub(super) fn is_away(&self) -> bool {
        let over = self.over();
        over.is_some_and(|over| AWAY.contains(&-over))
    }

    /// For how long the tracks have pushed against the wall, if they have.
    pub(super) fn pushed_for(&self, drive: Drive) -> Option<Duration> {
        let over = self.over().filter(|over| *over > INSIDE)?;
        let ahead = self.wall?.ahead(self.pose);
        let seconds = over / (drive.forward * ahead).max(0.01);
        let time = Duration::try_from_secs_f64(seconds).unwrap_or(LONGEST);
        (drive.forward > 0.0 && ahead > TOWARDS).then(|| time.min(LONGEST))
    }

    /// Metres by which the robot would be inside the wall.
    fn over(&self) -> Option<f64> {
        Some(RADIUS - self.wall?.distance(self.pose)?)
    }
}
