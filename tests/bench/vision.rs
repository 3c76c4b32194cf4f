//! Benchmarks of each stage of vision: `cargo bench --bench vision`.
//!
//! With the arguments `serve DIR` it is controlled by `scripts/bench-vision` instead: it reads
//! commands line by line and answers each with one line of JSON, so that both implementations are
//! timed alternately on the same frames.
#![allow(clippy::unwrap_used, clippy::expect_used, missing_docs)]

use divan::{AllocProfiler, Bencher, black_box};
use image::{Rgb, RgbImage};
use imageproc::drawing::draw_filled_circle_mut;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::vision::{
    BlobFinder, BlobOptions, Camera, Colour, Decoder, FrameAnalyser, Image, MotionDetector,
    MotionOptions, Palette, brightness, find_line, find_qrcodes, learn, sharpness,
    validate_markers,
};

#[path = "vision/serve.rs"]
mod serve;

#[global_allocator]
static ALLOCATIONS: AllocProfiler = AllocProfiler::system();

fn main() {
    let mut arguments = std::env::args().skip(1);
    match (arguments.next().as_deref(), arguments.next()) {
        (Some("serve"), Some(folder)) => serve::serve(folder.as_ref()),
        _ => divan::main(),
    }
}

/// Returns images of rooms with balls and the noise of a cheap camera, compressed as by the robot:
/// 4:2:0, quality 50. The frames differ, because a single repeated frame would train the branch
/// predictor.
fn frames() -> Vec<Vec<u8>> {
    let mut random = StdRng::seed_from_u64(1);
    (0..32).map(|number| frame(number, &mut random)).collect()
}

fn frame(number: u32, random: &mut StdRng) -> Vec<u8> {
    let mut picture = RgbImage::from_fn(320, 240, |x, y| {
        let shade = if y < 130 {
            150 + x / 8
        } else {
            90 + y / 5 + (x + 2 * number) / 32 % 2 * 20
        };
        Rgb([shade as u8, (shade - 8) as u8, (shade - 20) as u8])
    });
    for (index, colour) in [[200, 30, 35], [35, 60, 190], [40, 160, 60]]
        .into_iter()
        .enumerate()
    {
        let x = 60 + 90 * index as i32 + (number as i32 * 3) % 40;
        draw_filled_circle_mut(&mut picture, (x, 150), 14 + 5 * index as i32, Rgb(colour));
    }
    for pixel in picture.pixels_mut() {
        let noise = random.random_range(-5..=5);
        pixel.0 = pixel
            .0
            .map(|value| (i32::from(value) + noise).clamp(0, 255) as u8);
    }
    let mut jpeg = Vec::new();
    let mut encoder = Encoder::new(&mut jpeg, 50);
    encoder.set_sampling_factor(SamplingFactor::F_2_2);
    encoder
        .encode(picture.as_raw(), 320, 240, ColorType::Rgb)
        .unwrap();
    jpeg
}

fn decoded() -> Vec<Image> {
    let mut decoder = Decoder::default();
    frames()
        .iter()
        .map(|jpeg| decoder.decode(jpeg).unwrap().clone())
        .collect()
}

/// Returns colours with narrow hue ranges, distributed around the colour wheel.
fn colours(count: usize) -> Vec<Colour> {
    let hue = |index: usize| (360 / count * index) as f64;
    (0..count)
        .map(|index| {
            Colour::hsv(
                [hue(index), hue(index) + 20.0],
                [40.0, 100.0],
                [20.0, 100.0],
            )
            .unwrap()
        })
        .collect()
}

/// Benchmarks `work` on the items in rotation, after a warm-up.
fn in_turn<T, R>(bencher: Bencher<'_, '_>, items: Vec<T>, mut work: impl FnMut(&T) -> R) {
    items.iter().for_each(|item| drop(work(item)));
    let mut next = items.iter().cycle();
    bencher.bench_local(|| black_box(work(next.next().unwrap())));
}

#[divan::bench]
fn judge_a_frame(bencher: Bencher<'_, '_>) {
    in_turn(bencher, frames(), |jpeg| validate_markers(jpeg).unwrap());
}

#[divan::bench]
fn decode_a_frame(bencher: Bencher<'_, '_>) {
    let mut decoder = Decoder::default();
    in_turn(bencher, frames(), |jpeg| {
        decoder.decode(jpeg).unwrap().size()
    });
}

#[divan::bench]
fn decode_by_the_image_crate(bencher: Bencher<'_, '_>) {
    in_turn(bencher, frames(), |jpeg| {
        image::load_from_memory(jpeg).unwrap()
    });
}

#[divan::bench(args = [1, 4, 16])]
fn blobs_of_a_picture(bencher: Bencher<'_, '_>, count: usize) {
    let mut finder = BlobFinder::default();
    let mut palette = Palette::compile(&colours(count), false);
    in_turn(bencher, decoded(), |image| {
        finder
            .find(
                image,
                &mut palette,
                &BlobOptions::default(),
                Camera::default(),
            )
            .len()
    });
}

#[divan::bench(args = [1, 4, 16])]
fn blobs_of_a_frame(bencher: Bencher<'_, '_>, count: usize) {
    let mut analyser = FrameAnalyser::new(Camera::default());
    let mut key = 0;
    let colours = colours(count);
    in_turn(bencher, frames(), |jpeg| {
        key += 1;
        analyser
            .find_blobs(key, jpeg, &colours, &BlobOptions::default())
            .unwrap()
            .len()
    });
}

#[divan::bench]
fn compile_a_palette_and_meet_a_frame(bencher: Bencher<'_, '_>) {
    let mut finder = BlobFinder::default();
    let lab = [Colour::lab([20.0, 70.0], [20.0, 80.0], [0.0, 60.0]).unwrap()];
    in_turn(bencher, decoded(), |image| {
        let mut palette = Palette::compile(&lab, false);
        finder
            .find(
                image,
                &mut palette,
                &BlobOptions::default(),
                Camera::default(),
            )
            .len()
    });
}

#[divan::bench]
fn motion_of_a_picture(bencher: Bencher<'_, '_>) {
    let mut detector = MotionDetector::new(MotionOptions::default(), Camera::default());
    in_turn(bencher, decoded(), |image| detector.update(image).pixels);
}

#[divan::bench]
fn line_in_a_picture(bencher: Bencher<'_, '_>) {
    let mut finder = BlobFinder::default();
    let mut palette = Palette::compile(&colours(1), false);
    in_turn(bencher, decoded(), |image| {
        find_line(&mut finder, image, &mut palette, None)
    });
}

#[divan::bench]
fn brightness_of_a_picture(bencher: Bencher<'_, '_>) {
    in_turn(bencher, decoded(), |image| brightness(image, None));
}

#[divan::bench]
fn sharpness_of_a_picture(bencher: Bencher<'_, '_>) {
    in_turn(bencher, decoded(), |image| sharpness(image, None));
}

#[divan::bench]
fn colour_of_a_ball(bencher: Bencher<'_, '_>) {
    let part = spykee::vision::Roi {
        x: 80,
        y: 140,
        w: 20,
        h: 20,
    };
    in_turn(bencher, decoded(), |image| learn(&[image], part));
}

#[divan::bench]
fn qrcodes_where_there_are_none(bencher: Bencher<'_, '_>) {
    in_turn(bencher, decoded(), find_qrcodes);
}
