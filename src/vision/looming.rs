//! Measures the distance to what is ahead from how fast it grows in the picture while the robot
//! drives towards it.
//!
//! What is seen at the height of the lens is upright. Its columns keep their order and brightness
//! and move away from the centre as it comes nearer. The last stripe or edge that is seen of a wall
//! therefore gives the wall's position, even if the wall then fills the picture and looks plain.
//! All distances are in metres of the odometer, so neither its calibration nor the height of the
//! lens matters.

use std::collections::VecDeque;

use super::standstill::LENS_AHEAD;

/// Least distance driven between two pictures; a shorter one shows too little growth, metres.
const SHORTEST: f64 = 0.025;
/// The candidate distances: the nearest in metres, the factor between neighbours and their number.
const NEAREST: f64 = 0.03;
const STEP: f64 = 1.12;
const STEPS: usize = 34;
/// The sway that is allowed between the pictures, half-size pixels.
const SWAY: i32 = 2;
/// Least mean squared difference without growth for a measurement; it must exceed the camera's
/// noise.
const MIN_CHANGE: f64 = 1.0;
/// The best distance must leave at most this share of that difference.
const MAX_RESIDUAL: f64 = 0.2;
/// Greatest ratio between the farthest and the nearest distance that fit nearly as well as the
/// best.
const MAX_SPREAD: f64 = 1.45;
/// Only every nth column is compared.
const COLUMN_STEP: usize = 2;
/// Most measurements that are kept of an approach, how many of the last must agree, and how
/// closely, metres.
const MAX_SEEN: usize = 7;
const FEWEST_SEEN: usize = 2;
const AGREE: f64 = 0.05;

/// Measures the distance in metres from the lens to what is ahead now, from the growth between two
/// pictures that are `way` metres apart; `None` if it does not show. The pictures are rows of
/// brightness at the height of the lens; `turned` is how many of their pixels the robot should have
/// turned to the left meanwhile, according to its tracks.
pub fn distance(before: &[f32], now: &[f32], way: f64, turned: f64) -> Option<f64> {
    if before.len() != now.len() || now.len() < 16 || way < SHORTEST {
        return None;
    }
    let slack = SWAY + (0.1 * turned.abs()) as i32;
    let least = |growth: f64, aside: f64| {
        let costs =
            (-slack..=slack).map(|sway| difference(before, now, growth, aside + f64::from(sway)));
        costs.fold(f64::INFINITY, f64::min)
    };
    let still = least(1.0, turned);
    if still < MIN_CHANGE {
        return None;
    }
    let far = |step: usize| NEAREST * STEP.powi(step as i32);
    let costs: Vec<f64> = (0..STEPS)
        .map(|step| {
            let growth = (far(step) + way) / far(step);
            let aside = turned * (1.0 + LENS_AHEAD / far(step) + (growth - 1.0) / 2.0);
            least(growth, aside)
        })
        .collect();
    let (best, cost) = costs
        .iter()
        .copied()
        .enumerate()
        .min_by(|one, other| one.1.total_cmp(&other.1))?;
    let good = |cost_there: f64| cost_there < 2.0 * cost + 0.05 * still;
    let first = costs.iter().position(|cost| good(*cost))?;
    let last = costs.iter().rposition(|cost| good(*cost))?;
    let sharp = far(last) <= MAX_SPREAD * far(first);
    let inside = 0 < best && best + 1 < STEPS;
    (inside && sharp && cost <= MAX_RESIDUAL * still).then(|| far(best))
}

/// The mean squared difference if the picture has grown by this factor and shifted to the right by
/// `sway` pixels; ignores a uniform change of brightness.
fn difference(before: &[f32], now: &[f32], growth: f64, sway: f64) -> f64 {
    let middle = now.len() as f64 / 2.0 - 0.5;
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for x in (0..now.len()).step_by(COLUMN_STEP) {
        let from = middle + (x as f64 - middle - sway) / growth;
        if from < 0.0 {
            continue;
        }
        let index = from as usize;
        let (Some(left), Some(right)) = (before.get(index), before.get(index + 1)) else {
            continue;
        };
        let there = f64::from(*left) + f64::from(right - left) * from.fract();
        let off = f64::from(now[x]) - there;
        (count, sum, squares) = (count + 1.0, sum + off, squares + off * off);
    }
    let count = f64::max(count, 1.0);
    let mean: f64 = sum / count;
    squares / count - mean * mean
}

/// Combines several measurements into the odometer reading at which the robot arrives.
#[derive(Debug, Clone, Default)]
pub struct Looming {
    seen: VecDeque<f64>,
}

impl Looming {
    /// Adds a distance measured at this odometer reading, both in metres.
    pub fn note(&mut self, odometer: f64, distance: f64) {
        if self.seen.len() == MAX_SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back(odometer + distance);
    }

    /// The odometer reading at which the lens arrives, metres; `None` unless the last measurements
    /// agree.
    pub fn arrival(&self) -> Option<f64> {
        let mut last: Vec<f64> = self.seen.iter().rev().take(FEWEST_SEEN).copied().collect();
        last.sort_by(f64::total_cmp);
        let agree = last.len() == FEWEST_SEEN && last[FEWEST_SEEN - 1] - last[0] <= AGREE;
        agree.then(|| last[FEWEST_SEEN / 2])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A row of brightness of a wall `far` metres ahead with edges at these positions, in metres to
    /// the right. The lens has turned to the left by `turned` pixels; the noise depends on `noise`.
    fn wall(far: f64, edges: &[f64], turned: f64, noise: u32) -> Vec<f32> {
        let focal = 190.0;
        let column = |column: u32| {
            let x = (f64::from(column) - 79.5 - turned) * far / focal;
            let stripes = edges.iter().filter(|edge| x > **edge).count();
            let mixed = (column + noise * 7919).wrapping_mul(0x2C1B_3C6D) >> 24;
            let grain = mixed as f32 / 256.0 - 0.5;
            if stripes % 2 == 0 {
                150.0 + grain
            } else {
                143.0 + grain
            }
        };
        (0..160).map(column).collect()
    }

    #[test]
    fn stripes_that_move_apart_give_the_distance_of_a_wall() {
        for (edges, far) in [
            (&[-0.12, 0.06][..], 0.4),
            (&[-0.07, 0.1], 0.3),
            (&[0.04], 0.15),
        ] {
            let (before, now) = (wall(far + 0.1, edges, 0.0, 1), wall(far, edges, 0.0, 2));
            let seen = distance(&before, &now, 0.1, 0.0).unwrap();
            assert!((seen / far - 1.0).abs() < 0.25, "{far}: {seen}");
        }
    }

    #[test]
    fn a_plain_wall_and_one_that_comes_no_nearer_give_no_distance() {
        let plain = (wall(0.4, &[], 0.0, 1), wall(0.3, &[], 0.0, 2));
        assert_eq!(distance(&plain.0, &plain.1, 0.1, 0.0), None);
        let held = (wall(0.3, &[0.05], 0.0, 1), wall(0.3, &[0.05], 0.0, 2));
        assert_eq!(distance(&held.0, &held.1, 0.1, 0.0), None);
        assert_eq!(distance(&[], &[], 0.1, 0.0), None);
    }

    #[test]
    fn measurements_that_disagree_give_no_arrival() {
        let mut looming = Looming::default();
        looming.note(1.0, 0.4);
        assert_eq!(looming.arrival(), None);
        looming.note(1.1, 0.29);
        assert!((looming.arrival().unwrap() - 1.4).abs() < 0.02);
        looming.note(1.15, 0.1);
        assert_eq!(looming.arrival(), None);
    }

    proptest! {
        #[test]
        fn any_rows_give_no_distance_or_a_positive_one(
            rows in proptest::collection::vec(any::<u8>(), 100), way in -1e3f64..1e3, turned in -1e2f64..1e2,
        ) {
            let rows: Vec<f32> = rows.into_iter().map(f32::from).collect();
            let seen = distance(&rows[..50], &rows[50..], way, turned);
            prop_assert!(seen.is_none_or(|far| far > 0.0));
        }
    }
}
