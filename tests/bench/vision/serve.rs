//! Answers the commands of `scripts/bench-vision`.

use serde_json::{Value, json};
use spykee::vision::{
    Blob, BlobFinder, BlobOptions, Camera, Colour, Decoder, FrameAnalyser, Image, Palette,
};
use std::io::BufRead;
use std::path::Path;
use std::time::Instant;

/// Reads one command per line: `SET COUNT` times the frames of a set, `exact SET COUNT` compares
/// the lookup table with exact colours, `mask FILE` returns the blobs of a black and white picture.
pub(crate) fn serve(folder: &Path) {
    let colours: Value =
        serde_json::from_slice(&std::fs::read(folder.join("colours.json")).unwrap()).unwrap();
    let colours =
        |count: &str| -> Vec<Colour> { serde_json::from_value(colours[count].clone()).unwrap() };
    for order in std::io::stdin().lock().lines() {
        let order = order.unwrap();
        let answer = match order.split_whitespace().collect::<Vec<_>>()[..] {
            ["exact", set, count] => exactness(&frames(folder, set), &colours(count)),
            ["mask", file] => mask(&folder.join(file)),
            [set, count] => timing(&frames(folder, set), &colours(count)),
            _ => panic!("unknown order {order:?}"),
        };
        println!("{answer}");
    }
}

fn frames(folder: &Path, set: &str) -> Vec<Vec<u8>> {
    let paths = std::fs::read_dir(folder.join(set))
        .unwrap()
        .map(|entry| entry.unwrap().path());
    let mut paths: Vec<_> = paths
        .filter(|path| path.extension().is_some_and(|end| end == "jpg"))
        .collect();
    paths.sort();
    paths
        .iter()
        .map(|path| std::fs::read(path).unwrap())
        .collect()
}

/// Measures every frame in microseconds: in total, and the decoding alone.
fn timing(frames: &[Vec<u8>], colours: &[Colour]) -> Value {
    let mut analyser = FrameAnalyser::new(Camera::default());
    let mut decoder = Decoder::default();
    let mut whole = Vec::new();
    let mut decode = Vec::new();
    let mut blobs = 0;
    let mut key = 0;
    let options = BlobOptions {
        max_blobs: usize::MAX,
        ..BlobOptions::default()
    };
    // The first round warms up and is not counted.
    for round in 0..2 {
        for jpeg in frames {
            key += 1;
            let start = Instant::now();
            blobs += analyser
                .find_blobs(key, jpeg, colours, &options)
                .unwrap()
                .len();
            let middle = Instant::now();
            std::hint::black_box(decoder.decode(jpeg).unwrap());
            if round > 0 {
                whole.push((middle - start).as_secs_f64() * 1e6);
                decode.push(middle.elapsed().as_secs_f64() * 1e6);
            }
        }
    }
    json!({ "whole": whole, "decode": decode, "blobs": blobs / 2 })
}

/// Returns the percentage of pixels whose colour according to the lookup table differs from the
/// exact calculation: on our decoded pixels, and on those decoded by the image crate.
fn exactness(frames: &[Vec<u8>], colours: &[Colour]) -> Value {
    let mut decoder = Decoder::default();
    let mut palette = Palette::compile(colours, false);
    let mut ours = 0u64;
    let mut theirs = 0u64;
    let mut pixels = 0u64;
    for jpeg in frames {
        let image = decoder.decode(jpeg).unwrap();
        let other = image::load_from_memory(jpeg).unwrap().to_rgb8();
        for (x, y, rgb) in other.enumerate_pixels() {
            let label = palette.colour_at(image, x, y);
            let exact = |rgb: [u8; 3]| colours.iter().position(|colour| colour.contains(rgb));
            ours += u64::from(label != image.pixel(x, y).and_then(exact));
            theirs += u64::from(label != exact(rgb.0));
            pixels += 1;
        }
    }
    let percent = |count: u64| count as f64 / pixels as f64 * 100.0;
    json!({ "ours": percent(ours), "theirs": percent(theirs) })
}

/// Returns all blobs of a mask, however small.
fn mask(file: &Path) -> Value {
    let image = Image::from_rgb(&image::open(file).unwrap().to_rgb8());
    let white = Colour::hsv([0.0, 360.0], [0.0, 100.0], [50.0, 100.0]).unwrap();
    let options = BlobOptions {
        area_threshold: 0,
        pixels_threshold: 0,
        max_blobs: usize::MAX,
        ..BlobOptions::default()
    };
    let mut finder = BlobFinder::default();
    let blobs = finder.find(
        &image,
        &mut Palette::compile(&[white], false),
        &options,
        Camera::default(),
    );
    blobs
        .iter()
        .map(
            |Blob {
                 x,
                 y,
                 w,
                 h,
                 pixels,
                 cx,
                 cy,
                 ..
             }| json!([x, y, w, h, pixels, cx, cy]),
        )
        .collect()
}
