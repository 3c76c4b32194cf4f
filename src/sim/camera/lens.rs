//! Radial lens distortion (Brown-Conrady model: a point at distance r from the image centre, in
//! focal lengths, appears at r (1 + k1 r² + k2 r⁴)). Shares no code with `vision`, which corrects
//! the distortion, so that an error in one is not masked by the same error in the other.

use super::texture::{Pixel, mix};
use super::view::{HEIGHT, WIDTH};
use crate::sim::world::settings::CameraSettings;

/// Number of entries of the table that inverts the distortion.
const STEPS: usize = 4000;
/// Largest distance from the image centre that the table covers, in focal lengths.
const FARTHEST: f32 = 12.0;

/// A lens, with the source of each pixel in the renderer's undistorted image.
pub(super) struct Lens {
    /// Focal length of the undistorted image, in pixels; shorter than that of the distorted image
    /// if the corners of that one show more.
    pub(super) focal: f32,
    /// Empty for a lens without distortion.
    sources: Vec<Source>,
    frame: Vec<Pixel>,
}

/// A place between four pixels.
#[derive(Clone, Copy)]
struct Source {
    /// Index of the upper left pixel.
    index: u32,
    /// Weights of the pixels to the right of it and of those below it, in 256ths.
    right: u16,
    below: u16,
}

impl Lens {
    pub(super) fn new(settings: &CameraSettings) -> Lens {
        let focal = focal(settings);
        let distortion = settings.distortion();
        if distortion == [0.0, 0.0] {
            return Lens {
                focal,
                sources: Vec::new(),
                frame: Vec::new(),
            };
        }
        let inverse = InverseDistortion::new(distortion);
        let places: Vec<(f32, f32)> = (0..WIDTH * HEIGHT)
            .map(|index| {
                let (x, y) = from_middle(index);
                let distorted = x.hypot(y) / focal;
                let scale = inverse.undistorted(distorted) / distorted;
                (x / focal * scale, y / focal * scale)
            })
            .collect();
        let widest = places.iter().fold((0.0_f32, 0.0_f32), |(x, y), place| {
            (x.max(place.0.abs()), y.max(place.1.abs()))
        });
        let reach = (WIDTH as f32 / 2.0 - 1.0, HEIGHT as f32 / 2.0 - 1.0);
        let undistorted_focal = (reach.0 / widest.0).min(reach.1 / widest.1);
        Lens {
            focal: undistorted_focal,
            sources: places
                .iter()
                .map(|(right, down)| Source::at(*right, *down, undistorted_focal))
                .collect(),
            frame: vec![[0; 4]; WIDTH * HEIGHT],
        }
    }

    /// Applies the distortion to a rendered image.
    pub(super) fn distort(&mut self, undistorted: &[Pixel]) {
        let at = |index: usize| {
            undistorted
                .get(index)
                .map_or(0, |pixel| u32::from_le_bytes(*pixel))
        };
        for (pixel, source) in self.frame.iter_mut().zip(&self.sources) {
            let index = source.index as usize;
            let right = u32::from(source.right);
            let below = u32::from(source.below);
            let upper = mix(at(index), at(index + 1), right);
            let lower = mix(at(index + WIDTH), at(index + WIDTH + 1), right);
            *pixel = mix(upper, lower, below).to_le_bytes();
        }
    }

    /// Returns the last distorted image, or `undistorted` itself for a lens without distortion.
    pub(super) fn output<'a>(&'a self, undistorted: &'a [Pixel]) -> &'a [Pixel] {
        if self.sources.is_empty() {
            undistorted
        } else {
            &self.frame
        }
    }
}

impl Source {
    fn at(right: f32, down: f32, focal: f32) -> Source {
        let x = (right * focal + WIDTH as f32 / 2.0 - 0.5).clamp(0.0, WIDTH as f32 - 1.01);
        let y = (down * focal + HEIGHT as f32 / 2.0 - 0.5).clamp(0.0, HEIGHT as f32 - 1.01);
        let share = |place: f32| (place.fract() * 256.0) as u16;
        Source {
            index: y as u32 * WIDTH as u32 + x as u32,
            right: share(x),
            below: share(y),
        }
    }
}

/// Returns the focal length without distortion, in pixels.
fn focal(settings: &CameraSettings) -> f32 {
    let hfov = settings.hfov_degrees().to_radians() as f32;
    WIDTH as f32 / 2.0 / (hfov / 2.0).tan()
}

/// Returns how far a pixel's centre lies to the right of and below the image centre.
fn from_middle(index: usize) -> (f32, f32) {
    let column = index % WIDTH;
    let row = index / WIDTH;
    let off = |place: usize, length: usize| place as f32 + 0.5 - length as f32 / 2.0;
    (off(column, WIDTH), off(row, HEIGHT))
}

/// The inverse distortion: the distorted distance from the image centre for each undistorted one,
/// up to the distance at which the lens would fold the image.
struct InverseDistortion(Vec<f32>);

impl InverseDistortion {
    fn new([k1, k2]: [f64; 2]) -> InverseDistortion {
        let k1 = k1 as f32;
        let k2 = k2 as f32;
        let distorted = (0..STEPS).map(|step| {
            let r = distance(step as f32);
            r * (1.0 + r * r * (k1 + k2 * r * r))
        });
        let mut last = -1.0;
        InverseDistortion(
            distorted
                .take_while(|distorted| *distorted > std::mem::replace(&mut last, *distorted))
                .collect(),
        )
    }

    fn undistorted(&self, distorted: f32) -> f32 {
        let after = self.0.partition_point(|other| *other < distorted);
        let (Some(near), Some(far)) = (self.0.get(after.wrapping_sub(1)), self.0.get(after)) else {
            return distance(after.saturating_sub(1) as f32);
        };
        distance((after - 1) as f32 + (distorted - near) / (far - near))
    }
}

fn distance(step: f32) -> f32 {
    step * FARTHEST / STEPS as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(distortion: [f64; 2]) -> CameraSettings {
        CameraSettings {
            distortion: Some(distortion),
            ..CameraSettings::default()
        }
    }

    #[test]
    fn a_lens_bends_straight_lines_except_through_the_centre() {
        let mut lens = Lens::new(&lens([-0.25, 0.0]));
        let mut undistorted = vec![[0; 4]; WIDTH * HEIGHT];
        // A line along the upper edge of the undistorted image, and one through its centre.
        let lines = [8, HEIGHT / 2 - 1, HEIGHT / 2];
        for row in lines {
            undistorted[row * WIDTH..][..WIDTH].fill([255, 0, 0, 0]);
        }
        lens.distort(&undistorted);
        let seen = lens.output(&undistorted);
        let red = |column: usize, row: usize| seen[row * WIDTH + column][0] > 100;
        assert!((0..WIDTH).all(|column| red(column, HEIGHT / 2)));
        let upper = |column: usize| (0..60).find(|row| red(column, *row));
        let side = upper(20);
        let middle = upper(WIDTH / 2);
        assert!(
            side > middle.map(|row| row + 3),
            "{side:?} {middle:?}: no distortion"
        );
    }

    #[test]
    fn a_lens_without_distortion_changes_nothing() {
        let lens = Lens::new(&lens([0.0, 0.0]));
        let frame = vec![[7; 4]; 4];
        assert_eq!(lens.output(&frame), frame);
        assert!((lens.focal - 380.7).abs() < 0.5, "{}", lens.focal);
    }
}
