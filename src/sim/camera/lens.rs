//! The camera's pose and lens: where each pixel of the frame is in the rendered image, which is
//! level and without distortion. The lens follows Brown and Conrady: k1 and k2 shift a point along
//! the radius, p1 and p2 aside too. Shares no code with `vision`, which corrects all this, so that an
//! error in one is not masked by the same error in the other.

use vision::Camera;

use super::floor::PATCH;
use super::texture::Pixel;
use super::view::{Canvas, HEIGHT, WIDTH};
use crate::world::settings::CameraSettings;

/// Most steps to find where the distortion comes from, and the error, in focal lengths, at which the
/// search ends.
const MAX_STEPS: usize = 200;
const CLOSE: f64 = 1e-7;
/// Columns and rows of the canvas beyond those that the frame shows.
const MARGIN: f64 = 2.0;
/// Largest slope of a ray of the canvas.
const STEEPEST: f64 = 4.0;

/// Pose and lens, with the source of each pixel in the rendered image.
pub(super) struct Lens {
    camera: Camera,
    pub(super) canvas: Canvas,
    /// Computed for the first frame: most simulated robots never take one.
    sources: Vec<Source>,
    /// The four pixels around each source of a row, and the weights of the right and the lower ones.
    row: Box<[Row; 6]>,
    pub(super) frame: Vec<Pixel>,
}

/// Slopes of a ray to the right and down, per unit of length ahead.
#[derive(Debug, Clone, Copy, Default)]
struct Slopes {
    right: f64,
    down: f64,
}

/// A place between four pixels.
#[derive(Clone, Copy)]
struct Source {
    /// Index of the upper left pixel.
    index: u32,
    /// Weights of the pixels to the right of it and of those below it, in 256ths.
    right: u8,
    below: u8,
}

type Row = [Pixel; WIDTH];

impl Lens {
    pub(super) fn new(settings: &CameraSettings) -> Lens {
        let camera = settings.calibrated();
        Lens {
            camera,
            canvas: canvas(&camera),
            sources: Vec::new(),
            row: Box::new([[[0; 4]; WIDTH]; 6]),
            frame: vec![[0; 4]; WIDTH * HEIGHT],
        }
    }

    /// Takes a frame of the rendered image.
    pub(super) fn take(&mut self, rendered: &[Pixel]) {
        if self.sources.is_empty() {
            self.sources = sources(&self.camera, self.canvas);
        }
        let width = self.canvas.width;
        let [upper, upper_right, lower, lower_right, right, below] = &mut *self.row;
        let rows = self.frame.chunks_exact_mut(WIDTH);
        for (pixels, sources) in rows.zip(self.sources.chunks_exact(WIDTH)) {
            for (column, source) in sources.iter().enumerate() {
                let from = &rendered[source.index as usize..];
                upper[column] = from[0];
                upper_right[column] = from[1];
                lower[column] = from[width];
                lower_right[column] = from[width + 1];
                right[column] = [source.right; 4];
                below[column] = [source.below; 4];
            }
            mix_in(upper, upper_right, right);
            mix_in(lower, lower_right, right);
            mix_in(upper, lower, below);
            pixels.copy_from_slice(upper);
        }
    }
}

/// Mixes a row with another one, whose share in each byte is given in 256ths.
fn mix_in(row: &mut Row, other: &Row, shares: &Row) {
    let others = other.as_flattened().iter().zip(shares.as_flattened());
    for (byte, (other, share)) in row.as_flattened_mut().iter_mut().zip(others) {
        // Of 256 shares of a byte each, nothing overflows; with checks the loop handles one byte at a
        // time.
        let share = u16::from(*share);
        let sum = u16::from(*byte).wrapping_mul(256_u16.wrapping_sub(share));
        *byte = (sum.wrapping_add(u16::from(*other).wrapping_mul(share)) >> 8) as u8;
    }
}

/// Returns the image that covers all that the frame shows, whose outermost rays are those of the
/// frame's edge.
fn canvas(camera: &Camera) -> Canvas {
    let focal = camera.focal[0].max(camera.focal[1]);
    let across = (0..WIDTH).flat_map(|column| [(column, 0), (column, HEIGHT - 1)]);
    let along = (0..HEIGHT).flat_map(|row| [(0, row), (WIDTH - 1, row)]);
    let mut least = Slopes::default();
    let mut most = Slopes::default();
    for (column, row) in across.chain(along) {
        let ray = turned(camera, straightened(camera, column, row, None));
        least.right = least.right.min(ray.right);
        least.down = least.down.min(ray.down);
        most.right = most.right.max(ray.right);
        most.down = most.down.max(ray.down);
    }
    let pixels = |slope: f64| (slope.min(STEEPEST) * focal + MARGIN).ceil() as usize;
    let left = pixels(-least.right);
    let horizon = pixels(-least.down);
    Canvas {
        width: (left + pixels(most.right)).next_multiple_of(PATCH),
        height: horizon + pixels(most.down),
        left,
        horizon,
        focal: focal as f32,
        eye: camera.height as f32,
    }
}

fn sources(camera: &Camera, canvas: Canvas) -> Vec<Source> {
    let mut sources = Vec::with_capacity(WIDTH * HEIGHT);
    for row in 0..HEIGHT {
        let mut last = None;
        for column in 0..WIDTH {
            let straight = straightened(camera, column, row, last);
            last = Some(straight);
            sources.push(Source::new(turned(camera, straight), canvas));
        }
    }
    sources
}

/// Returns where a lens without distortion would show a pixel, starting to search `near`.
fn straightened(camera: &Camera, column: usize, row: usize, near: Option<Slopes>) -> Slopes {
    let wanted = Slopes {
        right: (column as f64 - camera.centre[0]) / camera.focal[0],
        down: (row as f64 - camera.centre[1]) / camera.focal[1],
    };
    let mut found = near.unwrap_or(wanted);
    for _ in 0..MAX_STEPS {
        let seen = bent(camera, found);
        let right = wanted.right - seen.right;
        let down = wanted.down - seen.down;
        found.right += right;
        found.down += down;
        if right.abs().max(down.abs()) < CLOSE {
            break;
        }
    }
    found
}

/// Applies the distortion.
fn bent(camera: &Camera, Slopes { right: x, down: y }: Slopes) -> Slopes {
    let [k1, k2, p1, p2] = camera.distortion;
    let r2 = x * x + y * y;
    let along = k1 * r2 + k2 * r2 * r2;
    Slopes {
        right: x + x * along + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        down: y + y * along + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    }
}

/// Turns a ray from the camera's axes to level ones.
fn turned(camera: &Camera, ray: Slopes) -> Slopes {
    let (sin, cos) = camera.roll.to_radians().sin_cos();
    let right = ray.right * cos + ray.down * sin;
    let down = ray.down * cos - ray.right * sin;
    let (sin, cos) = camera.pitch.to_radians().sin_cos();
    let ahead = (cos + down * sin).max(1e-3);
    Slopes {
        right: right / ahead,
        down: (down * cos - sin) / ahead,
    }
}

impl Source {
    fn new(ray: Slopes, canvas: Canvas) -> Source {
        let fixed = |slope: f64, before: usize, length: usize| {
            let place = slope * f64::from(canvas.focal) + before as f64 - 0.5;
            (place.clamp(0.0, length as f64 - 1.01) * 256.0).round() as u32
        };
        let x = fixed(ray.right, canvas.left, canvas.width);
        let y = fixed(ray.down, canvas.horizon, canvas.height);
        Source {
            index: (y >> 8) * canvas.width as u32 + (x >> 8),
            right: (x & 255) as u8,
            below: (y & 255) as u8,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(distortion: [f64; 4]) -> CameraSettings {
        CameraSettings {
            hfov_degrees: Some(45.6),
            distortion: Some(distortion),
            ..CameraSettings::default()
        }
    }

    /// A frame of an image with one red row, this many rows below the horizon.
    fn red_row(settings: &CameraSettings, below: isize) -> Vec<Pixel> {
        let mut lens = Lens::new(settings);
        let Canvas {
            width,
            height,
            horizon,
            ..
        } = lens.canvas;
        let mut rendered = vec![[0; 4]; width * height];
        let row = horizon.checked_add_signed(below).unwrap();
        rendered[row * width..][..width].fill([255, 0, 0, 0]);
        lens.take(&rendered);
        lens.frame
    }

    /// The mean row of what is red in a column.
    fn row(frame: &[Pixel], column: usize) -> f64 {
        let weight = |row: usize| f64::from(frame[row * WIDTH + column][0]);
        let sum: f64 = (0..HEIGHT).map(weight).sum();
        let moment: f64 = (0..HEIGHT).map(|row| weight(row) * row as f64).sum();
        moment / sum
    }

    #[test]
    fn a_lens_bends_straight_lines_except_through_the_centre() {
        let settings = camera([-0.25, 0.0, 0.0, 0.0]);
        let middle = red_row(&settings, 0);
        assert!((row(&middle, 20) - row(&middle, 160)).abs() < 0.1);
        let upper = red_row(&settings, -100);
        // At the radius 0.449 instead of 0.262, in focal lengths of 381 pixels.
        let bend = row(&upper, 20) - row(&upper, 160);
        assert!((bend - 100.0 * 0.25 * (0.449_f64.powi(2) - 0.262_f64.powi(2))).abs() < 0.5);
    }

    #[test]
    fn a_level_lens_without_distortion_changes_nothing() {
        let frame = red_row(&camera([0.0; 4]), 0);
        for (index, pixel) in frame.iter().enumerate() {
            let red = if index / WIDTH == 120 { 255 } else { 0 };
            assert_eq!(pixel[0], red, "{index}");
        }
    }

    #[test]
    fn the_horizon_is_where_height_pitch_and_roll_put_it() {
        for (pitch, roll) in [
            (0.0, 0.0),
            (-10.0, 0.0),
            (10.0, 0.0),
            (3.5, 7.5),
            (-10.0, -4.0),
        ] {
            let settings = CameraSettings {
                pitch,
                roll,
                ..camera([0.0; 4])
            };
            let frame = red_row(&settings, 0);
            let focal: f64 = 160.0 / 22.8_f64.to_radians().tan();
            // Looking up moves the horizon down; it falls to the right by the tangent of the roll.
            let (sin, cos) = f64::to_radians(roll).sin_cos();
            let below = focal * f64::to_radians(pitch).tan();
            for column in [20, 160, 300] {
                let right = column as f64 - 159.5;
                let wanted = 119.5 + (below + right * sin) / cos;
                let found = row(&frame, column);
                assert!(
                    (found - wanted).abs() < 1.0,
                    "{pitch} {roll}: {found} {wanted}"
                );
            }
        }
    }

    #[test]
    fn every_pose_renders_all_that_the_frame_shows() {
        for pitch in [-45.0, -20.0, 0.0, 30.0] {
            for roll in [-30.0, 0.0, 30.0] {
                let settings = CameraSettings {
                    pitch,
                    roll,
                    ..CameraSettings::default()
                };
                let mut lens = Lens::new(&settings);
                let Canvas { width, height, .. } = lens.canvas;
                let mut rendered = vec![[9; 4]; width * height];
                let edge = [9, 9, 9, 200];
                rendered[..width].fill(edge);
                rendered[(height - 1) * width..].fill(edge);
                lens.take(&rendered);
                assert!(
                    lens.frame.iter().all(|pixel| *pixel == [9; 4]),
                    "{pitch} {roll}"
                );
            }
        }
    }
}
