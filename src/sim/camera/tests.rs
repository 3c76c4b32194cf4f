//! Tests of rendered frames.

use super::*;
use std::f64::consts::PI;

const RED: fn([u8; 3]) -> bool = |[r, g, b]| r > 110 && g < 80 && b < 80;

fn still(pose: Pose, flash: bool) -> Shot {
    Shot {
        pose,
        flash,
        turning: 0.0,
        time: Duration::ZERO,
    }
}

fn shot(world: &World, pose: Pose, flash: bool) -> image::RgbImage {
    let jpeg = Camera::new(world, 1).frame(still(pose, flash));
    image::load_from_memory(&jpeg).unwrap().to_rgb8()
}

/// Returns the number and mean position of the pixels of a colour.
fn find(image: &image::RgbImage, wanted: fn([u8; 3]) -> bool) -> (usize, f64, f64) {
    let found: Vec<_> = image
        .enumerate_pixels()
        .filter(|(.., p)| wanted(p.0))
        .collect();
    let count = found.len().max(1) as f64;
    let x = found.iter().map(|(x, ..)| f64::from(*x)).sum::<f64>() / count;
    let y = found.iter().map(|(_, y, _)| f64::from(*y)).sum::<f64>() / count;
    (found.len(), x, y)
}

fn pen(thing: &str) -> World {
    let text = format!(
        "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0}}\n{thing}\n"
    );
    World::from_yaml(&text, "pen").unwrap()
}

#[test]
fn a_red_ball_ahead_is_red_pixels_near_the_centre() {
    let world = pen("balls: [{at: [3, 2], colour: red}]");
    let image = shot(&world, Pose::new(1.9, 2.0, 0.0), false);
    assert_eq!(image.dimensions(), (320, 240));
    let (count, x, y) = find(&image, RED);
    // A radius of 0.1 m at 1 m, focal length 381 pixels: a disc of about 4,500 pixels.
    assert!((3600..5000).contains(&count), "{count}");
    assert!((x - 159.5).abs() < 3.0, "{x}");
    assert!((y - 158.0).abs() < 6.0, "{y}");
}

#[test]
fn a_thing_on_the_left_appears_on_the_left() {
    let world = pen("balls: [{at: [3, 2.3], colour: red}]");
    let (count, x, _) = find(&shot(&world, Pose::new(1.9, 2.0, 0.0), false), RED);
    assert!(count > 1000 && x < 100.0, "{count} at {x}");
}

#[test]
fn posts_are_upright_and_hide_things_behind_them() {
    let world = pen(
        "balls: [{at: [3, 2], colour: red}]\nposts: [{at: [2.6, 2], radius: 0.15, colour: blue}]",
    );
    let image = shot(&world, Pose::new(1.9, 2.0, 0.0), false);
    let (blue, x, y) = find(&image, |[r, g, b]| b > 110 && r < 80 && g < 120);
    assert!(
        blue > 8000 && (x - 159.5).abs() < 4.0 && y < 160.0,
        "{blue} at {x}, {y}"
    );
    assert_eq!(find(&image, RED).0, 0);
}

#[test]
fn low_furniture_hides_the_ball_but_not_the_post_behind_it() {
    let world = pen(
        "furniture: [{at: [3, 2], length: 0.4, width: 1, height: 0.3, colour: grey}]\n\
         balls: [{at: [3.5, 2], colour: green}]\nposts: [{at: [3.5, 2], height: 1, colour: red}]",
    );
    let image = shot(&world, Pose::new(1.5, 2.0, 0.0), false);
    let (red, _, y) = find(&image, RED);
    assert!(red > 300 && y < 115.0, "{red} at row {y}");
    assert_eq!(find(&image, |[r, g, _]| g > 110 && r < 80).0, 0);
}

#[test]
fn the_headlight_brightens_near_things_and_the_lamps_everything() {
    let brightness = |light: f64, flash: bool| {
        let image = shot(
            &pen(&format!("light: {light}")),
            Pose::new(1.0, 2.0, PI),
            flash,
        );
        image
            .as_raw()
            .iter()
            .map(|channel| u64::from(*channel))
            .sum::<u64>()
    };
    assert!(brightness(0.2, true) > brightness(0.2, false) * 5 / 4);
    assert!(brightness(1.0, false) > brightness(0.2, false) * 3);
}

#[test]
fn frames_are_small_and_the_same_for_the_same_seed() {
    let world = World::default_world();
    let frame = |seed| Camera::new(&world, seed).frame(still(world.start_pose(), false));
    assert_eq!(frame(1), frame(1));
    assert_ne!(frame(1), frame(2));
    assert!(
        (3_500..7_000).contains(&frame(1).len()),
        "{}",
        frame(1).len()
    );
}

#[test]
fn a_robot_at_rest_sees_changes() {
    let world = pen("balls: [{at: [3, 2], colour: red}]");
    let mut camera = Camera::new(&world, 1);
    let look = |camera: &mut Camera, flash| {
        let jpeg = camera.frame(still(Pose::new(1.9, 2.0, 0.0), flash));
        image::load_from_memory(&jpeg).unwrap().to_rgb8()
    };
    let bright = |image: &image::RgbImage| {
        let channels = image.as_raw().iter();
        channels.map(|channel| u64::from(*channel)).sum::<u64>()
    };
    let (_, middle, _) = find(&look(&mut camera, false), RED);
    camera.move_rounds([Point::new(3.0, 2.3)].into_iter());
    let moved = look(&mut camera, false);
    let (_, left, _) = find(&moved, RED);
    assert!(left < middle - 30.0, "{left} from {middle}");
    let lit = look(&mut camera, true);
    assert!(bright(&lit) > bright(&moved));
    camera.set_light(0.3);
    let dim = look(&mut camera, true);
    assert!(bright(&dim) < bright(&lit) * 9 / 10);
    assert_eq!(
        find(&look(&mut camera, true), RED).0 > 0,
        find(&dim, RED).0 > 0
    );
}

#[test]
fn every_pose_gives_a_frame_even_inside_things() {
    let world = World::default_world();
    let mut camera = Camera::new(&world, 1);
    for i in 0..120 {
        let x = f64::from(i % 12) * 0.7 - 0.5;
        let y = f64::from(i / 12) * 0.6 - 0.3;
        let jpeg = camera.frame(still(Pose::new(x, y, f64::from(i)), i % 2 == 0));
        assert!(jpeg.starts_with(&[0xFF, 0xD8]) && jpeg.ends_with(&[0xFF, 0xD9]));
    }
}
