//! Adversarial images for the camera: whatever they show, the work of searching them is bounded. It
//! is counted, not timed.
#![no_main]

use std::cell::RefCell;

use image::RgbImage;
use libfuzzer_sys::fuzz_target;
use spykee::vision::{
    BlobFinder, BlobOptions, Camera, Colour, Image, MAX_CODES, MAX_QR_STEPS, Palette, find_qrcodes_counting,
};

#[path = "../test_pattern.rs"]
mod test_pattern;

thread_local! {
    static FINDER: RefCell<BlobFinder> = RefCell::default();
}

fuzz_target!(|bytes: &[u8]| {
    let test_pattern = test_pattern::paint(bytes);
    let width = test_pattern.width as u32;
let height = test_pattern.height as u32;
    let rgb = test_pattern.pixels.iter().flat_map(|grey| [*grey; 3]).collect();
    let pixels = RgbImage::from_raw(width, height, rgb).expect("three bytes a pixel");
    let image = Image::from_rgb(&pixels);
    let (codes, steps) = find_qrcodes_counting(&image);
    assert!(steps <= MAX_QR_STEPS && codes.len() <= MAX_CODES, "{steps} {codes:?}");
    let colours: Vec<Colour> = ["black", "white"].iter().filter_map(|name| Colour::named(name)).collect();
    let options = BlobOptions {
        merge: true,
        margin: 4,
        ..BlobOptions::default()
    };
    let mut palette = Palette::compile(&colours, false);
    FINDER.with_borrow_mut(|finder| {
        let blobs = finder.find(&image, &mut palette, &options, Camera::default());
        assert!(blobs.len() <= options.max_blobs);
    });
});
