//! How far it is to what stands ahead, by how fast it grows in the picture while the robot drives towards it.
//!
//! What is seen at the height of the lens is upright. Its columns keep their order and their brightness, and move away
//! from the middle as it comes nearer: so the last stripe or edge that is seen of a wall tells where the wall is, also
//! when the wall then fills the picture and looks plain. All is measured in what the tracks have made, so that it
//! does not matter how well they are calibrated, nor how high the lens is.

use std::collections::VecDeque;

/// Shorter ways between two pictures show too little growth, metres.
const SHORTEST: f64 = 0.025;
/// Distances that are tried, metres, each this much farther than the one before.
const NEAREST: f64 = 0.03;
const STEP: f64 = 1.12;
const STEPS: usize = 34;
/// By how many half-size pixels the robot may have swayed meanwhile.
const SWAY: i32 = 2;
/// So far the squared differences must exceed the camera's grain if nothing had grown.
const TELLS: f64 = 1.0;
/// The best distance must leave at most this share of them.
const FITS: f64 = 0.2;
/// Distances that fit nearly as well may be so much farther, as a factor.
const SHARP: f64 = 1.45;
/// Every so many columns are compared.
const EVERY: usize = 2;
/// Of an approach so many distances are kept, and so many must agree within this, in metres.
const MOST_SEEN: usize = 7;
const FEWEST_SEEN: usize = 3;
const AGREE: f64 = 0.05;

/// Metres from the lens to what is ahead now, if the way between these two pictures shows it. They are rows of
/// brightness at the height of the lens.
pub fn distance(before: &[f32], now: &[f32], way: f64) -> Option<f64> {
    if before.len() != now.len() || now.len() < 16 || way < SHORTEST {
        return None;
    }
    let least = |growth: f64| {
        let costs = (-SWAY..=SWAY).map(|sway| unlike(before, now, growth, f64::from(sway)));
        costs.fold(f64::INFINITY, f64::min)
    };
    let still = least(1.0);
    if still < TELLS {
        return None;
    }
    let far = |step: usize| NEAREST * STEP.powi(step as i32);
    let costs: Vec<f64> = (0..STEPS)
        .map(|step| least((far(step) + way) / far(step)))
        .collect();
    let (best, cost) = costs
        .iter()
        .copied()
        .enumerate()
        .min_by(|one, other| one.1.total_cmp(&other.1))?;
    let good = |cost_there: f64| cost_there < 2.0 * cost + 0.05 * still;
    let first = costs.iter().position(|cost| good(*cost))?;
    let last = costs.iter().rposition(|cost| good(*cost))?;
    let sharp = far(last) <= SHARP * far(first);
    let inside = 0 < best && best + 1 < STEPS;
    (inside && sharp && cost <= FITS * still).then(|| far(best))
}

/// The mean squared difference if all has grown by so much and moved to the right by so many pixels; a change of the
/// light of all does not count.
fn unlike(before: &[f32], now: &[f32], growth: f64, sway: f64) -> f64 {
    let middle = now.len() as f64 / 2.0 - 0.5;
    let (mut count, mut sum, mut squares) = (0.0, 0.0, 0.0);
    for x in (0..now.len()).step_by(EVERY) {
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

/// Where what is ahead will be reached, by several looks.
#[derive(Debug, Clone, Default)]
pub struct Looming {
    seen: VecDeque<f64>,
}

impl Looming {
    /// The odometer stands there, metres, and it is so far.
    pub fn note(&mut self, odometer: f64, distance: f64) {
        if self.seen.len() == MOST_SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back(odometer + distance);
    }

    /// Where the odometer stands when the lens arrives, metres: the last looks, if they agree.
    pub fn arrival(&self) -> Option<f64> {
        let mut last: Vec<f64> = self.seen.iter().rev().take(FEWEST_SEEN).copied().collect();
        last.sort_by(f64::total_cmp);
        let agree = last.len() == FEWEST_SEEN && last[FEWEST_SEEN - 1] - last[0] <= AGREE;
        agree.then(|| last[FEWEST_SEEN / 2])
    }
}
