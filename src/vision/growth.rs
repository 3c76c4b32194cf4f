//! Sees whether what fills the picture ahead grows while the robot drives towards it: so close before a wall
//! that no floor is seen, its edges from top to bottom (stripes, a frame, a corner) still tell whether the camera moves.

use super::near_wall::is_plain_strip;
use super::standstill::Glance;

/// The rows that are looked at, as shares of the height: from above the horizon, but not what is right before the robot.
const ROWS: (f64, f64) = (0.36, 0.95);
/// Columns of a strip that shows floor or not.
const STRIP: usize = 8;
/// A step of the brightness is taken over so many columns to each side.
const REACH: usize = 3;
/// Smaller steps are noise, or what the compression made of it; of 255.
const NOISE: f64 = 1.5;
/// The squares of all steps must sum up to this: about one clear edge.
const LEAST_ENERGY: f64 = 60.0;
/// So much of a picture must be comparable to the other.
const LEAST_SHARED: f64 = 0.6;
/// Shifts to the side, pixels: tracks never pull alike.
const SWAYS: [f64; 5] = [0.0, -1.0, 1.0, -2.0, 2.0];
/// What has not grown, or has grown this much, looks alike below the first and unlike above the second.
const ALIKE: f64 = 0.3;
const UNLIKE: f64 = 0.6;
/// Scales are tried from the least in such steps, up to the largest.
const SCALE_STEP: f64 = 1.015;
const LARGEST: f64 = 2.5;

/// The steps of the brightness from the left to the right in a picture that shows no floor ahead.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Breadth {
    /// Columns from the middle of the picture to the first step.
    first: f64,
    steps: Vec<f64>,
}

/// What two pictures say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Growth {
    /// Nothing has grown.
    Same,
    /// All has become larger by this factor.
    Grown(f64),
    /// The pictures do not tell.
    Unknown,
}

impl Breadth {
    /// Of a picture that shows no floor in its middle columns; those beside them count as far as they show none either.
    pub fn of(glance: &Glance) -> Option<Breadth> {
        let (w, h) = glance.size();
        let (top, bottom) = ((ROWS.0 * h as f64) as usize, (ROWS.1 * h as f64) as usize);
        if bottom <= top || w < 4 * STRIP {
            return None;
        }
        let plain = |left: usize| is_plain_strip(glance, left, left + STRIP);
        let middle = w / 2 / STRIP * STRIP;
        let mut left = middle;
        while left >= STRIP && plain(left - STRIP) {
            left -= STRIP;
        }
        let mut right = middle;
        while right + STRIP <= w && plain(right) {
            right += STRIP;
        }
        if right - left < 4 * STRIP {
            return None;
        }
        let mut sums = vec![0u32; right - left];
        for y in top..bottom {
            let row = &glance.row(y)[left..right];
            sums.iter_mut()
                .zip(row)
                .for_each(|(sum, value)| *sum += u32::from(*value));
        }
        let rows = (bottom - top) as f64;
        let steps = sums.windows(2 * REACH + 1).map(|columns| {
            let sum = |columns: &[u32]| f64::from(columns.iter().sum::<u32>());
            let step = sum(&columns[REACH + 1..]) - sum(&columns[..REACH]);
            let step = step / (REACH as f64 * rows);
            step.signum() * (step.abs() - NOISE).max(0.0)
        });
        Some(Breadth {
            first: (left + REACH) as f64 + 0.5 - w as f64 / 2.0,
            steps: steps.collect(),
        })
    }

    /// Whether all has grown since `before`: by the factor `least` or more if the robot has driven.
    pub fn since(&self, before: &Breadth, least: f64) -> Growth {
        if !(1.0..LARGEST).contains(&least)
            || energy(&self.steps).max(energy(&before.steps)) < LEAST_ENERGY
        {
            return Growth::Unknown;
        }
        let best = |scale: f64| {
            let costs = SWAYS.iter().map(|sway| self.unlike(before, scale, *sway));
            costs.flatten().fold(f64::INFINITY, f64::min)
        };
        let same = best(1.0);
        let (mut scale, mut grown) = (least, (f64::INFINITY, least));
        while scale <= LARGEST {
            let unlike = best(scale);
            if unlike < grown.0 {
                grown = (unlike, scale);
            }
            scale *= SCALE_STEP;
        }
        if same < ALIKE && grown.0 > UNLIKE {
            Growth::Same
        } else if same > UNLIKE && grown.0 < ALIKE {
            Growth::Grown(grown.1)
        } else {
            Growth::Unknown
        }
    }

    /// From 0, as if grown by that and shifted, to 1, nothing alike; `None` if too little can be compared.
    fn unlike(&self, before: &Breadth, scale: f64, sway: f64) -> Option<f64> {
        let (mut off, mut sum, mut shared) = (0.0, 0.0, 0);
        for (index, now) in self.steps.iter().enumerate() {
            let column = self.first + index as f64;
            let Some(then) = before.at((column - sway) / scale) else {
                continue;
            };
            shared += 1;
            off += (now - then) * (now - then);
            sum += now * now + then * then;
        }
        let enough = f64::from(shared) >= LEAST_SHARED * self.steps.len() as f64;
        (enough && sum >= LEAST_ENERGY).then(|| off / sum)
    }

    /// The step at a place between two columns.
    fn at(&self, column: f64) -> Option<f64> {
        let place = column - self.first;
        if place < 0.0 {
            return None;
        }
        let (index, part) = (place as usize, place.fract());
        let (left, right) = (self.steps.get(index)?, self.steps.get(index + 1)?);
        Some(left * (1.0 - part) + right * part)
    }
}

fn energy(steps: &[f64]) -> f64 {
    steps.iter().map(|step| step * step).sum()
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};
    use proptest::prelude::*;

    use super::*;
    use crate::vision::Image;

    /// A wall with stripes and grain, so far from the lens; `aside` turns the camera, in pixels.
    fn wall(distance: f64, aside: f64, contrast: f64, grain: u32) -> Option<Breadth> {
        let picture = RgbImage::from_fn(320, 240, |x, y| {
            let along = (f64::from(x) - 160.0 + aside) / 381.0 * distance + 0.07;
            let stripe = if (along / 0.18).floor() as i64 % 2 == 0 {
                contrast
            } else {
                0.0
            };
            let mixed = (x + 331 * y + 7919 * grain).wrapping_mul(0x9E37_79B1) >> 20;
            Rgb([(160.0 + stripe + f64::from(mixed % 9) - 4.0) as u8; 3])
        });
        let mut glance = Glance::default();
        glance.take(&Image::from_rgb(&picture));
        Breadth::of(&glance)
    }

    fn growth(before: f64, now: f64, aside: f64, contrast: f64) -> Growth {
        let least = 0.63 / (0.63 - (before - now).max(0.05));
        let (before, now) = (
            wall(before, 0.0, contrast, 1).unwrap(),
            wall(now, aside, contrast, 2).unwrap(),
        );
        now.since(&before, least)
    }

    #[test]
    fn a_wall_that_comes_nearer_grows_and_one_before_a_held_robot_does_not() {
        for before in [0.6, 0.5, 0.4, 0.3] {
            assert_eq!(growth(before, before, 0.0, 9.0), Growth::Same, "{before}");
            assert_eq!(growth(before, before, 2.0, 9.0), Growth::Same, "{before}");
            let Growth::Grown(scale) = growth(before, before - 0.06, 0.0, 9.0) else {
                panic!("{before}");
            };
            let truth = before / (before - 0.06);
            assert!((scale / truth - 1.0).abs() < 0.04, "{scale} {truth}");
        }
    }

    #[test]
    fn a_wall_without_edges_tells_nothing() {
        assert_eq!(growth(0.4, 0.4, 0.0, 0.0), Growth::Unknown);
        assert_eq!(growth(0.4, 0.34, 0.0, 0.0), Growth::Unknown);
    }

    #[test]
    fn floor_ahead_is_no_wall() {
        let mut glance = Glance::default();
        let floor = RgbImage::from_fn(320, 240, |_, y| Rgb([if y < 180 { 160 } else { 110 }; 3]));
        glance.take(&Image::from_rgb(&floor));
        assert_eq!(Breadth::of(&glance), None);
    }

    proptest! {
        #[test]
        fn any_pictures_are_compared(
            pixels in proptest::collection::vec(any::<u8>(), 80 * 30), w in 1u32..80, h in 1u32..30,
            least in -1e3f64..1e3,
        ) {
            let picture = RgbImage::from_fn(w, h, |x, y| Rgb([pixels[(y * 80 + x) as usize]; 3]));
            let mut glance = Glance::default();
            glance.take(&Image::from_rgb(&picture));
            if let Some(breadth) = Breadth::of(&glance) {
                breadth.since(&breadth, least);
            }
        }
    }
}
