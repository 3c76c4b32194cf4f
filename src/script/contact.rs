//! Where the robot was last blocked. If it has only turned on the spot since then, its next motion
//! begins against the same obstacle. If that obstacle has a plain surface, the pictures do not
//! change, whether the robot moves or not, so the pictures alone could not show the blockage.

use std::f64::consts::PI;
use std::ops::Range;
use std::time::Duration;

use tokio::time::Instant;

use super::going::Going;
use crate::robot::MotionId;
use crate::vision::Verdict;

/// After this time the obstacle may be gone.
const LONGEST: Duration = Duration::from_secs(6);
/// A robot whose tracks have covered more than this distance since, in metres, is elsewhere.
const AWAY: f64 = 0.03;
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
pub(super) struct Contact {
    last: Option<Held>,
    /// Set while the current motion may be blocked.
    perhaps: Option<Held>,
    /// The evidence of the current motion.
    shown: SoFar,
}

#[derive(Debug, Clone, Copy)]
struct Held {
    at: Instant,
    /// The last motion for which there were pictures.
    motion: MotionId,
    /// The odometer then, in metres.
    odometer: f64,
    /// The direction in which its tracks pushed, in radians to the left.
    towards: f64,
}

/// What the pictures have shown since a motion began.
#[derive(Debug, Default)]
struct SoFar {
    pictures: u32,
    /// The share of the motion that leads towards the last obstacle, when the motion began.
    towards: f64,
    /// How many of the pictures may show floor ahead.
    floor: u32,
    moves: bool,
}

impl Contact {
    /// Records whether the last pictures say that the robot is blocked in this motion. A turn on
    /// the spot is ignored, since it does not show where the obstacle is.
    pub(super) fn note(&mut self, held: bool, at: Instant, going: Going) {
        let drives = going.drive.forward != 0.0;
        self.perhaps = (held && drives).then(|| Held {
            at,
            motion: going.motion,
            odometer: going.odometer,
            towards: towards(going),
        });
    }

    /// Records that a motion begins. The last obstacle is forgotten if a motion without pictures
    /// was in between, since the robot may then be anywhere.
    pub(super) fn begin(&mut self, at: Instant, going: Going) {
        let seconds = at.saturating_duration_since(going.since).as_secs_f64();
        let began = going.odometer - going.drive.forward * seconds;
        let last = self.perhaps.take().or(self.last).filter(|held| {
            going.motion.0 == held.motion.0 + 1
                && at.saturating_duration_since(held.at) < LONGEST
                && (began - held.odometer).abs() < AWAY
        });
        self.last = last.map(|held| Held {
            motion: going.motion,
            ..held
        });
        self.shown = SoFar {
            towards: last.map_or(0.0, |held| (towards(going) - held.towards).cos()),
            ..SoFar::default()
        };
    }

    /// Forgets the last obstacle.
    pub(super) fn forget(&mut self) {
        (self.last, self.perhaps) = (None, None);
    }

    /// Records the verdict of a comparison of two pictures; `close` means that no floor is seen
    /// ahead. Returns since when the robot has been blocked, if the last obstacle blocks it again.
    pub(super) fn look(
        &mut self,
        at: Instant,
        verdict: Verdict,
        close: bool,
        going: Going,
    ) -> Option<Instant> {
        let shown = &mut self.shown;
        shown.pictures += 1;
        shown.floor += u32::from(!close);
        shown.moves |= verdict == Verdict::Moves;
        let pushes = if shown.floor <= FLICKER {
            shown.towards > TOWARDS_CLOSE
        } else {
            shown.towards > TOWARDS_ANY && going.drive.turn == 0.0
        };
        let drives = self.last.is_some() && going.drive.forward != 0.0;
        let long = PUSHED.contains(&at.saturating_duration_since(going.since));
        let still = !shown.moves && shown.pictures >= PICTURES;
        (drives && pushes && long && still).then_some(going.since)
    }
}

/// The direction in which the tracks push.
fn towards(going: Going) -> f64 {
    let backwards = going.drive.forward < 0.0;
    going.heading + if backwards { PI } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::vision::Drive;

    const EVERY: Duration = Duration::from_millis(66);

    /// A robot is blocked while driving ahead, then drives at `forward` m/s, turned by `turned`
    /// radians and `driven` metres from there, and `seen` is what its pictures show for a second.
    /// Returns after how many seconds the blockage is reported.
    fn told(forward: f64, turned: f64, driven: f64, seen: (Verdict, bool)) -> Option<f64> {
        let (mut contact, start) = (Contact::default(), Instant::now());
        let going = |motion, since, forward, heading, odometer| Going {
            motion: MotionId(motion),
            since,
            drive: Drive { forward, turn: 0.0 },
            odometer,
            heading,
        };
        contact.note(true, start, going(1, start, 0.2, 1.0, 5.0));
        contact.begin(start + EVERY, going(2, start, 0.0, 2.0, 5.0));
        let since = start + 2 * EVERY;
        (0..15).find_map(|number| {
            let (at, way) = (since + number * EVERY, forward * 0.066 * f64::from(number));
            let now = going(3, since, forward, 1.0 + turned, 5.0 + driven + way);
            if number == 0 {
                contact.begin(at, now);
            }
            let held = contact.look(at, seen.0, seen.1, now)?;
            assert_eq!(held, since);
            Some((at - since).as_secs_f64())
        })
    }

    const PLAIN: (Verdict, bool) = (Verdict::Unknown, true);
    const FLOOR: (Verdict, bool) = (Verdict::Unknown, false);

    #[test]
    fn a_robot_that_pushes_against_the_same_obstacle_again_is_noticed_within_a_second() {
        for (forward, turned) in [(0.2, 0.0), (0.1, 1.0), (0.3, -1.2), (-0.2, PI)] {
            let seconds = told(forward, turned, 0.0, PLAIN).unwrap();
            assert!((0.6..0.9).contains(&seconds), "{seconds}");
        }
        assert!(told(0.2, 0.3, 0.0, FLOOR).is_some());
    }

    #[test]
    fn a_robot_that_drives_elsewhere_or_moves_is_not_blocked() {
        for (forward, turned) in [(0.2, PI), (0.2, 1.7), (-0.2, 0.0), (0.0, 0.0)] {
            assert_eq!(told(forward, turned, 0.0, PLAIN), None);
        }
        assert_eq!(told(0.2, 0.0, -0.1, PLAIN), None);
        assert_eq!(told(0.2, 0.0, 0.0, (Verdict::Moves, true)), None);
        assert_eq!(told(0.2, 1.0, 0.0, FLOOR), None);
    }

    #[test]
    fn a_blocked_turn_on_the_spot_is_not_recorded() {
        let (mut contact, start) = (Contact::default(), Instant::now());
        let turning = Going {
            motion: MotionId(1),
            since: start,
            drive: Drive {
                forward: 0.0,
                turn: 1.0,
            },
            odometer: 0.0,
            heading: 0.0,
        };
        contact.note(true, start, turning);
        assert!(contact.perhaps.is_none());
    }

    #[test]
    fn a_motion_without_pictures_or_enough_time_clears_the_obstacle() {
        let (mut contact, start) = (Contact::default(), Instant::now());
        let going = |motion| Going {
            motion: MotionId(motion),
            since: start,
            drive: Drive {
                forward: 0.2,
                turn: 0.0,
            },
            odometer: 0.0,
            heading: 0.0,
        };
        contact.note(true, start, going(1));
        contact.begin(start, going(3));
        assert!(contact.last.is_none());
        contact.note(true, start, going(3));
        contact.note(false, start, going(3));
        contact.begin(start, going(4));
        assert!(contact.last.is_none());
        contact.note(true, start, going(3));
        contact.begin(start + LONGEST, going(4));
        assert!(contact.last.is_none());
    }
}
