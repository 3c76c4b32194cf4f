use super::sums::REACH;
use super::*;
use image::{Rgb, RgbImage};
use imageproc::drawing::draw_filled_circle_mut;
use proptest::prelude::*;

/// A room with furniture, lit with a brightness that may vary from left to right; the noise depends
/// on `seed`.
fn room(brightness: f64, slope: f64, ball: Option<(i32, i32)>, seed: u32) -> Image {
    let mut picture = RgbImage::from_fn(320, 240, |x, y| {
        let plank = if (x / 40 + y / 30).is_multiple_of(2) {
            110
        } else {
            80
        };
        let shelf = if (200..260).contains(&x) && (40..120).contains(&y) {
            40
        } else {
            plank
        };
        Rgb([shelf; 3])
    });
    if let Some(place) = ball {
        draw_filled_circle_mut(&mut picture, place, 18, Rgb([210, 180, 60]));
    }
    let mut state = seed;
    for (x, _, pixel) in picture.enumerate_pixels_mut() {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = f64::from(state >> 29) - 4.0;
        let light = brightness + slope * f64::from(x) / 320.0;
        pixel.0 = pixel
            .0
            .map(|value| (f64::from(value) * light + noise).clamp(0.0, 255.0) as u8);
    }
    Image::from_rgb(&picture)
}

fn detector() -> MotionDetector {
    MotionDetector::new(MotionOptions::default(), Camera::default())
}

#[test]
fn a_still_room_has_no_motion() {
    let mut detector = detector();
    for seed in 1..6 {
        assert_eq!(detector.update(&room(1.0, 0.0, None, seed)).pixels, 0);
    }
}

#[test]
fn a_rolling_ball_is_motion_where_it_rolls() {
    let mut detector = detector();
    for step in 0..6 {
        let x = 60 + 12 * step;
        let motion = detector.update(&room(1.0, 0.0, Some((x, 150)), 9 + step as u32));
        if step > 0 {
            let blob = motion.blobs[0];
            assert!(motion.score > 0.002 && motion.pixels >= 150, "{motion:?}");
            assert!(
                (blob.cx - f64::from(x - 6)).abs() < 12.0 && (blob.cy - 150.0).abs() < 12.0,
                "{blob:?}"
            );
        }
    }
}

#[test]
fn a_light_switched_on_is_not_motion() {
    for (brightness, slope) in [(1.8, 0.0), (1.3, 0.9), (0.5, 0.0), (2.4, -1.3)] {
        let mut detector = detector();
        detector.update(&room(1.0, 0.0, None, 1));
        let motion = detector.update(&room(brightness, slope, None, 2));
        assert_eq!(motion.pixels, 0, "light {brightness} {slope}");
        assert_eq!(detector.update(&room(brightness, slope, None, 3)).pixels, 0);
    }
}

#[test]
fn a_ball_is_seen_even_while_the_light_changes() {
    let mut detector = detector();
    detector.update(&room(1.0, 0.0, Some((80, 150)), 1));
    let motion = detector.update(&room(1.5, 0.0, Some((100, 150)), 2));
    assert!(
        motion.pixels > 150 && (motion.blobs[0].cx - 90.0).abs() < 15.0,
        "{motion:?}"
    );
}

/// The room shifted to the right by `by` pixels.
fn shifted(by: u32, ball: Option<(i32, i32)>) -> Image {
    let mut picture = RgbImage::from_fn(320, 240, |x, y| {
        let x = x + 400 - by;
        let plank = if (x / 40 + y / 30).is_multiple_of(2) {
            115
        } else {
            75
        };
        Rgb([plank; 3])
    });
    if let Some((x, y)) = ball {
        draw_filled_circle_mut(&mut picture, (x + by as i32, y), 18, Rgb([210, 180, 60]));
    }
    Image::from_rgb(&picture)
}

#[test]
fn a_turned_camera_is_not_motion_and_a_ball_in_a_patterned_room_is() {
    for by in [5, 9, 15, 30] {
        let mut detector = detector();
        detector.update(&shifted(0, None));
        assert_eq!(detector.update(&shifted(by, None)).pixels, 0, "by {by}");
        assert_eq!(detector.update(&shifted(by, None)).pixels, 0, "by {by}");
        let motion = detector.update(&shifted(by, Some((100, 150))));
        assert!(motion.pixels >= 150, "by {by}: {motion:?}");
    }
}

/// A plain object beside stripes, some of which stay when the camera turns while others come into
/// view.
fn beside_a_plain_thing(turned: bool) -> Image {
    let picture = RgbImage::from_fn(320, 240, |x, _| {
        let striped = x < 130 || (turned && (160..260).contains(&x));
        let moved = if turned && x >= 90 { 6 } else { 0 };
        let stripe = if ((x + moved) / 12).is_multiple_of(2) {
            115
        } else {
            75
        };
        Rgb([if striped { stripe } else { 95 }; 3])
    });
    Image::from_rgb(&picture)
}

#[test]
fn a_camera_turned_away_from_a_plain_object_is_not_motion() {
    let mut detector = detector();
    detector.update(&beside_a_plain_thing(false));
    let motion = detector.update(&beside_a_plain_thing(true));
    assert_eq!(motion.pixels, 0, "{motion:?}");
}

#[test]
fn nothing_is_compared_after_a_reset_or_another_size() {
    let mut detector = detector();
    detector.update(&room(1.0, 0.0, Some((80, 150)), 1));
    detector.reset();
    assert_eq!(
        detector.update(&room(1.0, 0.0, Some((120, 150)), 1)).pixels,
        0
    );
    for side in [0, 1, 2, 3, 17] {
        let image = Image::from_rgb(&RgbImage::from_pixel(side, side, Rgb([9, 9, 9])));
        detector.update(&image);
        assert_eq!(detector.update(&image).pixels, 0);
    }
}

proptest! {
    #[test]
    fn box_sums_equal_those_added_pixel_by_pixel(
        (w, h) in (1usize..40, 1usize..30), values in proptest::collection::vec(any::<u8>(), 40 * 30),
    ) {
        let mut sums = BoxSums::default();
        sums.sum(&values[..w * h], Size2 { w, h });
        for (index, sum) in sums.sums.iter().enumerate() {
            let around = |at: usize, limit: usize| at.saturating_sub(REACH)..(at + REACH + 1).min(limit);
            let rows = around(index / w, h);
            let plain: u32 =
                rows.flat_map(|y| around(index % w, w).map(move |x| (x, y))).map(|(x, y)| u32::from(values[y * w + x])).sum();
            prop_assert_eq!(*sum, plain);
        }
    }
}
