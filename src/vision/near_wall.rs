//! Sees that the robot stands close before something plain: so close that the camera sees no floor.

use super::camera::Camera;
use super::standstill::{Glance, LENS_HEIGHT};

/// The columns ahead of the robot, and the rows from above the horizon to the bottom: shares of the picture.
const COLUMNS: (f64, f64) = (0.42, 0.58);
const TOP: f64 = 0.36;
/// Strips of columns that are looked at one by one.
const STRIPS: usize = 3;
/// Rows on each side of an edge that are compared.
const REACH: usize = 3;
/// An edge is a step of the brightness by so much, of 255.
const EDGE: f64 = 2.5;
/// Darker or brighter pictures show no edges, even if there are some.
const SHOWS: std::ops::RangeInclusive<f64> = 20.0..=240.0;

/// How far the lens is, at most, from what fills the picture ahead, in metres. What the camera sees at the
/// height of its lens is upright; if there is no edge from there down to the bottom of the picture, it hides
/// all of the floor. `None` if floor may be seen, or if the picture does not tell.
pub fn nearer_than(glance: &Glance, camera: Camera) -> Option<f64> {
    let (w, h) = glance.size();
    let part = |share: f64, of: usize| (share * of as f64) as usize;
    let (left, right) = (part(COLUMNS.0, w), part(COLUMNS.1, w));
    let (top, strip) = (part(TOP, h), (right - left) / STRIPS);
    if strip == 0 || h < top + 2 * REACH + 1 {
        return None;
    }
    let plain = (0..STRIPS).all(|number| {
        let from = left + number * strip;
        let rows: Vec<f64> = (top..h)
            .map(|y| mean(&glance.row(y)[from..from + strip]))
            .collect();
        is_plain(&rows)
    });
    let focal = camera.focal_length(w as u32);
    plain.then(|| focal * LENS_HEIGHT / (h as f64 / 2.0))
}

fn mean(values: &[u8]) -> f64 {
    let sum: u32 = values.iter().map(|value| u32::from(*value)).sum();
    f64::from(sum) / values.len() as f64
}

/// Whether the brightness has no step from row to row.
fn is_plain(rows: &[f64]) -> bool {
    let sum = |rows: &[f64]| rows.iter().sum::<f64>() / REACH as f64;
    let step = |rows: &[f64]| sum(&rows[..REACH]) - sum(&rows[REACH + 1..]);
    let mut steps = rows.windows(2 * REACH + 1).map(step);
    rows.iter().all(|row| SHOWS.contains(row)) && steps.all(|step| step.abs() < EDGE)
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;
    use crate::vision::Image;

    fn seen(value: impl Fn(u32, u32) -> u8) -> Option<f64> {
        let mut glance = Glance::default();
        let picture = RgbImage::from_fn(320, 240, |x, y| Rgb([value(x, y); 3]));
        glance.take(&Image::from_rgb(&picture));
        nearer_than(&glance, Camera::default())
    }

    #[test]
    fn a_plain_wall_that_hides_the_floor_is_close() {
        let close = seen(|x, y| 150 + ((x * 7 + y * 13) % 5) as u8).unwrap();
        assert!((close - 0.63).abs() < 0.01, "{close}");
        // A corner of two walls, and a picture on the wall above the lens.
        assert!(seen(|x, _| if x < 170 { 150 } else { 130 }).is_some());
        assert!(seen(|_, y| if y < 70 { 90 } else { 130 }).is_some());
    }

    #[test]
    fn floor_ahead_darkness_and_glare_are_no_wall() {
        assert_eq!(seen(|_, y| if y < 225 { 150 } else { 140 }), None);
        assert_eq!(seen(|_, y| if y < 130 { 150 } else { 154 }), None);
        assert_eq!(seen(|_, _| 5), None);
        assert_eq!(seen(|_, _| 255), None);
    }

    #[test]
    fn tiny_pictures_tell_nothing() {
        for side in 0..16 {
            let mut glance = Glance::default();
            glance.take(&Image::from_rgb(&RgbImage::from_pixel(
                side,
                side,
                Rgb([90; 3]),
            )));
            assert_eq!(nearer_than(&glance, Camera::default()), None);
        }
    }
}
