//! Where the robot was last blocked. If it has only turned on the spot since then, its next motion
//! begins against the same obstacle. If that obstacle has a plain surface, the pictures do not
//! change, whether the robot moves or not, so the pictures alone could not show the blockage.

use std::f64::consts::PI;
use std::ops::Range;
use std::time::Duration;

use tokio::time::Instant;

use super::timed_motion::TimedMotion;
use crate::robot::MotionId;
use crate::vision::Verdict;

/// After this time the obstacle may be gone.
const LONGEST: Duration = Duration::from_secs(6);
/// A robot whose tracks have covered more than this distance since, in metres, is elsewhere.
const MAX_DISTANCE: f64 = 0.03;
/// The robot must have pushed for at least this long, in at least this many pictures; one that has
/// driven for longer is elsewhere.
const PUSHED: Range<Duration> = Duration::from_millis(700)..Duration::from_millis(1500);
const PICTURES: u32 = 3;
/// Least share of the motion that leads towards the obstacle: where no floor is seen ahead, and
/// where floor is seen (then only for straight motions).
const TOWARDS_CLOSE: f64 = 0.0;
const TOWARDS_ANY: f64 = 0.9;
/// Number of pictures in which floor may be seen by mistake.
const FLICKER: u32 = 1;

/// See the module documentation.
#[derive(Debug, Default)]
pub(super) struct LastObstacle {
    last: Option<Obstacle>,
    /// Set while the current motion may be blocked.
    candidate: Option<Obstacle>,
    /// The evidence of the current motion.
    evidence: Evidence,
}

#[derive(Debug, Clone, Copy)]
struct Obstacle {
    at: Instant,
    /// The last motion so far for which there were pictures.
    motion: MotionId,
    /// The odometer then, in metres.
    odometer: f64,
    /// The direction in which the robot pushed against it, in radians to the left.
    towards: f64,
}

/// What the pictures have shown since a motion began.
#[derive(Debug, Default)]
struct Evidence {
    pictures: u32,
    /// The share of the motion that leads towards the last obstacle, when the motion began.
    towards: f64,
    /// How many of the pictures may show floor ahead.
    floor: u32,
    moves: bool,
}

impl LastObstacle {
    /// Records whether the last pictures say that the robot is blocked in this motion. A turn on
    /// the spot is ignored, since it does not show where the obstacle is.
    pub(super) fn note(&mut self, blocked: bool, at: Instant, timed: TimedMotion) {
        let drives = timed.drive.forward != 0.0;
        self.candidate = (blocked && drives).then(|| Obstacle {
            at,
            motion: timed.motion,
            odometer: timed.odometer,
            towards: towards(timed),
        });
    }

    /// Records that a motion begins. The last obstacle is forgotten if a motion without pictures
    /// was in between, since the robot may then be anywhere.
    pub(super) fn begin(&mut self, at: Instant, timed: TimedMotion) {
        let seconds = at.saturating_duration_since(timed.since).as_secs_f64();
        let began = timed.odometer - timed.drive.forward * seconds;
        let last = self.candidate.take().or(self.last).filter(|obstacle| {
            timed.motion.0 == obstacle.motion.0 + 1
                && at.saturating_duration_since(obstacle.at) < LONGEST
                && (began - obstacle.odometer).abs() < MAX_DISTANCE
        });
        self.last = last.map(|obstacle| Obstacle {
            motion: timed.motion,
            ..obstacle
        });
        self.evidence = Evidence {
            towards: last.map_or(0.0, |obstacle| (towards(timed) - obstacle.towards).cos()),
            ..Evidence::default()
        };
    }

    /// Forgets the last obstacle.
    pub(super) fn forget(&mut self) {
        (self.last, self.candidate) = (None, None);
    }

    /// Records the verdict of a comparison of two pictures; `close` means that no floor is seen
    /// ahead. Returns since when the robot has been blocked, if the last obstacle blocks it again.
    pub(super) fn look(
        &mut self,
        at: Instant,
        verdict: Verdict,
        close: bool,
        timed: TimedMotion,
    ) -> Option<Instant> {
        let evidence = &mut self.evidence;
        evidence.pictures += 1;
        evidence.floor += u32::from(!close);
        evidence.moves |= verdict == Verdict::Moves;
        let pushes = if evidence.floor <= FLICKER {
            evidence.towards > TOWARDS_CLOSE
        } else {
            evidence.towards > TOWARDS_ANY && timed.drive.turn == 0.0
        };
        let drives = self.last.is_some() && timed.drive.forward != 0.0;
        let long = PUSHED.contains(&at.saturating_duration_since(timed.since));
        let still = !evidence.moves && evidence.pictures >= PICTURES;
        (drives && pushes && long && still).then_some(timed.since)
    }
}

/// The direction in which the tracks push.
fn towards(timed: TimedMotion) -> f64 {
    let backwards = timed.drive.forward < 0.0;
    timed.heading + if backwards { PI } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Drive;

    const EVERY: Duration = Duration::from_millis(66);

    /// A robot is blocked while driving ahead, then drives at `forward` m/s, turned by `turned`
    /// radians and `driven` metres from there, and `seen` is what its pictures show for a second.
    /// Returns after how many seconds the blockage is reported.
    fn blocked_after(forward: f64, turned: f64, driven: f64, seen: (Verdict, bool)) -> Option<f64> {
        let (mut last_obstacle, start) = (LastObstacle::default(), Instant::now());
        let timed = |motion, since, forward, heading, odometer| TimedMotion {
            motion: MotionId(motion),
            since,
            drive: Drive { forward, turn: 0.0 },
            odometer,
            heading,
        };
        last_obstacle.note(true, start, timed(1, start, 0.2, 1.0, 5.0));
        last_obstacle.begin(start + EVERY, timed(2, start, 0.0, 2.0, 5.0));
        let since = start + 2 * EVERY;
        (0..15).find_map(|number| {
            let (at, way) = (since + number * EVERY, forward * 0.066 * f64::from(number));
            let now = timed(3, since, forward, 1.0 + turned, 5.0 + driven + way);
            if number == 0 {
                last_obstacle.begin(at, now);
            }
            let blocked_since = last_obstacle.look(at, seen.0, seen.1, now)?;
            assert_eq!(blocked_since, since);
            Some((at - since).as_secs_f64())
        })
    }

    const PLAIN: (Verdict, bool) = (Verdict::Unknown, true);
    const FLOOR: (Verdict, bool) = (Verdict::Unknown, false);

    #[test]
    fn a_robot_that_pushes_against_the_same_obstacle_again_is_noticed_within_a_second() {
        for (forward, turned) in [(0.2, 0.0), (0.1, 1.0), (0.3, -1.2), (-0.2, PI)] {
            let seconds = blocked_after(forward, turned, 0.0, PLAIN).unwrap();
            assert!((0.6..0.9).contains(&seconds), "{seconds}");
        }
        assert!(blocked_after(0.2, 0.3, 0.0, FLOOR).is_some());
    }

    #[test]
    fn a_robot_that_drives_elsewhere_or_moves_is_not_blocked() {
        for (forward, turned) in [(0.2, PI), (0.2, 1.7), (-0.2, 0.0), (0.0, 0.0)] {
            assert_eq!(blocked_after(forward, turned, 0.0, PLAIN), None);
        }
        assert_eq!(blocked_after(0.2, 0.0, -0.1, PLAIN), None);
        assert_eq!(blocked_after(0.2, 0.0, 0.0, (Verdict::Moves, true)), None);
        assert_eq!(blocked_after(0.2, 1.0, 0.0, FLOOR), None);
    }

    #[test]
    fn a_blocked_turn_on_the_spot_is_not_recorded() {
        let (mut last_obstacle, start) = (LastObstacle::default(), Instant::now());
        let turning = TimedMotion {
            motion: MotionId(1),
            since: start,
            drive: Drive {
                forward: 0.0,
                turn: 1.0,
            },
            odometer: 0.0,
            heading: 0.0,
        };
        last_obstacle.note(true, start, turning);
        assert!(last_obstacle.candidate.is_none());
    }

    #[test]
    fn a_motion_without_pictures_or_enough_time_clears_the_obstacle() {
        let (mut last_obstacle, start) = (LastObstacle::default(), Instant::now());
        let timed = |motion| TimedMotion {
            motion: MotionId(motion),
            since: start,
            drive: Drive {
                forward: 0.2,
                turn: 0.0,
            },
            odometer: 0.0,
            heading: 0.0,
        };
        last_obstacle.note(true, start, timed(1));
        last_obstacle.begin(start, timed(3));
        assert!(last_obstacle.last.is_none());
        last_obstacle.note(true, start, timed(3));
        last_obstacle.note(false, start, timed(3));
        last_obstacle.begin(start, timed(4));
        assert!(last_obstacle.last.is_none());
        last_obstacle.note(true, start, timed(3));
        last_obstacle.begin(start + LONGEST, timed(4));
        assert!(last_obstacle.last.is_none());
    }
}
