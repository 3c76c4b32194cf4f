//! The way that the robot has come since it left its station, by what its tracks were told. Known only
//! from an undocking that was asked for and confirmed, and only while nothing else moved the robot: a
//! dead link, a search of its own or a sleep of the machine makes all of it worthless.

use std::fmt;
use std::time::Duration;

use tokio::time::Instant;

use crate::robot::{Setpoint, Stroke, TrackPower};

/// See the module.
#[derive(Clone)]
pub struct Trail {
    /// `None`: it is not known how the robot came here.
    way: Option<Way>,
    told: Setpoint,
    since: Instant,
}

#[derive(Debug, Clone, Default)]
struct Way {
    strokes: Vec<Stroke>,
    /// Of all strokes together.
    length: f32,
    /// The setpoint of the last one, if it had only one.
    last: Option<Setpoint>,
}

impl Trail {
    /// Strokes of different setpoints shorter than this become one: with the usual calibration 45 mm of
    /// the busier track. In seconds at full power, as all lengths here.
    pub const FINEST: f32 = 0.1;
    /// The longest way that is remembered: about 90 m. Long before that the tracks have slipped too much
    /// for it to lead anywhere.
    pub const LONGEST: f32 = 200.0;

    /// The robot's position is not known.
    pub fn new(now: Instant) -> Trail {
        Trail {
            way: None,
            told: Setpoint::STOP,
            since: now,
        }
    }

    /// The robot has just left its station, by itself.
    pub fn begin(&mut self, now: Instant) {
        self.since = now;
        self.way = Some(Way::default());
    }

    /// How the robot came here is not known any more.
    pub fn lose(&mut self) {
        self.way = None;
    }

    /// What the tracks were told, from now on.
    pub fn tell(&mut self, setpoint: Setpoint, now: Instant) {
        self.note(now.saturating_duration_since(self.since));
        (self.since, self.told) = (now, setpoint);
    }

    /// From the station to where the robot is now, and known no more: what comes next is somebody
    /// else's. `None`: it is not known.
    pub fn take(&mut self, now: Instant) -> Option<Vec<Stroke>> {
        self.tell(self.told, now);
        self.way.take().map(|way| way.strokes)
    }

    /// The tracks have done what they were told for so long.
    fn note(&mut self, time: Duration) {
        let Some(way) = &mut self.way else {
            return;
        };
        if self.told.is_stop() || time.is_zero() {
            return;
        }
        let seconds = |power: TrackPower| {
            f32::from(power.get()) / f32::from(TrackPower::MAX) * time.as_secs_f32()
        };
        let stroke = Stroke {
            left: seconds(self.told.left),
            right: seconds(self.told.right),
        };
        way.add(stroke, self.told);
        if way.length > Trail::LONGEST {
            self.lose();
        }
    }
}

impl Way {
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

/// Without the way: nothing that the watchdog decides hangs on how it looks.
impl fmt::Debug for Trail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let known = self.way.is_some();
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

    /// The strokes of these setpoints, each for so many milliseconds.
    fn way(told: &[(Setpoint, u64)]) -> Option<Vec<Stroke>> {
        let mut now = Instant::now();
        let mut trail = Trail::new(now);
        trail.begin(now);
        for (setpoint, ms) in told {
            trail.tell(*setpoint, now);
            now += Duration::from_millis(*ms);
        }
        trail.take(now)
    }

    #[test]
    fn each_setpoint_is_a_stroke_as_long_as_it_was_on() {
        let told = [
            (at(50.0, 50.0), 2000),
            (Setpoint::STOP, 5000),
            (at(-100.0, 100.0), 500),
        ];
        let strokes = [stroke(1.0, 1.0), stroke(-0.5, 0.5)];
        assert_eq!(way(&told), Some(strokes.to_vec()));
    }

    #[test]
    fn what_is_told_again_and_what_is_short_makes_one_stroke() {
        let same = [(at(100.0, 50.0), 1000); 3];
        assert_eq!(way(&same), Some(vec![stroke(3.0, 1.5)]));
        let short = [
            (at(100.0, 0.0), 50),
            (at(0.0, 100.0), 50),
            (at(0.0, 100.0), 1000),
            (at(100.0, 100.0), 1000),
        ];
        let strokes = way(&short).unwrap();
        assert_eq!(strokes.len(), 2, "{strokes:?}");
        assert!((strokes[0].left - 0.05).abs() < 1e-6 && (strokes[0].right - 1.05).abs() < 1e-6);
    }

    #[test]
    fn a_stroke_of_two_setpoints_is_longer_by_neither() {
        let told = [
            (at(100.0, 0.0), 50),
            (at(0.0, 100.0), 100),
            (at(0.0, 100.0), 100),
        ];
        assert_eq!(way(&told).unwrap().len(), 2);
        let told = [(at(100.0, 0.0), 100), (at(0.0, 100.0), 100)];
        assert_eq!(way(&told).unwrap().len(), 2, "long enough");
    }

    #[test]
    fn nothing_is_known_before_the_station_was_left_and_after_the_way_was_lost_or_taken() {
        let now = Instant::now();
        let mut trail = Trail::new(now);
        trail.tell(at(50.0, 50.0), now);
        assert_eq!(trail.take(now + SECOND), None);
        trail.begin(now + SECOND);
        assert_eq!(trail.take(now + SECOND), Some(vec![]));
        assert_eq!(trail.take(now + SECOND), None);
        trail.begin(now);
        trail.lose();
        assert_eq!(trail.take(now), None);
    }

    #[test]
    fn what_the_tracks_did_before_is_no_part_of_it() {
        let now = Instant::now();
        let mut trail = Trail::new(now);
        trail.tell(at(50.0, 50.0), now);
        trail.begin(now + SECOND);
        trail.tell(at(50.0, 50.0), now + 3 * SECOND);
        assert_eq!(trail.take(now + 3 * SECOND), Some(vec![stroke(1.0, 1.0)]));
    }

    #[test]
    fn a_way_too_long_to_be_believed_is_not_known() {
        assert!(way(&[(at(100.0, -100.0), 200_000)]).is_some());
        assert_eq!(way(&[(at(100.0, -100.0), 200_001)]), None);
        assert_eq!(
            way(&[(at(100.0, 0.0), 150_000), (at(0.0, -100.0), 51_000)]),
            None
        );
    }

    #[test]
    fn the_rules_do_not_see_the_way_itself() {
        let now = Instant::now();
        let mut trail = Trail::new(now);
        assert_eq!(format!("{trail:?}"), "Trail { known: false, .. }");
        trail.begin(now);
        assert_eq!(format!("{trail:?}"), "Trail { known: true, .. }");
    }

    proptest! {
        #[test]
        fn no_way_is_longer_than_its_bound_and_none_of_its_sums_is_lost(
            told in prop::collection::vec((-4..=4i8, -4..=4i8, 0u64..5_000), 0..400),
        ) {
            let told: Vec<(Setpoint, u64)> = told
                .into_iter()
                .map(|(left, right, ms)| (at(f64::from(left) * 25.0, f64::from(right) * 25.0), ms))
                .collect();
            let sum = |track: fn(Setpoint) -> TrackPower| -> f32 {
                let seconds = |(setpoint, ms): &(Setpoint, u64)| {
                    f32::from(track(*setpoint).get()) / 90.0 * *ms as f32 / 1000.0
                };
                told.iter().map(seconds).sum()
            };
            let (left, right) = (sum(|one| one.left), sum(|one| one.right));
            let length: f32 = told
                .iter()
                .map(|(one, ms)| {
                    let fastest = one.left.get().abs().max(one.right.get().abs());
                    f32::from(fastest) / 90.0 * *ms as f32 / 1000.0
                })
                .sum();
            match way(&told) {
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
