//! The way back: the places that a robot has passed, computed from the motion of its tracks,
//! relative to where it stands now.

use crate::robot::Stroke;

use super::options::Calibration;

/// Least distance between two places of a way, in metres. It is not a multiple of [`STEP`], so that
/// the result does not depend on rounding.
const SPACING: f64 = 0.14;
/// If a way comes this near to itself, in metres, the loop is cut off there.
const CROSSING: f64 = 0.19;
/// Curves are computed in steps of this length of the faster track, in metres.
const STEP: f64 = 0.05;

/// Metres: `x` ahead of the robot, `y` to its left.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Waypoint {
    pub(super) x: f64,
    pub(super) y: f64,
}

impl Waypoint {
    fn distance(self, other: Waypoint) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }
}

#[derive(Debug, Clone, Copy)]
struct Pose {
    at: Waypoint,
    /// Radians, to the left.
    heading: f64,
}

/// Returns the places from where the robot stands to where the strokes began, the nearest first,
/// without loops. Empty if the strokes lead nowhere else.
pub(super) fn way_back(strokes: &[Stroke], calibration: Calibration) -> Vec<Waypoint> {
    let poses = walk(strokes, calibration);
    let Some(&now) = poses.last() else {
        return vec![];
    };
    let mut way: Vec<Waypoint> = Vec::new();
    for pose in poses.iter().rev() {
        let place = seen_from(now, pose.at);
        if let Some(crossed) = way.iter().position(|old| old.distance(place) < CROSSING) {
            way.truncate(crossed + 1);
        }
        if way
            .last()
            .is_none_or(|last| last.distance(place) >= SPACING)
        {
            way.push(place);
        }
    }
    // The first place is where the robot stands.
    way.split_off(1)
}

/// All poses of the strokes, the oldest first.
fn walk(strokes: &[Stroke], calibration: Calibration) -> Vec<Pose> {
    let mut pose = Pose {
        at: Waypoint { x: 0.0, y: 0.0 },
        heading: 0.0,
    };
    let mut poses = vec![pose];
    for stroke in strokes {
        let metres = |seconds: f32| f64::from(seconds) * calibration.full_speed;
        let steps = (metres(stroke.length()) / STEP).round().max(1.0);
        let (left, right) = (metres(stroke.left) / steps, metres(stroke.right) / steps);
        let turn = (right - left) / calibration.track_width;
        for _ in 0..steps as usize {
            let (way, heading) = ((left + right) / 2.0, pose.heading + turn / 2.0);
            pose = Pose {
                at: Waypoint {
                    x: pose.at.x + way * heading.cos(),
                    y: pose.at.y + way * heading.sin(),
                },
                heading: pose.heading + turn,
            };
            poses.push(pose);
        }
    }
    poses
}

fn seen_from(pose: Pose, place: Waypoint) -> Waypoint {
    let (x, y) = (place.x - pose.at.x, place.y - pose.at.y);
    let (sin, cos) = pose.heading.sin_cos();
    Waypoint {
        x: x * cos + y * sin,
        y: y * cos - x * sin,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    const CALIBRATION: Calibration = Calibration {
        track_width: 0.24,
        full_speed: 0.5,
    };

    fn ahead(metres: f64) -> Stroke {
        let seconds = (metres / CALIBRATION.full_speed) as f32;
        Stroke {
            left: seconds,
            right: seconds,
        }
    }

    fn turn(angle: f64) -> Stroke {
        let seconds = (angle * CALIBRATION.track_width / 2.0 / CALIBRATION.full_speed) as f32;
        Stroke {
            left: -seconds,
            right: seconds,
        }
    }

    fn way(strokes: &[Stroke]) -> Vec<(f64, f64)> {
        let round = |metres: f64| (metres * 100.0).round() / 100.0 + 0.0;
        let places = way_back(strokes, CALIBRATION);
        places.iter().map(|at| (round(at.x), round(at.y))).collect()
    }

    #[test]
    fn after_driving_ahead_the_way_back_is_behind() {
        assert_eq!(
            way(&[ahead(0.45)]),
            [(-0.15, 0.0), (-0.3, 0.0), (-0.45, 0.0)]
        );
    }

    #[test]
    fn after_a_turn_to_the_left_the_way_back_is_on_the_left() {
        let places = way(&[ahead(0.3), turn(PI / 2.0)]);
        assert_eq!(places, [(0.0, 0.15), (0.0, 0.3)]);
        let places = way(&[ahead(0.3), turn(-PI / 2.0)]);
        assert_eq!(places, [(0.0, -0.15), (0.0, -0.3)]);
    }

    #[test]
    fn a_curve_stays_a_curve() {
        // A quarter of a circle of one metre to the left.
        let (inner, outer) = (PI / 2.0 * 0.88, PI / 2.0 * 1.12);
        let stroke = Stroke {
            left: (inner / CALIBRATION.full_speed) as f32,
            right: (outer / CALIBRATION.full_speed) as f32,
        };
        let last = *way(&[stroke]).last().unwrap();
        assert!(
            (last.0 + 1.0).abs() < 0.02 && (last.1 - 1.0).abs() < SPACING + 0.02,
            "{last:?}"
        );
    }

    #[test]
    fn a_loop_is_left_out() {
        let square = [ahead(1.0), turn(PI / 2.0)];
        let round = [square, square, square, square].concat();
        let places = way(&[&[ahead(0.6)][..], &round, &[ahead(0.6)]].concat());
        let expected: Vec<(f64, f64)> = (1..=8).map(|i| (-0.15 * f64::from(i), 0.0)).collect();
        assert_eq!(places.len(), expected.len(), "{places:?}");
        for (place, expected) in places.iter().zip(expected) {
            assert!(
                (place.0 - expected.0).abs() < 0.1 && place.1.abs() < 0.02,
                "{places:?}"
            );
        }
    }

    #[test]
    fn without_motion_there_is_no_way() {
        assert_eq!(way(&[]), []);
        assert_eq!(way(&[turn(3.0)]), []);
        assert_eq!(way(&[ahead(1.0), turn(PI), ahead(1.0)]), []);
    }

    proptest! {
        #[test]
        fn the_way_ends_near_its_beginning_and_no_two_places_are_near(
            strokes in prop::collection::vec((-2.0..2.0f32, -2.0..2.0f32), 0..60),
        ) {
            let strokes: Vec<Stroke> =
                strokes.into_iter().map(|(left, right)| Stroke { left, right }).collect();
            let poses = walk(&strokes, CALIBRATION);
            let began = seen_from(*poses.last().unwrap(), poses[0].at);
            let places = way_back(&strokes, CALIBRATION);
            let last = places.last().copied().unwrap_or(Waypoint { x: 0.0, y: 0.0 });
            prop_assert!(last.distance(began) < CROSSING + SPACING);
            for (index, place) in places.iter().enumerate() {
                for other in &places[..index] {
                    prop_assert!(place.distance(*other) >= SPACING);
                }
            }
        }
    }
}
