//! The path of the robot since it left its station, from the setpoints sent to it. Known only from
//! an undocking that was requested and confirmed, and only while nothing else moved the robot: a
//! lost link, a search of its own or a suspended machine makes all of it worthless.

use std::fmt;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{Setpoint, Stroke, TrackPower};

/// Records the path; see the module.
#[derive(Clone)]
pub struct Trail {
    /// `None` if the path is not known.
    path: Option<Path>,
    setpoint: Setpoint,
    since: Instant,
}

#[derive(Debug, Clone, Default)]
struct Path {
    strokes: Vec<Stroke>,
    /// The length of all strokes together.
    length: f32,
    /// The setpoint of the last stroke, if it had only one.
    last: Option<Setpoint>,
}

impl Trail {
    /// Strokes of different setpoints shorter than this are merged: with the usual calibration 45
    /// mm of the faster track. In seconds at full power, like all lengths here.
    pub const FINEST: f32 = 0.1;
    /// The longest path that is remembered: about 90 m. Long before that the tracks have slipped
    /// too much for the path to be of use.
    pub const LONGEST: f32 = 200.0;

    /// Begins without a known path.
    pub fn new(now: Instant) -> Trail {
        Trail {
            path: None,
            setpoint: Setpoint::STOP,
            since: now,
        }
    }

    /// The robot has just left its station on its own: a path begins.
    pub fn begin(&mut self, now: Instant) {
        self.since = now;
        self.path = Some(Path::default());
    }

    /// The path is no longer known.
    pub fn lose(&mut self) {
        self.path = None;
    }

    /// Notes the setpoint of the tracks from `now` on.
    pub fn record(&mut self, setpoint: Setpoint, now: Instant) {
        self.note(now.saturating_duration_since(self.since));
        (self.since, self.setpoint) = (now, setpoint);
    }

    /// Returns the path from the station to the robot's position and forgets it: what follows is
    /// not part of it. `None` if it is not known.
    pub fn take(&mut self, now: Instant) -> Option<Vec<Stroke>> {
        self.record(self.setpoint, now);
        self.path.take().map(|path| path.strokes)
    }

    /// The tracks have followed the last setpoint for `time`.
    fn note(&mut self, time: Duration) {
        let Some(path) = &mut self.path else {
            return;
        };
        if self.setpoint.is_stop() || time.is_zero() {
            return;
        }
        let seconds = |power: TrackPower| {
            f32::from(power.get()) / f32::from(TrackPower::MAX) * time.as_secs_f32()
        };
        let stroke = Stroke {
            left: seconds(self.setpoint.left),
            right: seconds(self.setpoint.right),
        };
        path.add(stroke, self.setpoint);
        if path.length > Trail::LONGEST {
            self.lose();
        }
    }
}

impl Path {
    fn add(&mut self, stroke: Stroke, setpoint: Setpoint) {
        self.length += stroke.length();
        let same = self.last == Some(setpoint);
        match self.strokes.last_mut() {
            Some(last) if same || last.length() < Trail::FINEST => {
                *last = last.and(stroke);
                self.last = Some(setpoint).filter(|_| same);
            }
            _ => {
                self.strokes.push(stroke);
                self.last = Some(setpoint);
            }
        }
    }
}

/// Omits the path: no decision of the watchdog depends on its shape.
impl fmt::Debug for Trail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = self.path.is_some();
        f.debug_struct("Trail")
            .field("known", &known)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn at(left: f64, right: f64) -> Setpoint {
        Setpoint::from_percent(left, right).unwrap()
    }

    fn stroke(left: f32, right: f32) -> Stroke {
        Stroke { left, right }
    }

    /// The strokes of these setpoints, each on for its milliseconds.
    fn path_of(setpoints: &[(Setpoint, u64)]) -> Option<Vec<Stroke>> {
        let mut now = Instant::now();
        let mut trail = Trail::new(now);
        trail.begin(now);
        for (setpoint, ms) in setpoints {
            trail.record(*setpoint, now);
            now += Duration::from_millis(*ms);
        }
        trail.take(now)
    }

    #[test]
    fn each_setpoint_is_a_stroke_as_long_as_it_was_on() {
        let setpoints = [
            (at(50.0, 50.0), 2000),
            (Setpoint::STOP, 5000),
            (at(-100.0, 100.0), 500),
        ];
        let strokes = [stroke(1.0, 1.0), stroke(-0.5, 0.5)];
        assert_eq!(path_of(&setpoints), Some(strokes.to_vec()));
    }

    #[test]
    fn repeated_and_short_setpoints_make_one_stroke() {
        let same = [(at(100.0, 50.0), 1000); 3];
        assert_eq!(path_of(&same), Some(vec![stroke(3.0, 1.5)]));
        let short = [
            (at(100.0, 0.0), 50),
            (at(0.0, 100.0), 50),
            (at(0.0, 100.0), 1000),
            (at(100.0, 100.0), 1000),
        ];
        let strokes = path_of(&short).unwrap();
        assert_eq!(strokes.len(), 2, "{strokes:?}");
        assert!((strokes[0].left - 0.05).abs() < 1e-6 && (strokes[0].right - 1.05).abs() < 1e-6);
    }

    #[test]
    fn a_stroke_of_two_setpoints_is_not_extended() {
        let setpoints = [
            (at(100.0, 0.0), 50),
            (at(0.0, 100.0), 100),
            (at(0.0, 100.0), 100),
        ];
        assert_eq!(path_of(&setpoints).unwrap().len(), 2);
        let setpoints = [(at(100.0, 0.0), 100), (at(0.0, 100.0), 100)];
        assert_eq!(path_of(&setpoints).unwrap().len(), 2, "long enough");
    }

    #[test]
    fn no_path_is_known_before_undocking_or_after_it_was_lost_or_taken() {
        let now = Instant::now();
        let mut trail = Trail::new(now);
        trail.record(at(50.0, 50.0), now);
        assert_eq!(trail.take(now + SECOND), None);
        trail.begin(now + SECOND);
        assert_eq!(trail.take(now + SECOND), Some(vec![]));
        assert_eq!(trail.take(now + SECOND), None);
        trail.begin(now);
        trail.lose();
        assert_eq!(trail.take(now), None);
    }

    #[test]
    fn motion_before_the_undocking_is_not_recorded() {
        let now = Instant::now();
        let mut trail = Trail::new(now);
        trail.record(at(50.0, 50.0), now);
        trail.begin(now + SECOND);
        trail.record(at(50.0, 50.0), now + 3 * SECOND);
        assert_eq!(trail.take(now + 3 * SECOND), Some(vec![stroke(1.0, 1.0)]));
    }

    #[test]
    fn a_path_longer_than_the_bound_is_forgotten() {
        assert!(path_of(&[(at(100.0, -100.0), 200_000)]).is_some());
        assert_eq!(path_of(&[(at(100.0, -100.0), 200_001)]), None);
        assert_eq!(
            path_of(&[(at(100.0, 0.0), 150_000), (at(0.0, -100.0), 51_000)]),
            None
        );
    }

    #[test]
    fn the_debug_output_omits_the_path() {
        let now = Instant::now();
        let mut trail = Trail::new(now);
        assert_eq!(format!("{trail:?}"), "Trail { known: false, .. }");
        trail.begin(now);
        assert_eq!(format!("{trail:?}"), "Trail { known: true, .. }");
    }

    proptest! {
        #[test]
        fn no_path_exceeds_its_bound_and_its_strokes_keep_their_sums(
            setpoints in prop::collection::vec((-4..=4i8, -4..=4i8, 0u64..5_000), 0..400),
        ) {
            let setpoints: Vec<(Setpoint, u64)> = setpoints
                .into_iter()
                .map(|(left, right, ms)| (at(f64::from(left) * 25.0, f64::from(right) * 25.0), ms))
                .collect();
            let sum = |track: fn(Setpoint) -> TrackPower| -> f32 {
                let seconds = |(setpoint, ms): &(Setpoint, u64)| {
                    f32::from(track(*setpoint).get()) / 90.0 * *ms as f32 / 1000.0
                };
                setpoints.iter().map(seconds).sum()
            };
            let (left, right) = (sum(|one| one.left), sum(|one| one.right));
            let length: f32 = setpoints
                .iter()
                .map(|(one, ms)| {
                    let fastest = one.left.get().abs().max(one.right.get().abs());
                    f32::from(fastest) / 90.0 * *ms as f32 / 1000.0
                })
                .sum();
            match path_of(&setpoints) {
                Some(strokes) => {
                    prop_assert!(length < Trail::LONGEST + 0.1);
                    prop_assert!(strokes.len() as f32 <= Trail::LONGEST / Trail::FINEST + 1.0);
                    let lefts: f32 = strokes.iter().map(|stroke| stroke.left).sum();
                    let rights: f32 = strokes.iter().map(|stroke| stroke.right).sum();
                    prop_assert!((lefts - left).abs() < 0.01 && (rights - right).abs() < 0.01);
                }
                None => prop_assert!(length > Trail::LONGEST - 0.1),
            }
        }
    }
}
