use std::f64::consts::FRAC_PI_2;

use image::{Rgb, RgbImage};

use super::*;
use crate::vision::{Camera, Image, Size};

const AHEAD: Driver = Driver::Script(Drive {
    forward: 0.2,
    turn: 0.0,
});
const LEFT: Driver = Driver::Script(Drive {
    forward: 0.0,
    turn: FRAC_PI_2,
});

fn odometry() -> (Odometry, Instant) {
    let now = Instant::now();
    (Odometry::new(now, 0.45), now)
}

fn near(one: f64, other: f64) -> bool {
    (one - other).abs() < 1e-6
}

/// Advances time in steps of a hundredth of a second.
fn drive(odometry: &mut Odometry, now: &mut Instant, driver: Driver, seconds: u32) {
    for _ in 0..seconds * 100 {
        *now += Duration::from_millis(10);
        odometry.advance(*now, driver);
    }
}

#[test]
fn a_line_a_turn_and_an_arc_end_where_geometry_says() {
    let (mut odometry, mut now) = odometry();
    let arc = Driver::Script(Drive {
        forward: FRAC_PI_2 / 10.0,
        turn: FRAC_PI_2 / 10.0,
    });
    for (driver, seconds, x, y) in [
        (AHEAD, 1, 0.2, 0.0),
        (LEFT, 1, 0.2, 0.0),
        (AHEAD, 1, 0.2, 0.2),
        (arc, 10, -0.8, 1.2),
    ] {
        drive(&mut odometry, &mut now, driver, seconds);
        let pose = odometry.pose();
        assert!((pose.x - x).hypot(pose.y - y) < 0.02, "{pose:?}");
    }
    assert!(near(odometry.pose().heading, PI));
    odometry.reset();
    assert_eq!(odometry.pose(), Pose::default());
}

#[test]
fn the_error_grows_with_the_distance_and_less_if_the_camera_saw_the_turn() {
    let (mut odometry, start) = odometry();
    odometry.advance(start + Duration::from_secs(1), AHEAD);
    let straight = odometry.pose();
    assert!(straight.error > 0.0 && straight.heading_error > 0.0);
    odometry.advance(start + Duration::from_secs(2), LEFT);
    let unseen = odometry.pose();
    odometry.correct_turn(1.4 / PARALLAX, turn(FRAC_PI_2), 0.0);
    let seen = odometry.pose();
    assert!(
        seen.heading < unseen.heading && seen.heading_error < unseen.heading_error,
        "{seen:?}"
    );
}

/// What tracks do in a turn on the spot.
fn turn(radians: f64) -> Totals {
    Totals {
        turn: radians,
        turned: radians.abs(),
        way: 0.0,
    }
}

/// The view of a camera in a round room that is turned to the left by this many radians.
fn room(turned: f64) -> Skyline {
    let camera = Camera::default();
    let size = Size {
        width: 160,
        height: 120,
    };
    let picture = RgbImage::from_fn(160, 120, |x, _| {
        let angle = turned + camera.bearing(f64::from(x), 52.0, size);
        let value = 120.0
            + 50.0 * (angle * 3.0).sin()
            + 40.0 * (angle * 7.0).sin()
            + 20.0 * (angle * 17.0).cos();
        Rgb([value as u8; 3])
    });
    Skyline::from_image(&Image::from_rgb(&picture), camera)
}

#[test]
fn turns_that_pictures_show_late_are_neither_lost_nor_counted_twice() {
    let (mut odometry, start) = odometry();
    let mut turned = 0.0;
    let mut shown = VecDeque::from([0.0; 20]);
    for tick in 0..800 {
        let now = start + Duration::from_millis(10) * (tick + 1);
        let turn = if tick % 200 < 100 { 1.5 } else { 0.0 };
        let forward = if turn == 0.0 { 0.2 } else { 0.0 };
        odometry.advance(now, Driver::Script(Drive { forward, turn }));
        // The tracks slip by a tenth, and pictures are 0.2 s late.
        turned += 0.9 * turn * 0.01;
        shown.push_back(turned);
        let seen = shown.pop_front().unwrap_or_default();
        if tick % 12 == 0 {
            odometry.mark(now);
            odometry.look(now, Some(room(seen * PARALLAX)));
        }
    }
    let pose = odometry.pose();
    // The tracks alone say four turns of 1.5 radians.
    assert!((turned - 5.4).abs() < 1e-6, "{turned}");
    assert!((pose.heading - turned).abs() < 0.25, "{pose:?}");
}

#[test]
fn a_person_walking_by_is_not_taken_for_a_turn() {
    let (mut odometry, mut now) = odometry();
    drive(&mut odometry, &mut now, AHEAD, 1);
    let straight = Totals {
        turn: 0.0,
        turned: 0.0,
        way: 0.2,
    };
    odometry.correct_turn(0.3, straight, 0.0);
    assert!(near(odometry.pose().heading, 0.0));
}

#[test]
fn motion_by_others_makes_the_place_uncertain_but_late_reports_of_own_motion_do_not() {
    let (mut odometry, start) = odometry();
    odometry.advance(start + Duration::from_secs(1), AHEAD);
    let own = odometry.pose();
    odometry.advance(start + Duration::from_millis(1200), Driver::Other);
    let echo = odometry.pose();
    assert!(
        near(echo.x, 0.2) && echo.error < own.error + 0.01,
        "{echo:?}"
    );
    odometry.advance(start + Duration::from_secs(9), Driver::Other);
    let pose = odometry.pose();
    assert!(pose.error > 1.0 && near(pose.heading_error, PI), "{pose:?}");
    assert!(near(pose.x, echo.x));
}

#[test]
fn a_blocked_robot_has_not_advanced() {
    let (mut odometry, mut now) = odometry();
    let start = now;
    for _ in 0..3 {
        drive(&mut odometry, &mut now, AHEAD, 1);
        odometry.mark(now);
    }
    odometry.rewind(start + Duration::from_secs(2));
    assert!((odometry.pose().x - 0.4).abs() < 0.02);
}
