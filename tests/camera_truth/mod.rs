//! Statistics of camera frames, to compare simulated ones with genuine ones.

use std::f64::consts::{PI, TAU};
use std::fmt;
use std::path::Path;
use std::time::Duration;

use image::RgbImage;
use spykee::sim::{Firmware, Pose, Robot, World};
use spykee::wire::{Command, Report, Stream};

/// Directions in which a simulated robot looks, and so frames of each world.
const LOOKS: u32 = 12;
/// Time after which the automatic exposure has settled.
const SETTLED: Duration = Duration::from_secs(2);
const STEP: Duration = Duration::from_millis(20);
/// Side of the squares in the middle and in the corners of a picture, as a share of its height.
const SQUARE: f64 = 0.2;

/// The frames that a world's robot sees from its start, all around.
pub fn simulated(world: World) -> Vec<Vec<u8>> {
    let start = world.start_pose();
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    robot.execute(&Command::Stream {
        stream: Stream::Video,
        on: true,
    });
    let turned = |look: u32| start.heading + TAU * f64::from(look) / f64::from(LOOKS);
    (0..LOOKS)
        .filter_map(|look| {
            robot.place(Pose::new(start.x, start.y, turned(look)));
            last_frame(&mut robot)
        })
        .collect()
}

fn last_frame(robot: &mut Robot) -> Option<Vec<u8>> {
    let mut last = None;
    for _ in 0..SETTLED.div_duration_f64(STEP) as u32 {
        robot.step(STEP);
        for report in robot.take_reports() {
            if let Report::Video(jpeg) = report {
                last = Some(jpeg.to_vec());
            }
        }
    }
    last
}

/// The JPEG files of a folder, sorted by name.
pub fn frames_in(folder: &Path) -> Result<Vec<Vec<u8>>, String> {
    let told = |error: std::io::Error| format!("{}: {error}", folder.display());
    let mut files = Vec::new();
    for entry in folder.read_dir().map_err(told)? {
        let path = entry.map_err(told)?.path();
        if matches!(
            path.extension().and_then(|e| e.to_str()),
            Some("jpg" | "jpeg")
        ) {
            files.push(path);
        }
    }
    if files.is_empty() {
        return Err(format!("{}: no JPEG files", folder.display()));
    }
    files.sort();
    files
        .iter()
        .map(|file| std::fs::read(file).map_err(|error| format!("{}: {error}", file.display())))
        .collect()
}

/// What frames look like, in units of 0 to 255; its `Display` is a row below [`Statistics::HEAD`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Statistics {
    /// Bytes of the JPEG.
    pub bytes: f64,
    /// Brightness in the middle.
    pub middle: f64,
    /// Brightness in the corners.
    pub corners: f64,
    /// Red minus green, and green minus blue, in the middle.
    pub middle_cast: [f64; 2],
    /// The same in the corners.
    pub corner_cast: [f64; 2],
    /// Largest minus smallest colour, as a share of the largest.
    pub saturation: f64,
    /// Standard deviation of the noise, after Immerkaer.
    pub noise: f64,
    /// Mean absolute Laplacian.
    pub sharpness: f64,
    /// The gradient that one pixel in a hundred exceeds, per pixel.
    pub edges: f64,
}

impl Statistics {
    pub const HEAD: &str = "frames                bytes middle corner        cast \
                            corner cast  satur. noise sharp. edges";

    /// The mean of some frames; an error if one of them cannot be decoded.
    pub fn of(frames: &[Vec<u8>]) -> Result<Statistics, image::ImageError> {
        let mut sum = Statistics::default();
        for jpeg in frames {
            let picture = image::load_from_memory(jpeg)?.into_rgb8();
            sum.add(&Statistics::of_picture(&picture, jpeg.len()));
        }
        sum.divide(frames.len().max(1) as f64);
        Ok(sum)
    }

    fn of_picture(picture: &RgbImage, bytes: usize) -> Statistics {
        let side = (SQUARE * f64::from(picture.height())) as u32;
        let right = picture.width() - side;
        let bottom = picture.height() - side;
        let middle = mean_colour(picture, &[[right / 2, bottom / 2]], side);
        let corners = [[0, 0], [right, 0], [0, bottom], [right, bottom]];
        let corners = mean_colour(picture, &corners, side);
        let light = Light::of(picture);
        Statistics {
            bytes: bytes as f64,
            middle: middle.iter().sum::<f64>() / 3.0,
            corners: corners.iter().sum::<f64>() / 3.0,
            middle_cast: cast(middle),
            corner_cast: cast(corners),
            saturation: mean(picture.pixels().map(|pixel| saturation(pixel.0))),
            noise: light.noise(),
            sharpness: light.sharpness(),
            edges: light.edges(),
        }
    }

    fn fields(&mut self) -> [&mut f64; 11] {
        let [middle_red, middle_green] = &mut self.middle_cast;
        let [corner_red, corner_green] = &mut self.corner_cast;
        [
            &mut self.bytes,
            &mut self.middle,
            &mut self.corners,
            middle_red,
            middle_green,
            corner_red,
            corner_green,
            &mut self.saturation,
            &mut self.noise,
            &mut self.sharpness,
            &mut self.edges,
        ]
    }

    fn add(&mut self, other: &Statistics) {
        let mut other = *other;
        for (sum, value) in self.fields().into_iter().zip(other.fields()) {
            *sum += *value;
        }
    }

    fn divide(&mut self, count: f64) {
        for field in self.fields() {
            *field /= count;
        }
    }
}

impl fmt::Display for Statistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{:6.0} {:6.0} {:6.0} {:+5.1} {:+5.1} {:+5.1} {:+5.1} {:7.0} {:5.1} {:6.1} {:5.0}",
            self.bytes,
            self.middle,
            self.corners,
            self.middle_cast[0],
            self.middle_cast[1],
            self.corner_cast[0],
            self.corner_cast[1],
            self.saturation,
            self.noise,
            self.sharpness,
            self.edges,
        )
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let mut sum = 0.0;
    let mut count = 0.0;
    for value in values {
        sum += value;
        count += 1.0;
    }
    sum / f64::max(count, 1.0)
}

/// The mean red, green and blue of some squares, each given by its left and top.
fn mean_colour(picture: &RgbImage, squares: &[[u32; 2]], side: u32) -> [f64; 3] {
    [0, 1, 2].map(|channel| {
        mean(squares.iter().flat_map(|[left, top]| {
            (0..side * side).map(move |i| {
                f64::from(picture.get_pixel(left + i % side, top + i / side).0[channel])
            })
        }))
    })
}

fn cast([red, green, blue]: [f64; 3]) -> [f64; 2] {
    [red - green, green - blue]
}

fn saturation([red, green, blue]: [u8; 3]) -> f64 {
    let most = red.max(green).max(blue);
    let least = red.min(green).min(blue);
    255.0 * f64::from(most - least) / f64::from(most.max(1))
}

/// The brightness of a picture's pixels.
struct Light {
    width: usize,
    values: Vec<f64>,
}

impl Light {
    fn of(picture: &RgbImage) -> Light {
        let of_pixel = |pixel: &image::Rgb<u8>| {
            let [red, green, blue] = pixel.0.map(f64::from);
            0.299 * red + 0.587 * green + 0.114 * blue
        };
        Light {
            width: picture.width() as usize,
            values: picture.pixels().map(of_pixel).collect(),
        }
    }

    /// The pixels of each 3x3 square, row by row.
    fn squares(&self) -> impl Iterator<Item = [f64; 9]> {
        let rows = self.values.len() / self.width;
        (0..rows.saturating_sub(2)).flat_map(move |row| {
            (0..self.width.saturating_sub(2)).map(move |column| {
                std::array::from_fn(|i| self.values[(row + i / 3) * self.width + column + i % 3])
            })
        })
    }

    fn noise(&self) -> f64 {
        const MASK: [f64; 9] = [1.0, -2.0, 1.0, -2.0, 4.0, -2.0, 1.0, -2.0, 1.0];
        let of = |square: [f64; 9]| square.iter().zip(MASK).map(|(a, b)| a * b).sum::<f64>();
        (PI / 2.0).sqrt() / 6.0 * mean(self.squares().map(|square| of(square).abs()))
    }

    fn sharpness(&self) -> f64 {
        mean(
            self.squares()
                .map(|s| (s[1] + s[3] + s[5] + s[7] - 4.0 * s[4]).abs()),
        )
    }

    fn edges(&self) -> f64 {
        let of = |s: [f64; 9]| f64::hypot(s[5] - s[3], s[7] - s[1]) / 2.0;
        let mut gradients: Vec<_> = self.squares().map(of).collect();
        gradients.sort_by(f64::total_cmp);
        let exceeded = gradients.len() * 99 / 100;
        gradients.get(exceeded).copied().unwrap_or_default()
    }
}
