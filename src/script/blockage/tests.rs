//! Tests of the decisions that need no pictures, only distances and counts.

use super::*;

const CURVE: Drive = Drive {
    forward: 0.3,
    turn: 0.4,
};

fn timed(drive: Drive, since: Instant, odometer: f64) -> TimedMotion {
    TimedMotion {
        motion: MotionId(1),
        since,
        drive,
        odometer,
        heading: 0.0,
    }
}

#[test]
fn in_a_gentle_curve_a_near_object_is_reached_in_the_end() {
    let start = Instant::now();
    let mut blockage = Blockage::default();
    blockage.note_close(Some(0.6), start, timed(CURVE, start, 1.0));
    assert_eq!(blockage.arrived(timed(CURVE, start, 1.55)), None);
    let since = blockage.arrived(timed(CURVE, start, 1.65)).unwrap();
    assert!(((since - start).as_secs_f64() - 2.0).abs() < 1e-3);
    let sharp = Drive { turn: 0.8, ..CURVE };
    assert_eq!(blockage.arrived(timed(sharp, start, 1.65)), None);
    blockage.note_close(None, start, timed(CURVE, start, 1.65));
    assert_eq!(blockage.arrived(timed(CURVE, start, 1.7)), None);
}

#[test]
fn enough_pictures_must_agree_and_fewer_at_the_beginning_of_a_motion() {
    let start = Instant::now();
    for (began, fewest) in [
        (start, PICTURES_AT_FIRST),
        (start - Duration::from_secs(3), PICTURES),
    ] {
        let (mut blockage, at) = (Blockage::default(), start + STOOD);
        for pictures in 1..=PICTURES {
            blockage.note(Verdict::Stands, Some(start), at);
            let stood = blockage.stood(at, began);
            assert_eq!(stood, (pictures >= fewest).then_some(start));
        }
    }
}
