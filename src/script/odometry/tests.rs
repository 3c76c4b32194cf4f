use super::super::full_turn::tests::room;
use super::*;
use std::f64::consts::FRAC_PI_2;

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
    (Odometry::new(now, Calibration::default()), now)
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
        // The robot coasts to a stop.
        drive(&mut odometry, &mut now, Driver::None, 1);
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
    odometry.mark(start + Duration::from_secs(1));
    odometry.advance(start + Duration::from_secs(2), LEFT);
    odometry.mark(start + Duration::from_secs(2));
    let (unseen, motion) = (odometry.pose(), odometry.last_track_motion().unwrap());
    odometry.correct_turn(motion.correction(1.4 / 1.05));
    let seen = odometry.pose();
    assert!(
        seen.heading < unseen.heading && seen.heading_error < unseen.heading_error,
        "{seen:?}"
    );
}

#[test]
fn turns_that_pictures_show_late_are_neither_lost_nor_counted_twice() {
    let (late, width) = (
        Duration::from_millis(200),
        Calibration::default().track_width,
    );
    let (mut odometry, start) = odometry();
    let (mut slipping, mut truth, mut turned) = (Ramp::default(), Travel::new(start), 0.0);
    let mut last = start;
    for tick in 0..800 {
        let now = start + Duration::from_millis(10) * (tick + 1);
        let turn = if tick % 200 < 100 { 1.5 } else { 0.0 };
        let forward = if turn == 0.0 { 0.2 } else { 0.0 };
        odometry.advance(now, Driver::Script(Drive { forward, turn }));
        let slips = Drive {
            forward,
            turn: 0.9 * turn,
        };
        let (motion, seconds) = slipping.step(slips, width, 0.01);
        turned += motion.turn * seconds;
        truth.add(now, 0.0, motion.turn * seconds, 0.0);
        if tick % 12 == 0 {
            odometry.mark(now);
            let seen = truth.between(last - late, now - late);
            if let (Some(motion), Some(seen)) = (odometry.last_track_motion(), seen) {
                odometry.picture_delay.note(seen.turn, motion.turns());
                odometry.correct_turn(motion.correction(seen.turn));
            }
            last = now;
        }
    }
    let pose = odometry.pose();
    // Four turns of 1.5 radians, less what the tracks slip.
    assert!((turned - 5.5).abs() < 0.1, "{turned}");
    assert!((pose.heading - turned).abs() < 0.25, "{pose:?}");
}

#[test]
fn a_full_turn_corrects_the_heading_and_measures_the_slip_of_the_tracks() {
    let (mut odometry, mut now) = odometry();
    let (mut looks, share) = (0.0, 0.9);
    let mut turn = |odometry: &mut Odometry, turn: f64, steps: u32| {
        for _ in 0..steps {
            now += Duration::from_millis(100);
            odometry.advance(now, Driver::Script(Drive { forward: 0.0, turn }));
            looks += share * turn * 0.1;
            odometry.mark(now);
            odometry.look(now, Some(room(looks)));
        }
        (odometry.pose(), looks)
    };
    let (pose, truth) = turn(&mut odometry, 1.0, 75);
    let closed = (pose.heading - truth).abs();
    assert!(closed < 0.12, "{pose:?} {truth}");
    let (pose, truth) = turn(&mut odometry, -1.0, 30);
    let then = (pose.heading - truth).abs();
    assert!(then < 0.15 && pose.heading_error < 1.0, "{pose:?} {truth}");
}

#[test]
fn a_person_walking_by_is_not_taken_for_a_turn() {
    let (mut odometry, mut now) = odometry();
    for _ in 0..2 {
        drive(&mut odometry, &mut now, AHEAD, 1);
        odometry.mark(now);
    }
    let motion = odometry.last_track_motion().unwrap();
    odometry.correct_turn(motion.correction(0.3));
    assert!(near(odometry.pose().heading, 0.0));
}

#[test]
fn motion_by_others_makes_the_place_uncertain_but_late_reports_of_own_motion_do_not() {
    let (mut odometry, start) = odometry();
    odometry.advance(start + Duration::from_secs(1), AHEAD);
    let own = odometry.pose();
    assert!(!odometry.advance(start + Duration::from_millis(1200), Driver::Other));
    let echo = odometry.pose();
    assert!(
        near(echo.x, 0.2) && echo.error < own.error + 0.01,
        "{echo:?}"
    );
    assert!(odometry.advance(start + Duration::from_secs(9), Driver::Other));
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

#[test]
fn a_full_turn_that_began_before_a_reset_does_not_correct_the_new_pose() {
    let (mut odometry, mut now) = odometry();
    let (turn, mut turned, mut since_reset) = (1.0, 0.0, 0.0);
    for step in 1..=75 {
        now += Duration::from_millis(100);
        odometry.advance(now, Driver::Script(Drive { forward: 0.0, turn }));
        turned += 0.9 * turn * 0.1;
        since_reset += 0.9 * turn * 0.1;
        odometry.mark(now);
        odometry.look(now, Some(room(turned)));
        // Shortly before the camera sees the same view again.
        if step == 65 {
            odometry.reset();
            since_reset = 0.0;
        }
    }
    let error = odometry.pose().heading - since_reset;
    assert!(error.abs() < 0.05, "{error}");
}
