//! Image grain: slight noise, as in frames of small cameras.

use rand::rngs::StdRng;
use rand::{Rng, RngExt, SeedableRng};

use super::view::{HEIGHT, WIDTH};

/// Bytes of a frame before it is encoded.
const LEN: usize = WIDTH * HEIGHT * 4;
/// Number of possible offsets, in pixels, of the noise of a frame.
const SHIFTS: usize = 4096;
/// Range of the noise at strength 1, on the scale 0..=255.
const MAX_RANGE: f64 = 32.0;

/// Noise for frames: generated once, and added to each frame at a random offset.
pub(crate) struct Grain {
    /// 0..=`middle` * 2 for each byte of a frame, the same for all channels of a pixel.
    noise: Vec<u8>,
    middle: u8,
    random: StdRng,
}

impl Grain {
    /// Creates noise of this strength, 0..=1.
    pub(crate) fn new(strength: f64, seed: u64) -> Grain {
        let mut random = StdRng::seed_from_u64(seed);
        let middle = (strength.clamp(0.0, 1.0) * MAX_RANGE / 2.0).round() as u8;
        let mut bytes = vec![0; LEN / 4 + SHIFTS];
        random.fill_bytes(&mut bytes);
        let level = |byte: u8| (u16::from(byte) * (2 * u16::from(middle) + 1) / 256) as u8;
        let noise = bytes
            .into_iter()
            .flat_map(|byte| [level(byte); 4])
            .collect();
        Grain {
            noise,
            middle,
            random,
        }
    }

    /// Writes the frame with added noise to `grainy`.
    pub(crate) fn add_to(&mut self, pixels: &[u8], grainy: &mut [u8]) {
        if self.middle == 0 {
            return grainy.copy_from_slice(pixels);
        }
        let noise = &self.noise[self.random.random_range(0..SHIFTS) * 4..];
        for ((grainy, channel), noise) in grainy.iter_mut().zip(pixels).zip(noise) {
            *grainy = channel.saturating_add(*noise).saturating_sub(self.middle);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grain_is_weak_and_has_no_bias() {
        let mut pixels = vec![0; LEN];
        Grain::new(0.25, 5).add_to(&vec![100; LEN], &mut pixels);
        assert!(pixels.iter().all(|channel| (96..=104).contains(channel)));
        let mean = pixels
            .iter()
            .map(|channel| f64::from(*channel))
            .sum::<f64>()
            / LEN as f64;
        assert!((mean - 100.0).abs() < 0.5, "{mean}");
    }

    #[test]
    fn strength_zero_adds_no_grain() {
        let mut pixels = vec![0; LEN];
        Grain::new(0.0, 5).add_to(&vec![100; LEN], &mut pixels);
        assert!(pixels.iter().all(|channel| *channel == 100));
    }
}
