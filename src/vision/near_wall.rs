//! Detects that the robot stands so close to something plain that the camera sees no floor.

use std::collections::VecDeque;

use super::camera::Camera;
use super::standstill::{HalfLuma, LENS_HEIGHT};

/// The columns ahead of the robot and the top row, as shares of the picture; rows are used from
/// there to the bottom.
const COLUMNS: (f64, f64) = (0.42, 0.58);
const TOP: f64 = 0.36;
/// Strips of columns that are evaluated separately.
const STRIPS: usize = 3;
/// Rows compared on each side of an edge.
const REACH: usize = 3;
/// Least step of brightness at an edge, of 255.
const EDGE: f64 = 2.5;
/// Most pictures of an approach that are kept, and the least number and least distance driven (in
/// metres) for a result.
const MAX_SEEN: usize = 24;
const FEWEST_SEEN: usize = 5;
const SHORTEST: f64 = 0.08;
/// Brightness within which edges can be seen; darker or brighter pictures may hide them.
const USABLE_BRIGHTNESS: std::ops::RangeInclusive<f64> = 20.0..=240.0;

/// The greatest possible distance, in metres, from the lens to what fills the picture ahead. What
/// the camera sees at the height of its lens is upright; if there is no edge from there down to the
/// bottom of the picture, it hides all of the floor. `None` if floor may be visible or the picture
/// is inconclusive.
pub fn nearer_than(luma: &HalfLuma, camera: Camera) -> Option<f64> {
    let (w, h) = luma.size();
    let part = |share: f64, of: usize| (share * of as f64) as usize;
    let (left, right) = (part(COLUMNS.0, w), part(COLUMNS.1, w));
    let (top, strip) = (part(TOP, h), (right - left) / STRIPS);
    if strip == 0 || h < top + 2 * REACH + 1 {
        return None;
    }
    let plain = (0..STRIPS).all(|number| {
        let from = left + number * strip;
        let rows: Vec<f64> = (top..h)
            .map(|y| mean(&luma.row(y)[from..from + strip]))
            .collect();
        is_plain(&rows)
    });
    let focal = camera.focal_length(w as u32);
    plain.then(|| focal * LENS_HEIGHT / (h as f64 / 2.0))
}

/// How far below the horizon the edge is that will be the last to leave the picture at the bottom
/// when the robot drives forward, usually the foot of what stands ahead. In half-size pixels, for
/// [`Approach`].
pub fn foot_ahead(luma: &HalfLuma) -> Option<f64> {
    let (w, h) = luma.size();
    let part = |share: f64| (share * w as f64) as usize;
    let (left, right, horizon) = (part(COLUMNS.0), part(COLUMNS.1), h / 2);
    if left == right || h < 4 * REACH {
        return None;
    }
    let rows: Vec<f64> = (horizon..h)
        .map(|y| mean(&luma.row(y)[left..right]))
        .collect();
    let steps: Vec<f64> = rows
        .windows(2 * REACH + 1)
        .map(|rows| step(rows).abs())
        .collect();
    let first = steps.iter().position(|step| *step >= EDGE)?;
    // The step is visible from REACH rows above the edge on and is largest at the edge.
    let near = &steps[first..steps.len().min(first + 2 * REACH + 1)];
    let (sum, weighted) = near
        .iter()
        .zip(0..)
        .fold((0.0, 0.0), |(sum, weighted), (step, row)| {
            (sum + step, weighted + step * f64::from(row))
        });
    Some((first + REACH) as f64 + 0.5 + weighted / sum)
}

/// Measures the distance to what is ahead from how fast its foot moves down in the picture while
/// the robot drives towards it. Depends neither on the height of the lens nor on whether the foot
/// is that of the wall or the edge of a skirting board.
#[derive(Debug, Clone, Default)]
pub struct Approach {
    /// Odometer readings in metres, each with the inverse of the rows below the horizon.
    seen: VecDeque<(f64, f64)>,
}

impl Approach {
    /// Adds a foot seen this many rows below the horizon at this odometer reading.
    pub fn note(&mut self, odometer: f64, rows: f64) {
        let inverse = 1.0 / rows.max(1.0);
        // Starts again if this is a different foot than before.
        let goes_on = |(_, last): &(f64, f64)| inverse <= last * 1.05 && inverse >= last * 0.7;
        if !self.seen.back().is_some_and(goes_on) {
            self.seen.clear();
        }
        if self.seen.len() == MAX_SEEN {
            self.seen.pop_front();
        }
        self.seen.push_back((odometer, inverse));
    }

    /// The odometer reading at which the lens is at the foot, metres; `None` while it is uncertain.
    pub fn arrival(&self) -> Option<f64> {
        let count = self.seen.len() as f64;
        let (first, last) = (self.seen.front()?, self.seen.back()?);
        if self.seen.len() < FEWEST_SEEN || last.0 - first.0 < SHORTEST {
            return None;
        }
        let sum =
            |value: fn(f64, f64) -> f64| self.seen.iter().map(|(x, y)| value(*x, *y)).sum::<f64>();
        let (x, y) = (sum(|x, _| x) / count, sum(|_, y| y) / count);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for (one, other) in &self.seen {
            let (dx, dy) = (one - x, other - y);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
        }
        // The line must fall and fit well.
        let straight = xy < 0.0 && xy * xy > 0.95 * xx * yy;
        straight.then(|| x - y * xx / xy)
    }
}

fn mean(values: &[u8]) -> f64 {
    let sum: u32 = values.iter().map(|value| u32::from(*value)).sum();
    f64::from(sum) / values.len() as f64
}

/// Whether the brightness has no step between neighbouring rows.
fn is_plain(rows: &[f64]) -> bool {
    let mut steps = rows.windows(2 * REACH + 1).map(step);
    rows.iter().all(|row| USABLE_BRIGHTNESS.contains(row)) && steps.all(|step| step.abs() < EDGE)
}

/// The difference between the rows above the middle one and those below it.
fn step(rows: &[f64]) -> f64 {
    let sum = |rows: &[f64]| rows.iter().sum::<f64>() / REACH as f64;
    sum(&rows[..REACH]) - sum(&rows[REACH + 1..])
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::vision::Image;

    fn seen(value: impl Fn(u32, u32) -> u8) -> Option<f64> {
        let mut luma = HalfLuma::default();
        let picture = RgbImage::from_fn(320, 240, |x, y| Rgb([value(x, y); 3]));
        luma.take(&Image::from_rgb(&picture));
        nearer_than(&luma, Camera::default())
    }

    #[test]
    fn a_plain_wall_that_hides_the_floor_is_close() {
        let close = seen(|x, y| 150 + ((x * 7 + y * 13) % 5) as u8).unwrap();
        assert!((close - 0.63).abs() < 0.01, "{close}");
        // A corner between two walls, and a picture on the wall above the lens.
        assert!(seen(|x, _| if x < 170 { 150 } else { 130 }).is_some());
        assert!(seen(|_, y| if y < 70 { 90 } else { 130 }).is_some());
    }

    #[test]
    fn floor_ahead_darkness_and_glare_are_not_a_wall() {
        assert_eq!(seen(|_, y| if y < 225 { 150 } else { 140 }), None);
        assert_eq!(seen(|_, y| if y < 130 { 150 } else { 154 }), None);
        assert_eq!(seen(|_, _| 5), None);
        assert_eq!(seen(|_, _| 255), None);
    }

    #[test]
    fn the_foot_of_a_wall_gives_its_distance() {
        let mut approach = Approach::default();
        for step in 0..12 {
            let driven = 0.02 * f64::from(step);
            let foot = 138.0 * 2.0 * 0.13 / (1.2 - driven);
            let mut luma = HalfLuma::default();
            let picture = RgbImage::from_fn(320, 240, |_, y| {
                Rgb([if f64::from(y) < 120.0 + foot {
                    150
                } else {
                    120
                }; 3])
            });
            luma.take(&Image::from_rgb(&picture));
            approach.note(driven, foot_ahead(&luma).unwrap());
        }
        let arrival = approach.arrival().unwrap();
        assert!((arrival - 1.2).abs() < 0.1, "{arrival}");
        approach.note(0.3, 3.0);
        assert_eq!(approach.arrival(), None);
    }

    #[test]
    fn tiny_pictures_give_no_result() {
        for side in 0..16 {
            let mut luma = HalfLuma::default();
            luma.take(&Image::from_rgb(&RgbImage::from_pixel(
                side,
                side,
                Rgb([90; 3]),
            )));
            assert_eq!(nearer_than(&luma, Camera::default()), None);
            assert_eq!(foot_ahead(&luma), None);
        }
    }
}
