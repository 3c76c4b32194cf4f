//! Estimates the delay between a command to the tracks and the pictures that show its effect. The
//! radio link, the motors and the camera all add to it, and none of them reports its share, so it
//! is estimated from the turns that begin and end in the pictures.

use std::time::Duration;

/// The number of delays that are compared, and the step between them: from 0 to 0.4 seconds.
pub(super) const CANDIDATES: usize = 9;
const STEP: Duration = Duration::from_millis(50);
/// A picture is used if the turns that the delays predict differ by at least this, in radians.
const MIN_SPREAD: f64 = 0.01;
/// Largest squared error of one picture that counts, in radians squared, so that an outlier does
/// not dominate for long.
const MAX_SQUARED_ERROR: f64 = 0.05;
/// The weight of earlier pictures is multiplied by this with each picture that is used.
const FADING: f64 = 0.995;
/// Another delay replaces the current one only if its misfit is less than this share of the current
/// misfit.
const BETTER: f64 = 0.9;

/// How well each delay fits the pictures so far.
#[derive(Debug, Default)]
pub(super) struct PictureDelay {
    misfits: [f64; CANDIDATES],
    selected: usize,
}

impl PictureDelay {
    /// The delays that are compared, the shortest first.
    pub(super) fn candidates() -> [Duration; CANDIDATES] {
        std::array::from_fn(|step| STEP * step as u32)
    }

    /// The index of the delay that is used.
    pub(super) fn selected(&self) -> usize {
        self.selected
    }

    /// Records the turn that two frames show and the turn that each delay predicts; all in radians.
    pub(super) fn note(&mut self, seen: f64, expected: &[f64; CANDIDATES]) {
        let largest = expected.iter().copied().fold(f64::MIN, f64::max);
        let smallest = expected.iter().copied().fold(f64::MAX, f64::min);
        if largest - smallest < MIN_SPREAD {
            return;
        }
        for (misfit, turn) in self.misfits.iter_mut().zip(expected) {
            *misfit = *misfit * FADING + (seen - turn).powi(2).min(MAX_SQUARED_ERROR);
        }
        let best = (0..CANDIDATES).min_by(|one, other| {
            let misfit = |index: usize| self.misfits[index];
            misfit(*one).total_cmp(&misfit(*other))
        });
        self.selected = best
            .filter(|best| self.misfits[*best] < BETTER * self.misfits[self.selected])
            .unwrap_or(self.selected);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Radians that a robot has turned by `time` if it alternately turns for a second and stands
    /// for a second.
    fn turned(time: f64) -> f64 {
        let time = time.max(0.0);
        (time / 2.0).floor() + (time % 2.0).min(1.0)
    }

    #[test]
    fn the_delay_of_pictures_is_found_in_two_turns() {
        for (late, found) in [(0.0, 0), (0.1, 2), (0.22, 4), (0.4, 8)] {
            let mut delay = PictureDelay::default();
            for frame in 1..=30 {
                let now = f64::from(frame) / 8.0;
                let turn = |late: f64| turned(now - late) - turned(now - 0.125 - late);
                let expected = PictureDelay::candidates().map(|delay| turn(delay.as_secs_f64()));
                delay.note(0.9 * turn(late), &expected);
            }
            assert_eq!(delay.selected(), found, "{late} s");
        }
    }

    #[test]
    fn constant_predictions_are_not_used() {
        let mut delay = PictureDelay::default();
        for seen in [0.3, -0.2, 0.0] {
            delay.note(seen, &[0.1; CANDIDATES]);
        }
        assert_eq!(delay.misfits, [0.0; CANDIDATES]);
    }
}
