//! Measures how far the camera has turned between two pictures, from the brightness along the
//! horizon.

use std::ops::Range;

use super::camera::Camera;
use crate::picture::{Image, Size, remove_shading};

/// Angle between two neighbouring samples of a skyline, radians.
const STEP: f64 = std::f64::consts::PI / 720.0;
/// The rows that are used: from this share of the height above the horizon to the horizon, where no
/// floor is seen.
const BAND: f64 = 0.14;
/// Least overlap of two skylines, as a share of their length.
const OVERLAP: f64 = 0.4;
/// Samples on each side of one of which the mean counts as shading. Samples nearer than this to an end, with fewer
/// on one side, are left out.
const SHADING: usize = 16;
/// The noise of a sample, and what is added to its brightness, of 255, so that dark ones count less.
const NOISE: f64 = 0.004;
const DARK: f64 = 8.0;
/// Least root mean square of the contrast for a measurement: less may be the lens's.
const LEAST_CONTRAST: f64 = 0.01;
/// Largest standard error of a measurement, radians.
const UNSURE: f64 = 0.0009;
/// The difference at the best fit must be at most this share of the mean over all shifts: near things do not move
/// as one.
const DISTINCT: f64 = 0.25;

/// The contrast along the horizon, from left to right, sampled at equal angles.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Skyline {
    places: Vec<f32>,
}

/// Reads skylines from the pictures of one camera.
#[derive(Debug, Clone)]
pub struct SkylineReader {
    camera: Camera,
    /// The size of the pictures for which the rest holds.
    size: Size,
    /// Rows in the column straight ahead.
    rows: Range<u32>,
    /// Rows by which the horizon is lower in each column; empty if it is level.
    shifts: Vec<f64>,
    /// The samples: a column, and the share of the next one.
    samples: Vec<(usize, f64)>,
}

impl SkylineReader {
    /// Creates a reader for this camera.
    pub fn new(camera: Camera) -> SkylineReader {
        SkylineReader {
            camera,
            size: Size::default(),
            rows: 0..0,
            shifts: Vec::new(),
            samples: Vec::new(),
        }
    }

    fn place_samples(&mut self, size: Size) {
        *self = SkylineReader {
            size,
            ..SkylineReader::new(self.camera)
        };
        let horizon = self.camera.horizon(size);
        let height = f64::from(size.height);
        let tilt = horizon.tilt(f64::from(size.width));
        let bottom = (horizon.y + 0.5).min(height - tilt);
        let top = (bottom - BAND * height).max(tilt);
        if bottom - top < 1.0 || size.width < 2 {
            return;
        }
        self.rows = top as u32..bottom as u32;
        if horizon.slope != 0.0 {
            let shift = |column| horizon.shift(f64::from(column));
            self.shifts = (0..size.width).map(shift).collect();
        }
        let row = f64::from(self.rows.start + self.rows.end) / 2.0;
        let bearing = |column: u32| {
            let column = f64::from(column);
            self.camera
                .bearing(column, row + horizon.shift(column), size)
        };
        self.samples = samples(&(0..size.width).map(bearing).collect::<Vec<_>>());
    }

    /// The skyline of a picture.
    pub fn read(&mut self, image: &Image) -> Skyline {
        if self.size != image.size() {
            self.place_samples(image.size());
        }
        let mut columns = vec![0u32; self.size.width as usize];
        for y in self.rows.clone() {
            if self.shifts.is_empty() {
                let row = image.luma_row(y);
                columns
                    .iter_mut()
                    .zip(row)
                    .for_each(|(sum, value)| *sum += u32::from(*value));
            } else {
                let last = f64::from(self.size.height) - 1.0;
                for (column, (sum, shift)) in columns.iter_mut().zip(&self.shifts).enumerate() {
                    let y = (f64::from(y) + shift).clamp(0.0, last);
                    *sum += u32::from(image.luma_row(y as u32)[column]);
                }
            }
        }
        let rows = self.rows.len() as f64;
        let mean = |column: usize| f64::from(columns[column]) / rows;
        let logarithm = |(column, part): &(usize, f64)| {
            (mean(*column) * (1.0 - part) + mean(column + 1) * part + DARK).ln() as f32
        };
        let mut places = self.samples.iter().map(logarithm).collect::<Vec<_>>();
        remove_shading(&mut places, SHADING, &mut Vec::new());
        let whole = SHADING..places.len().saturating_sub(SHADING);
        Skyline {
            places: places.get(whole).map(<[f32]>::to_vec).unwrap_or_default(),
        }
    }
}

/// The samples at equal angles between the bearings of at least two columns, which fall.
fn samples(bearings: &[f64]) -> Vec<(usize, f64)> {
    let last = bearings.len() - 1;
    let half = (bearings[0].min(-bearings[last]) / STEP) as i32;
    let mut column = 0;
    let mut samples = Vec::new();
    for place in -half..=half {
        let wanted = -f64::from(place) * STEP;
        while column + 1 < last && bearings[column + 1] > wanted {
            column += 1;
        }
        let left = bearings[column];
        let right = bearings[column + 1];
        let part = ((left - wanted) / (left - right)).clamp(0.0, 1.0);
        samples.push((column, part));
    }
    samples
}

impl Skyline {
    /// Measures how far the camera has turned since `before`, in radians, left positive. Searches
    /// within `reach` of the expected angle; `None` if no angle fits clearly.
    pub fn turned_since(&self, before: &Skyline, expected: f64, reach: f64) -> Option<f64> {
        let count = self.places.len();
        let square = |place: &f32| f64::from(*place).powi(2);
        let squares: f64 = self.places.iter().map(square).sum();
        if count != before.places.len() || squares < count as f64 * LEAST_CONTRAST.powi(2) {
            return None;
        }
        let most = (count as f64 * (1.0 - OVERLAP)) as isize;
        let place = |angle: f64| ((angle / STEP).round() as isize).clamp(-most, most);
        let first = place(expected - reach);
        let last = place(expected + reach);
        let costs: Vec<f64> = (first..=last)
            .map(|by| self.difference(before, by))
            .collect();
        let (best, least) = costs
            .iter()
            .copied()
            .enumerate()
            .min_by(|one, other| one.1.total_cmp(&other.1))?;
        // Near the best fit the difference is a parabola. At the border of the searched range the best
        // fit may lie outside.
        let left = *costs.get(best.checked_sub(1)?)?;
        let right = *costs.get(best + 1)?;
        let bend = left + right - 2.0 * least;
        let by = first + best as isize;
        let shared = count as f64 - by.abs() as f64;
        let error = STEP * ((least + NOISE * NOISE) / (bend * shared)).sqrt();
        let mean = costs.iter().sum::<f64>() / costs.len() as f64;
        let is_sure = error < UNSURE; // not if the error is infinite or not a number
        if !is_sure || least > DISTINCT * mean {
            return None;
        }
        let part = (0.5 * (left - right) / bend).clamp(-0.5, 0.5);
        Some((by as f64 + part) * STEP)
    }

    /// The mean squared difference of the skylines for a turn to the left by `by` samples, which moves
    /// everything that many samples to the right.
    fn difference(&self, before: &Skyline, by: isize) -> f64 {
        let by_right = by.max(0) as usize;
        let by_left = (-by).max(0) as usize;
        let pairs = self.places[by_right..]
            .iter()
            .zip(&before.places[by_left..]);
        let count = self.places.len() - by_right - by_left;
        let squares = pairs.map(|(one, other)| f64::from(one - other).powi(2));
        squares.sum::<f64>() / count as f64
    }
}

#[cfg(test)]
mod tests {
    use image::{Rgb, RgbImage};

    use super::*;

    const SIZE: Size = Size {
        width: 320,
        height: 240,
    };

    /// The view of a camera in a round room, turned to the left by `turned` radians.
    fn room(turned: f64, light: f64) -> Skyline {
        let camera = Camera::pinhole(60.0_f64.to_radians());
        let picture = RgbImage::from_fn(320, 240, |x, _| {
            let angle = turned + camera.bearing(f64::from(x), 102.0, SIZE);
            let value = 120.0
                + 50.0 * (angle * 3.0).sin()
                + 40.0 * (angle * 7.3).sin()
                + 20.0 * (angle * 17.0).cos();
            Rgb([(value * light).clamp(0.0, 255.0) as u8; 3])
        });
        SkylineReader::new(camera).read(&Image::from_rgb(&picture))
    }

    #[test]
    fn turns_are_measured_to_a_fifth_of_a_degree() {
        for turned in [-0.3, -0.1, -0.01, 0.0, 0.02, 0.15, 0.35] {
            let seen = room(1.0 + turned, 0.9).turned_since(&room(1.0, 1.0), turned * 0.7, 0.25);
            let seen = seen.unwrap();
            assert!(
                (seen - turned).abs() < 0.2_f64.to_radians() + 0.01 * turned.abs(),
                "{turned}: {seen}"
            );
        }
    }

    /// The skyline of a weakly lit room, or of a plain wall, by a camera that darkens the edges of its pictures.
    fn dark_edged(reader: &mut SkylineReader, turned: f64, contrast: f64) -> Skyline {
        let camera = reader.camera;
        let picture = RgbImage::from_fn(320, 240, |x, _| {
            let angle = turned + camera.bearing(f64::from(x), 102.0, SIZE);
            let scene = (angle * 3.0).sin() + (angle * 7.3).sin() + (angle * 17.0).cos();
            let out = (f64::from(x) - 159.5).abs() / 200.0;
            Rgb([((140.0 + contrast * scene) * (1.0 - 0.6 * out.powi(3))) as u8; 3])
        });
        reader.read(&Image::from_rgb(&picture))
    }

    #[test]
    fn dark_edges_are_not_counted() {
        let mut reader = SkylineReader::new(Camera::pinhole(60.0_f64.to_radians()));
        let turn = 0.1;
        let mut measure = |contrast| {
            let before = dark_edged(&mut reader, 1.0, contrast);
            dark_edged(&mut reader, 1.0 + turn, contrast).turned_since(&before, 0.0, 0.25)
        };
        let seen = measure(20.0).unwrap();
        assert!((seen - turn).abs() < 0.005, "{seen}");
        let weak = measure(6.0);
        assert!(
            weak.is_none_or(|seen| (seen - turn).abs() < 0.005),
            "{weak:?}"
        );
        assert_eq!(measure(0.0), None, "a plain wall");
    }

    #[test]
    fn turns_out_of_reach_and_plain_pictures_give_no_result() {
        assert_eq!(
            room(1.3, 1.0).turned_since(&room(1.0, 1.0), 0.0, 0.05),
            None
        );
        let mut reader = SkylineReader::new(Camera::default());
        let mut plain = |width, height| {
            let picture = RgbImage::from_pixel(width, height, Rgb([70; 3]));
            reader.read(&Image::from_rgb(&picture))
        };
        let large = plain(320, 240);
        assert_eq!(large.turned_since(&large, 0.0, 0.3), None);
        assert_eq!(large.turned_since(&room(1.0, 1.0), 0.0, 0.3), None);
        for side in [0, 1, 2, 3, 9] {
            let tiny = plain(side, side);
            assert_eq!(tiny.turned_since(&tiny, 0.1, 0.3), None);
        }
    }

    #[test]
    fn a_reader_follows_the_size_of_the_pictures() {
        let camera = Camera {
            roll: 4.0,
            ..Camera::default()
        };
        let picture = |width, height| {
            let luma = |x, y| Rgb([((x * 7 + y * 3) % 256) as u8; 3]);
            Image::from_rgb(&RgbImage::from_fn(width, height, luma))
        };
        let mut reader = SkylineReader::new(camera);
        for (width, height) in [(320, 240), (160, 120), (160, 240), (0, 0), (320, 240)] {
            let picture = picture(width, height);
            let alone = SkylineReader::new(camera).read(&picture);
            assert_eq!(reader.read(&picture), alone, "{width}x{height}");
        }
    }
}
