//! Measures the distance to what is ahead from how fast its foot moves down in the picture while
//! the robot drives towards it. Depends neither on the height of the lens nor on whether the foot
//! is that of the wall or the edge of a skirting board.

use std::collections::VecDeque;

/// Most pictures of an approach that are kept, and the least number and least distance driven (in
/// metres) for a result.
const MAX_SEEN: usize = 24;
const FEWEST_SEEN: usize = 5;
const SHORTEST: f64 = 0.08;
/// From one picture to the next, the inverse of a foot's rows falls by less than this share and
/// does not rise by more than that; otherwise it is another foot.
const SAME_FOOT: std::ops::RangeInclusive<f64> = 0.7..=1.05;
/// The square of the correlation with the distance driven must be greater than this.
const FITS: f64 = 0.95;

/// See the module documentation.
#[derive(Debug, Clone, Default)]
pub(super) struct Approach {
    /// Odometer readings in metres, each with the inverse of the rows below the horizon.
    seen: VecDeque<(f64, f64)>,
}

impl Approach {
    /// Adds a foot seen this many rows below the horizon at this odometer reading.
    pub(super) fn note(&mut self, odometer: f64, rows: f64) {
        let inverse = 1.0 / rows.max(1.0);
        let last = self.seen.back().map(|(_, last)| *last);
        if last.is_none_or(|last| !SAME_FOOT.contains(&(inverse / last))) {
            self.seen.clear();
        }
        if self.seen.len() == MAX_SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back((odometer, inverse));
    }

    /// The odometer reading at which the lens is at the foot, metres; `None` while it is uncertain.
    pub(super) fn arrival(&self) -> Option<f64> {
        let first = self.seen.front()?;
        let last = self.seen.back()?;
        if self.seen.len() < FEWEST_SEEN || last.0 - first.0 < SHORTEST {
            return None;
        }
        let count = self.seen.len() as f64;
        let x = self.seen.iter().map(|(x, _)| x).sum::<f64>() / count;
        let y = self.seen.iter().map(|(_, y)| y).sum::<f64>() / count;
        let mut xx = 0.0;
        let mut xy = 0.0;
        let mut yy = 0.0;
        for (one, other) in &self.seen {
            xx += (one - x).powi(2);
            xy += (one - x) * (other - y);
            yy += (other - y).powi(2);
        }
        // The line falls and fits well; where it reaches zero, the foot is below the lens.
        (xy < 0.0 && xy * xy > FITS * xx * yy).then(|| x - y * xx / xy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_foot_of_a_wall_that_comes_down_tells_where_the_wall_is() {
        let mut approach = Approach::default();
        for step in 0..20 {
            let odometer = 3.0 + 0.02 * f64::from(step);
            assert!(approach.arrival().is_none() || step > 4, "{step}");
            approach.note(odometer, 190.0 * 0.2 / (4.2 - odometer));
        }
        assert!((approach.arrival().unwrap() - 4.2).abs() < 0.01);
        approach.note(3.5, 12.0);
        assert_eq!(approach.arrival(), None, "another foot");
    }

    #[test]
    fn a_foot_that_stays_where_it_is_tells_nothing() {
        let mut approach = Approach::default();
        for step in 0..20 {
            approach.note(0.02 * f64::from(step), 40.0);
        }
        assert_eq!(approach.arrival(), None);
    }
}
