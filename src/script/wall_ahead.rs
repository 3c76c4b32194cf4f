//! Whether the tracks have brought the robot to the wall that it saw before it came too close to see
//! its foot: the robot's place by what the tracks have made, and the wall's by its foot.

use std::time::Duration;

use crate::vision::{Camera, Drive, Feet, Glance, Stand, Wall};

/// From the middle of the robot to its edge, metres.
const RADIUS: f64 = 0.15;
/// Tracks that have brought it so far into a wall have not moved it to the end, metres.
const INSIDE: f64 = 0.05;
/// The robot must drive towards the wall: at least this share of its way.
const TOWARDS: f64 = 0.3;
/// A wall so much farther than the robot's edge, in metres, does not hold it; one beyond the last is not ahead.
const AWAY: std::ops::Range<f64> = 0.07..1.85;
/// It is not told to have been held for longer.
const LONGEST: Duration = Duration::from_secs(2);

/// See the module documentation. Of one motion.
#[derive(Debug, Default)]
pub(super) struct WallAhead {
    odometer: Option<f64>,
    stand: Stand,
    feet: Feet,
    wall: Option<Wall>,
    /// Feet were seen since the wall was last looked for.
    news: bool,
}

impl WallAhead {
    /// The odometer stands there now, metres.
    pub(super) fn drive_on(&mut self, odometer: f64, drive: Drive) {
        let way = odometer - self.odometer.unwrap_or(odometer);
        self.odometer = Some(odometer);
        if drive.forward != 0.0 {
            self.stand = self.stand.after(way, way / drive.forward * drive.turn);
        }
    }

    /// A look from there. A wall is looked for only where the robot may be close to one.
    pub(super) fn look(&mut self, glance: &Glance, camera: Camera, close: bool) {
        self.news |= self.feet.note(glance, camera, self.stand);
        if close && self.news {
            self.wall = self.feet.wall();
            self.news = false;
        }
    }

    /// Whether there is still way to go to the wall.
    pub(super) fn is_away(&self) -> bool {
        let over = self.over();
        over.is_some_and(|over| AWAY.contains(&-over))
    }

    /// For how long the tracks have pushed against the wall, if they have.
    pub(super) fn pushed_for(&self, drive: Drive) -> Option<Duration> {
        let over = self.over().filter(|over| *over > INSIDE)?;
        let ahead = self.wall?.ahead(self.stand);
        let seconds = over / (drive.forward * ahead).max(0.01);
        let time = Duration::try_from_secs_f64(seconds).unwrap_or(LONGEST);
        (drive.forward > 0.0 && ahead > TOWARDS).then(|| time.min(LONGEST))
    }

    /// Metres by which the robot would be in the wall.
    fn over(&self) -> Option<f64> {
        Some(RADIUS - self.wall?.distance(self.stand)?)
    }
}
