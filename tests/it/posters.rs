//! Sheets of paper that are expensive to search for QR codes: the work is bounded, and no script
//! fails because of it. The fuzz target `posters` uses the same painter.

use image::RgbImage;
use proptest::prelude::*;
use spykee::vision::{
    BlobFinder, BlobOptions, Camera, Colour, Image, MAX_CODES, MAX_FILLED, MAX_FINDERS, MAX_STEPS,
    Palette, QrWork, find_qrcodes_counting,
};

use crate::poster::paint;

fn image(bytes: &[u8]) -> Image {
    let poster = paint(bytes);
    let rgb = poster.pixels.iter().flat_map(|grey| [*grey; 3]).collect();
    let (width, height) = (poster.width as u32, poster.height as u32);
    Image::from_rgb(&RgbImage::from_raw(width, height, rgb).unwrap())
}

fn look(bytes: &[u8]) -> QrWork {
    let image = image(bytes);
    let (codes, work) = find_qrcodes_counting(&image);
    assert!(
        work.finders <= MAX_FINDERS && work.filled <= MAX_FILLED && work.steps <= MAX_STEPS,
        "{work:?}"
    );
    assert!(
        work.decoded <= MAX_CODES && codes.len() <= work.decoded,
        "{work:?}"
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
    work
}

/// A corner of a code, at multiples of a tenth of the picture's width and height.
fn corner(column: u8, row: u8) -> [u8; 6] {
    [0, 4 + column * 24, 4 + row * 32, 2, 0, 10]
}

#[test]
fn only_a_part_of_a_sheet_of_seventy_corners_is_searched() {
    let corners = (0..7).flat_map(|row| (0..10).map(move |column| corner(column, row)));
    let bytes: Vec<u8> = std::iter::once(0).chain(corners.flatten()).collect();
    let began = std::time::Instant::now();
    let work = look(&bytes);
    eprintln!("{work:?} in {:?}", began.elapsed());
    assert_eq!(work.finders, MAX_FINDERS);
}

#[test]
fn the_worst_sheets_are_searched_within_bounds() {
    for (name, stroke) in [
        ("lattice of small corners", [1, 0, 0, 1, 10, 10]),
        ("lattice of corners", [1, 0, 0, 2, 9, 10]),
        ("chequers", [3, 0, 0, 0, 255, 10]),
        ("wide chequers", [3, 0, 0, 2, 255, 10]),
        ("noise", [4, 0, 0, 3, 255, 77]),
        ("text", [5, 0, 0, 1, 255, 10]),
        ("a code", [6, 10, 10, 2, 20, 10]),
        ("a code of many dots", [6, 0, 0, 0, 39, 10]),
        ("rings", [2, 0, 0, 2, 14, 10]),
    ] {
        for size in 0..4 {
            let bytes = [&[size][..], &stroke].concat();
            let began = std::time::Instant::now();
            let work = look(&bytes);
            eprintln!("{name}, {size}: {work:?} in {:?}", began.elapsed());
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
