//! Sheets of paper that are expensive to search for QR codes: the work is bounded, and no script
//! fails because of it. The fuzz target `qr_cost` uses the same painter.

use image::{Rgb, RgbImage};
use proptest::prelude::*;
use qrcode::{Color, EcLevel, Version};
use spykee::vision::{
    BlobFinder, BlobOptions, Camera, Colour, Image, MAX_CODES, MAX_QR_STEPS, Palette,
    find_qrcodes_counting,
};

use crate::test_pattern::paint;

fn image(bytes: &[u8]) -> Image {
    let test_pattern = paint(bytes);
    let rgb = test_pattern
        .pixels
        .iter()
        .flat_map(|grey| [*grey; 3])
        .collect();
    let width = test_pattern.width as u32;
    let height = test_pattern.height as u32;
    Image::from_rgb(&RgbImage::from_raw(width, height, rgb).unwrap())
}

fn look(bytes: &[u8]) {
    let image = image(bytes);
    let (codes, steps) = find_qrcodes_counting(&image);
    assert!(
        steps <= MAX_QR_STEPS && codes.len() <= MAX_CODES,
        "{steps} {codes:?}"
    );
    let colours: Vec<Colour> = ["black", "white"]
        .iter()
        .filter_map(|name| Colour::named(name))
        .collect();
    let options = BlobOptions {
        merge: true,
        margin: 4,
        ..BlobOptions::default()
    };
    let mut palette = Palette::compile(&colours, false);
    let mut finder = BlobFinder::default();
    let blobs = finder.find(&image, &mut palette, &options, Camera::default());
    assert!(blobs.len() <= options.max_blobs);
}

/// Draws a code of this version at a place of a white sheet, with dots of `dot` pixels.
fn draw_code(sheet: &mut RgbImage, version: i16, (left, top): (u32, u32), dot: u32) {
    let code = qrcode::QrCode::with_version("spykee", Version::Normal(version), EcLevel::L);
    let code = code.unwrap();
    let side = code.width() as u32;
    for (index, colour) in (0..).zip(code.to_colors()) {
        let column = left + index % side * dot;
        let row = top + index / side * dot;
        for (x, y) in (0..dot * dot).map(|pixel| (column + pixel % dot, row + pixel / dot)) {
            if colour == Color::Dark && x < sheet.width() && y < sheet.height() {
                sheet.put_pixel(x, y, Rgb([20; 3]));
            }
        }
    }
}

fn sheet() -> RgbImage {
    RgbImage::from_pixel(320, 240, Rgb([225; 3]))
}

#[test]
fn honest_codes_are_read_within_the_budget() {
    for (version, place, dot) in [(1, 36, 4), (5, 25, 5), (7, 21, 4), (10, 17, 3), (15, 13, 2)] {
        let mut sheet = sheet();
        draw_code(&mut sheet, version, (place, place), dot);
        let (codes, steps) = find_qrcodes_counting(&Image::from_rgb(&sheet));
        assert_eq!(codes.len(), 1, "version {version}, {steps} steps");
        assert_eq!(codes[0].text, "spykee");
    }
    let mut sheet = sheet();
    for column in 0..4 {
        draw_code(&mut sheet, 2, (8 + 80 * column, 8), 2);
    }
    let (codes, steps) = find_qrcodes_counting(&Image::from_rgb(&sheet));
    assert_eq!(codes.len(), 4, "{steps} steps");
}

/// One code is too fine to be read, so that the picture is searched again at twice the size; the
/// other one is as large as a code can be.
#[test]
fn the_search_of_a_huge_code_ends_with_the_budget_of_both_passes() {
    for version in [20, 40] {
        let mut sheet = sheet();
        draw_code(&mut sheet, version, (9, 9), 1);
        let (codes, steps) = find_qrcodes_counting(&Image::from_rgb(&sheet));
        assert_eq!((codes.len(), steps), (0, MAX_QR_STEPS), "version {version}");
    }
}

/// A corner of a code, at multiples of a tenth of the picture's width and height.
fn corner(column: u8, row: u8) -> [u8; 6] {
    [0, 4 + column * 24, 4 + row * 32, 2, 0, 10]
}

#[test]
fn the_worst_sheets_are_searched_within_bounds() {
    let corners = (0..7).flat_map(|row| (0..10).map(move |column| corner(column, row)));
    look(
        &std::iter::once(0)
            .chain(corners.flatten())
            .collect::<Vec<u8>>(),
    );
    for stroke in [
        [1, 0, 0, 1, 10, 10],   // a lattice of small corners
        [1, 0, 0, 2, 9, 10],    // a lattice of corners
        [3, 0, 0, 0, 255, 10],  // chequers
        [3, 0, 0, 2, 255, 10],  // wide chequers
        [4, 0, 0, 3, 255, 77],  // noise
        [5, 0, 0, 1, 255, 10],  // text
        [6, 10, 10, 2, 20, 10], // a code
        [6, 0, 0, 0, 39, 10],   // a code of many dots
        [2, 0, 0, 2, 14, 10],   // rings
    ] {
        for size in 0..4 {
            look(&[&[size][..], &stroke].concat());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_work_is_bounded_for_any_picture(bytes in proptest::collection::vec(any::<u8>(), 1..400)) {
        look(&bytes);
    }
}
