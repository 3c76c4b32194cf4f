//! How late pictures show what the tracks were told. The radio link, the motors and the camera take their time,
//! and nobody says how much; so it is found out from the turns that begin and end in the pictures.

use std::time::Duration;

/// How many delays are tried, and how far apart they are: from none to 0.4 seconds.
pub(super) const TRIED: usize = 9;
const STEP: Duration = Duration::from_millis(50);
/// Radians between the turns that two delays expect, from which on a picture tells something.
const TELLS: f64 = 0.01;
/// Squared radians that one picture counts at most: a mistake must not count for ever.
const MOST: f64 = 0.05;
/// What earlier pictures told counts so much less with each that tells something.
const FADING: f64 = 0.995;
/// Another delay must fit so much better than the one that is believed.
const BETTER: f64 = 0.9;

/// How well each delay fits the pictures so far.
#[derive(Debug, Default)]
pub(super) struct Lateness {
    misfits: [f64; TRIED],
    believed: usize,
}

impl Lateness {
    /// The delays that are tried, the shortest first.
    pub(super) fn tried() -> [Duration; TRIED] {
        std::array::from_fn(|step| STEP * step as u32)
    }

    /// Which of them is believed.
    pub(super) fn believed(&self) -> usize {
        self.believed
    }

    /// Two frames show a turn, and that is what each of the delays expects; all in radians.
    pub(super) fn note(&mut self, seen: f64, expected: &[f64; TRIED]) {
        let largest = expected.iter().copied().fold(f64::MIN, f64::max);
        let smallest = expected.iter().copied().fold(f64::MAX, f64::min);
        if largest - smallest < TELLS {
            return;
        }
        for (misfit, turn) in self.misfits.iter_mut().zip(expected) {
            *misfit = *misfit * FADING + (seen - turn).powi(2).min(MOST);
        }
        let best = (0..TRIED).min_by(|one, other| {
            let misfit = |index: usize| self.misfits[index];
            misfit(*one).total_cmp(&misfit(*other))
        });
        self.believed = best
            .filter(|best| self.misfits[*best] < BETTER * self.misfits[self.believed])
            .unwrap_or(self.believed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Radians that a robot has turned by then, which turns for a second, stands for one, and so on.
    fn turned(time: f64) -> f64 {
        let time = time.max(0.0);
        (time / 2.0).floor() + (time % 2.0).min(1.0)
    }

    #[test]
    fn the_delay_of_pictures_is_found_in_two_turns() {
        for (late, found) in [(0.0, 0), (0.1, 2), (0.22, 4), (0.4, 8)] {
            let mut lateness = Lateness::default();
            for frame in 1..=30 {
                let now = f64::from(frame) / 8.0;
                let turn = |late: f64| turned(now - late) - turned(now - 0.125 - late);
                let expected = Lateness::tried().map(|delay| turn(delay.as_secs_f64()));
                lateness.note(0.9 * turn(late), &expected);
            }
            assert_eq!(lateness.believed(), found, "{late} s");
        }
    }

    #[test]
    fn a_robot_that_stands_or_turns_evenly_tells_nothing() {
        let mut lateness = Lateness::default();
        for seen in [0.3, -0.2, 0.0] {
            lateness.note(seen, &[0.1; TRIED]);
        }
        assert_eq!(lateness.misfits, [0.0; TRIED]);
    }
}
