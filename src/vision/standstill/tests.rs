//! Pictures of a robot that stands still and of one that drives.

use image::{Rgb, RgbImage};
use proptest::prelude::*;

use super::*;

const DRIVE: Drive = Drive {
    forward: 0.2,
    turn: 0.0,
};
const TURN: Drive = Drive {
    forward: 0.0,
    turn: 0.8,
};
const APART: Duration = Duration::from_millis(400);

/// A pseudo-random value that is always the same for the same position.
fn speckle(x: i64, y: i64) -> u8 {
    let mixed = (x.wrapping_mul(0x9E37_79B9) ^ y.wrapping_mul(0x85EB_CA6B)) as u64;
    let mixed = (mixed ^ (mixed >> 15)).wrapping_mul(0x2C1B_3C6D);
    (40 + (mixed >> 13) % 160) as u8
}

/// The view `way` metres along a corridor with a speckled floor; `aside` shifts it sideways, in
/// pixels.
fn corridor(way: f64, aside: i64, noise: i64, walker: Option<u32>) -> HalfLuma {
    let focal = Camera::default().focal_length(320);
    let picture = RgbImage::from_fn(320, 240, |column, row| {
        let (x, y) = (f64::from(column) - 160.0, f64::from(row) - 120.0);
        let value = if walker.is_some_and(|left| (left..left + 90).contains(&column)) {
            speckle(
                i64::from(column) / 9 + 7 * way.mul_add(100.0, 3.0) as i64,
                i64::from(row) / 9,
            )
        } else if y > 4.0 {
            let depth = focal * LENS_HEIGHT / y;
            let across = x * depth / focal;
            speckle(
                ((depth + way) * 25.0) as i64,
                (across * 25.0).floor() as i64 + aside / 4,
            )
        } else {
            150
        };
        let grain = i64::from(speckle(i64::from(column) + noise, i64::from(row))) % 7 - 3;
        Rgb([(i64::from(value) + grain).clamp(0, 255) as u8; 3])
    });
    luma(&picture)
}

impl HalfLuma {
    /// The picture shifted to the right by `by` pixels, fewer than a tile.
    fn moved_right(mut self, by: usize) -> HalfLuma {
        self.luma
            .chunks_mut(self.w)
            .for_each(|row| row.rotate_right(by));
        self
    }
}

fn luma(picture: &RgbImage) -> HalfLuma {
    let mut luma = HalfLuma::default();
    luma.take(&Image::from_rgb(picture));
    luma
}

fn verdict(before: &HalfLuma, now: &HalfLuma, drive: Drive) -> Verdict {
    compare(before, now, Camera::default(), drive, APART, 0)
}

#[test]
fn a_robot_that_drives_moves_and_one_that_is_held_stands() {
    let before = corridor(0.0, 0, 1, None);
    assert_eq!(
        verdict(&before, &corridor(0.08, 0, 2, None), DRIVE),
        Verdict::Moves
    );
    assert_eq!(
        verdict(&before, &corridor(0.0, 0, 3, None), DRIVE),
        Verdict::Stands
    );
    let back = Drive {
        forward: -0.2,
        ..DRIVE
    };
    assert_eq!(
        verdict(&before, &corridor(-0.08, 0, 4, None), back),
        Verdict::Moves
    );
    assert_eq!(
        verdict(&before, &corridor(0.0, 0, 5, None), back),
        Verdict::Stands
    );
}

#[test]
fn a_plain_wall_and_the_dark_give_no_result() {
    for grey in [0, 90, 255] {
        let plain = luma(&RgbImage::from_pixel(320, 240, Rgb([grey; 3])));
        assert_eq!(verdict(&plain, &plain, DRIVE), Verdict::Unknown);
        assert_eq!(verdict(&plain, &plain, TURN), Verdict::Unknown);
    }
}

#[test]
fn a_line_along_the_way_is_not_a_standstill_and_things_on_both_sides_are() {
    // Lines on the floor; each pair gives a line's column at the horizon and in the lowest row.
    let lines = |ends: &[(f64, f64)]| {
        let ends = ends.to_vec();
        luma(&RgbImage::from_fn(320, 240, move |x, y| {
            let down = (f64::from(y) - 120.0) / 120.0;
            let on = |(far, near): &(f64, f64)| {
                (f64::from(x) - far - (near - far) * down).abs() < 4.0 + 8.0 * down
            };
            let grain = speckle(i64::from(x), i64::from(y)) % 5;
            Rgb([if down > 0.0 && ends.iter().any(on) {
                40 + grain
            } else {
                150 + grain
            }; 3])
        }))
    };
    let right = lines(&[(200.0, 300.0)]);
    assert_eq!(verdict(&right, &right, DRIVE), Verdict::Unknown);
    let both = lines(&[(200.0, 300.0), (120.0, 20.0)]);
    assert_eq!(verdict(&both, &both, DRIVE), Verdict::Stands);
}

#[test]
fn a_walker_before_a_held_robot_is_not_a_movement_of_the_robot() {
    let before = corridor(0.0, 0, 1, Some(40));
    assert_eq!(
        verdict(&before, &corridor(0.0, 0, 2, Some(70)), DRIVE),
        Verdict::Stands
    );
}

#[test]
fn a_robot_that_should_turn_but_does_not_stands_still() {
    let stripes = |by: u32| {
        luma(&RgbImage::from_fn(320, 240, |x, _| {
            Rgb([speckle(i64::from((x + 1000 - by) / 12), 3); 3])
        }))
    };
    let before = stripes(0);
    assert_eq!(verdict(&before, &stripes(0), TURN), Verdict::Stands);
    assert_eq!(verdict(&before, &stripes(88), TURN), Verdict::Moves);
    assert_eq!(verdict(&before, &stripes(44), TURN), Verdict::Moves);
}

#[test]
fn a_robot_that_is_held_in_a_curve_stands_still_though_it_turns() {
    let curve = Drive {
        forward: 0.2,
        turn: 0.3,
    };
    let before = corridor(0.0, 0, 1, None);
    let turned = corridor(0.0, 0, 2, None).moved_right(6);
    let verdict = |now: &HalfLuma| compare(&before, now, Camera::default(), curve, APART, 6);
    assert_eq!(verdict(&turned), Verdict::Stands);
    let driven = corridor(0.08, 0, 3, None).moved_right(6);
    assert_eq!(verdict(&driven), Verdict::Unknown);
}

#[test]
fn pictures_of_other_sizes_are_not_compared() {
    for side in [0, 1, 2, 15, 16, 17] {
        let small = luma(&RgbImage::from_pixel(side, side, Rgb([9; 3])));
        assert_eq!(verdict(&small, &small, DRIVE), Verdict::Unknown);
        assert_eq!(
            verdict(&small, &corridor(0.0, 0, 1, None), DRIVE),
            Verdict::Unknown
        );
    }
}

proptest! {
    #[test]
    fn any_picture_and_any_drive_give_a_verdict(
        pixels in proptest::collection::vec(any::<u8>(), 40 * 30), w in 1u32..40, h in 1u32..30,
        forward in -1e9f64..1e9, turn in -1e9f64..1e9, millis in 0u64..1_000_000, sway in -99isize..99,
    ) {
        let picture = RgbImage::from_fn(w, h, |x, y| Rgb([pixels[(y * 40 + x) as usize]; 3]));
        let one = luma(&picture);
        let apart = Duration::from_millis(millis);
        compare(&one, &one, Camera::default(), Drive { forward, turn }, apart, sway);
    }
}
