//! Blobs in pictures whose values are known.

use super::*;
use crate::vision::Colour;
use image::{Rgb, RgbImage};
use imageproc::drawing::{draw_filled_circle_mut, draw_filled_rect_mut};
use imageproc::rect::Rect;

const RED: Rgb<u8> = Rgb([220, 20, 20]);
const BLUE: Rgb<u8> = Rgb([20, 20, 220]);

fn grey() -> RgbImage {
    RgbImage::from_pixel(320, 240, Rgb([120, 120, 120]))
}

fn find(pixels: RgbImage, names: &[&str], options: BlobOptions) -> Vec<Blob> {
    let colours: Vec<Colour> = names
        .iter()
        .map(|name| Colour::named(name).unwrap())
        .collect();
    let mut palette = Palette::compile(&colours, options.invert);
    BlobFinder::default()
        .find(
            &Image::from_rgb(&pixels),
            &mut palette,
            &options,
            Camera::default(),
        )
        .to_vec()
}

fn boxed(pixels: &mut RgbImage, x: i32, y: i32, w: u32, h: u32, colour: Rgb<u8>) {
    draw_filled_rect_mut(pixels, Rect::at(x, y).of_size(w, h), colour);
}

#[test]
fn a_box_has_the_values_of_a_box() {
    let mut pixels = grey();
    boxed(&mut pixels, 40, 100, 30, 10, RED);
    let [blob] = find(pixels, &["red"], BlobOptions::default())[..] else {
        panic!("expected one blob")
    };
    assert_eq!((blob.x, blob.y, blob.w, blob.h), (40, 100, 30, 10));
    assert_eq!((blob.pixels, blob.area, blob.density), (300, 300, 1.0));
    assert_eq!((blob.cx, blob.cy), (54.5, 104.5));
    assert_eq!(blob.perimeter, 2 * 30 + 2 * 8);
    assert_eq!(
        (blob.code, blob.count, blob.colour, blob.edge),
        (1, 1, 0, false)
    );
    assert!(blob.rotation.abs() < 1e-9);
    assert!(
        (blob.roundness - 99.0 / 899.0).abs() < 1e-9,
        "ratio of the variances of 10 and of 30 pixels"
    );
    assert!((blob.roundness + blob.elongation - 1.0).abs() < 1e-12);
    assert!(blob.bearing > 0.0, "left of the middle is positive");
}

#[test]
fn a_disc_is_round_and_a_bar_is_not() {
    let mut pixels = grey();
    draw_filled_circle_mut(&mut pixels, (80, 80), 25, RED);
    boxed(&mut pixels, 200, 20, 5, 90, RED);
    let blobs = find(pixels, &["red"], BlobOptions::default());
    assert!(blobs[0].roundness > 0.98 && blobs[0].elongation < 0.02);
    assert!(blobs[1].elongation > 0.95);
    assert!((blobs[1].rotation - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
}

#[test]
fn the_largest_come_first_and_their_number_is_limited() {
    let mut pixels = grey();
    for (index, size) in [12, 30, 20, 25].into_iter().enumerate() {
        boxed(&mut pixels, 10 + 50 * index as i32, 10, size, size, RED);
    }
    let sizes = |max_blobs| {
        let blobs = find(
            pixels.clone(),
            &["red"],
            BlobOptions {
                max_blobs,
                ..Default::default()
            },
        );
        blobs.iter().map(|blob| blob.w).collect::<Vec<_>>()
    };
    assert_eq!(sizes(32), [30, 25, 20, 12]);
    assert_eq!(sizes(2), [30, 25]);
    assert!(sizes(0).is_empty());
}

#[test]
fn small_blobs_are_left_out() {
    let mut pixels = grey();
    boxed(&mut pixels, 10, 10, 3, 3, RED);
    boxed(&mut pixels, 50, 10, 5, 2, RED);
    assert_eq!(
        find(pixels.clone(), &["red"], BlobOptions::default()).len(),
        1
    );
    let all = BlobOptions {
        area_threshold: 0,
        pixels_threshold: 0,
        ..Default::default()
    };
    assert_eq!(find(pixels.clone(), &["red"], all.clone()).len(), 2);
    assert_eq!(
        find(
            pixels,
            &["red"],
            BlobOptions {
                area_threshold: 11,
                ..all
            }
        )
        .len(),
        0
    );
}

#[test]
fn only_the_roi_is_searched() {
    let mut pixels = grey();
    boxed(&mut pixels, 100, 100, 40, 40, RED);
    let options = BlobOptions {
        roi: Some(Roi {
            x: 120,
            y: 0,
            w: 900,
            h: 110,
        }),
        ..Default::default()
    };
    let blob = find(pixels.clone(), &["red"], options)[0];
    assert_eq!(
        (blob.x, blob.y, blob.w, blob.h, blob.edge),
        (120, 100, 20, 10, false)
    );
    for (x, w) in [(320, 5), (5, 0), (u32::MAX, u32::MAX)] {
        let options = BlobOptions {
            roi: Some(Roi { x, y: 0, w, h: 9 }),
            ..Default::default()
        };
        assert_eq!(find(pixels.clone(), &["red"], options), []);
    }
}

#[test]
fn blobs_of_several_colours_have_the_bit_of_their_colour() {
    let mut pixels = grey();
    boxed(&mut pixels, 10, 10, 40, 40, BLUE);
    boxed(&mut pixels, 50, 10, 30, 30, RED);
    let blobs = find(pixels, &["red", "blue"], BlobOptions::default());
    assert_eq!(
        blobs
            .iter()
            .map(|blob| (blob.code, blob.colour))
            .collect::<Vec<_>>(),
        [(2, 1), (1, 0)]
    );
}

#[test]
fn merging_joins_nearby_boxes_and_their_codes() {
    let mut pixels = grey();
    boxed(&mut pixels, 10, 10, 20, 20, BLUE);
    boxed(&mut pixels, 34, 10, 20, 10, RED);
    boxed(&mut pixels, 200, 10, 15, 15, RED);
    let merge = |margin| BlobOptions {
        merge: true,
        margin,
        ..Default::default()
    };
    assert_eq!(find(pixels.clone(), &["red", "blue"], merge(3)).len(), 3);
    let blobs = find(pixels, &["red", "blue"], merge(5));
    assert_eq!(blobs.len(), 2);
    let both = blobs[0];
    assert_eq!(
        (both.code, both.colour, both.count, both.pixels),
        (3, 0, 2, 600)
    );
    assert_eq!((both.x, both.y, both.w, both.h), (10, 10, 44, 20));
    assert!((both.cx - (19.5 * 400.0 + 43.5 * 200.0) / 600.0).abs() < 1e-9);
}

#[test]
fn a_merged_box_continues_to_merge() {
    let mut pixels = grey();
    // The third box lies within the bounding box of the first two, though near neither of them.
    boxed(&mut pixels, 10, 10, 60, 4, RED);
    boxed(&mut pixels, 72, 10, 4, 80, RED);
    boxed(&mut pixels, 20, 60, 6, 6, RED);
    let blobs = find(
        pixels,
        &["red"],
        BlobOptions {
            merge: true,
            margin: 4,
            ..Default::default()
        },
    );
    assert_eq!(blobs.len(), 1);
    assert_eq!(blobs[0].count, 3);
}

#[test]
fn invert_finds_pixels_not_of_the_colour() {
    let mut pixels = RgbImage::from_pixel(320, 240, RED);
    boxed(&mut pixels, 100, 50, 20, 20, BLUE);
    let blobs = find(
        pixels,
        &["red"],
        BlobOptions {
            invert: true,
            ..Default::default()
        },
    );
    assert_eq!((blobs.len(), blobs[0].x, blobs[0].pixels), (1, 100, 400));
}

#[test]
fn a_blob_at_the_border_is_marked() {
    for (x, y) in [(0, 100), (300, 100), (100, 0), (100, 220)] {
        let mut pixels = grey();
        boxed(&mut pixels, x, y, 20, 20, RED);
        assert!(find(pixels, &["red"], BlobOptions::default())[0].edge);
    }
}

#[test]
fn worst_case_noise_is_bounded() {
    let pixels = RgbImage::from_fn(320, 240, |x, y| if x % 2 + y % 2 == 0 { RED } else { BLUE });
    let options = BlobOptions {
        area_threshold: 0,
        pixels_threshold: 0,
        merge: true,
        max_blobs: usize::MAX,
        ..Default::default()
    };
    assert!(find(pixels, &["red", "white"], options).len() <= MAX_MERGED);
}
