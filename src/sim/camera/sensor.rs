//! What a cheap lens and sensor do to a picture: soft edges, pale colours, dark corners.

use super::texture::{Pixel, between};
use super::view::{HEIGHT, WIDTH};
use crate::world::settings::CameraSettings;

/// Bytes of a row.
const STRIDE: usize = WIDTH * 4;
/// Largest variance, square pixels, of one pass of the blur: three equal weights.
const MAX_VARIANCE: f64 = 2.0 / 3.0;

pub(super) struct Sensor {
    blur: Blur,
    /// The share of the colours that is replaced by grey, in 256ths.
    lost_saturation: u32,
    vignette: [f64; 3],
    /// The share of the light that reaches each byte of a frame, in 256ths less one; computed for
    /// the first frame.
    shares: Vec<u8>,
}

impl Sensor {
    pub(super) fn new(settings: &CameraSettings) -> Sensor {
        Sensor {
            blur: Blur::new(settings.softness),
            lost_saturation: 256 - (settings.saturation * 256.0).round() as u32,
            vignette: settings.vignette,
            shares: Vec::new(),
        }
    }

    /// Changes a frame; a perfect lens and sensor do nothing.
    pub(super) fn apply(&mut self, frame: &mut [Pixel]) {
        self.blur.apply(frame.as_flattened_mut());
        if self.lost_saturation > 0 {
            self.fade(frame);
        }
        if self.vignette != [0.0; 3] {
            self.darken_corners(frame);
        }
    }

    fn fade(&self, frame: &mut [Pixel]) {
        for pixel in frame {
            let [r, g, b, _] = pixel.map(u32::from);
            let grey = (77 * r + 150 * g + 29 * b) >> 8;
            *pixel = between(*pixel, [grey as u8; 4], self.lost_saturation);
        }
    }

    fn darken_corners(&mut self, frame: &mut [Pixel]) {
        if self.shares.is_empty() {
            self.shares = shares(self.vignette);
        }
        for (byte, share) in frame.as_flattened_mut().iter_mut().zip(&self.shares) {
            *byte = ((u16::from(*byte) * (u16::from(*share) + 1)) >> 8) as u8;
        }
    }
}

/// The light falls with the third power of the distance from the middle, as on genuine frames.
fn shares(vignette: [f64; 3]) -> Vec<u8> {
    let middle = [WIDTH, HEIGHT].map(|side| (side as f64 - 1.0) / 2.0);
    let corner = middle[0].hypot(middle[1]);
    let mut shares = Vec::with_capacity(STRIDE * HEIGHT);
    for row in 0..HEIGHT {
        for column in 0..WIDTH {
            let out = (column as f64 - middle[0]).hypot(row as f64 - middle[1]) / corner;
            let [r, g, b] = vignette.map(|lost| (256.0 * (1.0 - lost * out.powi(3)) - 1.0) as u8);
            shares.extend([r, g, b, 255]);
        }
    }
    shares
}

/// A blur that comes near to a Gaussian one: passes that mix each pixel with its neighbours.
struct Blur {
    passes: usize,
    /// The weight of each neighbour in a pass, in 256ths.
    neighbour: u16,
    /// A frame blurred along its rows only.
    across: Vec<u8>,
}

impl Blur {
    /// Creates a blur with this standard deviation, pixels.
    fn new(softness: f64) -> Blur {
        let variance = softness * softness;
        let passes = (variance / MAX_VARIANCE).ceil();
        Blur {
            passes: passes as usize,
            neighbour: (variance / passes.max(1.0) / 2.0 * 256.0).round() as u16,
            across: Vec::new(),
        }
    }

    fn apply(&mut self, frame: &mut [u8]) {
        for _ in 0..self.passes {
            self.across.clear();
            self.across.extend_from_slice(frame);
            for (row, to) in frame.chunks(STRIDE).zip(self.across.chunks_mut(STRIDE)) {
                let left = &row[..STRIDE - 8];
                mix_in([left, &row[8..]], self.neighbour, &mut to[4..STRIDE - 4]);
            }
            frame.copy_from_slice(&self.across);
            let inner = STRIDE..frame.len() - STRIDE;
            let neighbours = [&self.across[..], &self.across[2 * STRIDE..]];
            mix_in(neighbours, self.neighbour, &mut frame[inner]);
        }
    }
}

/// Mixes bytes with their neighbours on two sides, each of which has this weight in 256ths.
fn mix_in([one, other]: [&[u8]; 2], weight: u16, to: &mut [u8]) {
    // Of at most 256 shares of a byte each, nothing overflows; with checks the loop handles one byte
    // at a time, and took a sixth of the time of tests with pictures.
    let rest = 256_u16.wrapping_sub(2_u16.wrapping_mul(weight));
    for ((byte, one), other) in to.iter_mut().zip(one).zip(other) {
        let neighbours = (u16::from(*one) + u16::from(*other)).wrapping_mul(weight);
        let sum = u16::from(*byte)
            .wrapping_mul(rest)
            .wrapping_add(neighbours)
            .wrapping_add(128);
        *byte = (sum >> 8) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame_of(pixel: Pixel) -> Vec<Pixel> {
        vec![pixel; WIDTH * HEIGHT]
    }

    fn applied(settings: CameraSettings, mut frame: Vec<Pixel>) -> Vec<Pixel> {
        let mut sensor = Sensor::new(&settings);
        sensor.apply(&mut frame);
        frame
    }

    #[test]
    fn the_default_changes_nothing() {
        let mut frame = frame_of([9, 200, 77, 0]);
        frame[5000] = [255, 0, 0, 0];
        assert_eq!(applied(CameraSettings::default(), frame.clone()), frame);
    }

    #[test]
    fn softness_is_the_standard_deviation_of_the_blur() {
        for softness in [0.3, 0.7, 1.0, 1.6] {
            let settings = CameraSettings {
                softness,
                ..CameraSettings::default()
            };
            let mut frame = frame_of([0; 4]);
            let [row, column] = [120, 160];
            for beside in 0..3 {
                frame[row * WIDTH + column + beside] = [252; 4];
            }
            let seen = applied(settings, frame);
            let light = |index: usize| f64::from(seen[index][0]);
            let lit = (0..seen.len()).filter(|index| seen[*index][0] > 0);
            let sum: f64 = lit.clone().map(light).sum();
            let moment = |place: fn(usize) -> f64| {
                let places = lit.clone().map(|index| light(index) * place(index).powi(2));
                places.sum::<f64>() / sum
            };
            assert!((sum / 756.0 - 1.0).abs() < 0.05, "{softness}: {sum}");
            let down = moment(|index| (index / WIDTH) as f64 - 120.0).sqrt();
            let across = moment(|index| (index % WIDTH) as f64 - 161.0);
            let across = (across - 2.0 / 3.0).sqrt();
            assert!((down - softness).abs() < 0.12, "{softness}: {down} rows");
            assert!(
                (across - softness).abs() < 0.12,
                "{softness}: {across} columns"
            );
        }
    }
}
