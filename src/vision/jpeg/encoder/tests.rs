//! Compares files with those of the `jpeg_encoder` crate.

use proptest::prelude::*;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

use super::subsampling::factor;
use super::*;
use jpeg_encoder::ColorType;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
const SIZE: (u16, u16) = (WIDTH as u16, HEIGHT as u16);

const ALL: [Subsampling; 3] = [Subsampling::None, Subsampling::Half, Subsampling::Quarter];

/// A grey and a coloured gradient with sharp edges and noise.
fn picture(seed: u64) -> Vec<Pixel> {
    let mut random = StdRng::seed_from_u64(seed);
    let mut pixel = |index: usize| {
        let (x, y) = (index % WIDTH, index / WIDTH);
        let edge = if (x / 50 + y / 37) % 2 == 0 { 60 } else { 0 };
        let noise = random.random_range(0..8);
        [x / 2 + edge, y / 2 + edge, 255 - x / 3 - y / 3, 0]
            .map(|level| (level + noise).min(255) as u8)
    };
    (0..WIDTH * HEIGHT).map(&mut pixel).collect()
}

fn decoded(file: &[u8]) -> Vec<u8> {
    let image = image::load_from_memory(file).unwrap().to_rgb8();
    assert_eq!(image.dimensions(), (WIDTH as u32, HEIGHT as u32));
    image.into_raw()
}

fn of_the_crate(frame: &[Pixel], quality: u8, subsampling: Subsampling) -> Vec<u8> {
    let mut file = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(factor(subsampling));
    let pixels = frame.as_flattened();
    encoder
        .encode(pixels, SIZE.0, SIZE.1, ColorType::Rgba)
        .unwrap();
    file
}

/// Root mean square of the differences.
fn error(image: &[u8], frame: &[Pixel]) -> f64 {
    let channels = frame.iter().flat_map(|pixel| &pixel[..3]);
    let differences = image
        .iter()
        .zip(channels)
        .map(|(a, b)| f64::from(*a) - f64::from(*b));
    let sum: f64 = differences.map(|difference| difference * difference).sum();
    (sum / image.len() as f64).sqrt()
}

#[test]
fn files_are_as_accurate_and_as_short_as_those_of_the_crate() {
    for (quality, subsampling) in [1, 30, 75, 95, 100]
        .into_iter()
        .flat_map(|quality| ALL.map(|kind| (quality, kind)))
    {
        let frame = picture(u64::from(quality));
        let file = Encoder::new(quality, subsampling, SIZE).encode(&frame);
        let other = of_the_crate(&frame, quality, subsampling);
        let (own, other_error) = (
            error(&decoded(&file), &frame),
            error(&decoded(&other), &frame),
        );
        assert!(
            own <= other_error * 1.02 + 0.05,
            "{quality} {subsampling:?}: {own} and {other_error}"
        );
        let ratio = file.len() as f64 / other.len() as f64;
        assert!(
            (0.8..1.05).contains(&ratio),
            "{quality} {subsampling:?}: {ratio}"
        );
    }
}

#[test]
fn an_encoder_keeps_no_state_between_frames() {
    let mut encoder = Encoder::new(75, Subsampling::Half, SIZE);
    let first = encoder.encode(&picture(1));
    assert_ne!(encoder.encode(&picture(2)), first);
    assert_eq!(encoder.encode(&picture(1)), first);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    /// Extreme pixels at every quality: nothing overflows, and every file is complete.
    #[test]
    fn any_pixels_give_a_valid_file(seed: u64, quality in 1u8..=100, kind in 0usize..3, extremes: bool) {
        let mut random = StdRng::seed_from_u64(seed);
        let frame: Vec<Pixel> = (0..WIDTH * HEIGHT)
            .map(|_| random.random::<Pixel>().map(|level| if extremes { level / 128 * 255 } else { level }))
            .collect();
        let file = Encoder::new(quality, ALL[kind], SIZE).encode(&frame);
        let image = decoded(&file);
        let other = decoded(&of_the_crate(&frame, quality, ALL[kind]));
        prop_assert!(error(&image, &frame) <= error(&other, &frame) * 1.05 + 0.1);
    }
}
