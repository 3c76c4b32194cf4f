//! The path of a robot with a low battery, sent with the first loan.

use super::rig::*;
use super::*;
use crate::robot::Stroke;

const NOT_FOUND: Fact = Fact::Engine(EngineReport::BaseNotFound);
const RESCUER: BehaviourId = BehaviourId(9);
/// At a quarter of the power for two seconds.
const WAY: Stroke = Stroke {
    left: 1.0,
    right: 1.0,
};

/// The robot has left its station and driven for two seconds.
fn driven() -> Rig {
    let mut rig = Rig::docked(power(90));
    rig.undock(1);
    rig.now += SECOND;
    rig.take(Fact::Engine(EngineReport::Undocked));
    rig.drive(1, None);
    rig.pass(2 * SECOND, true);
    rig
}

/// The battery becomes low and the first search fails after five seconds: the loan that follows, if
/// any.
fn loan_after(mut rig: Rig) -> Option<(Duration, Option<Vec<Stroke>>)> {
    rig.take(Fact::Power(power(15)));
    rig.take(Fact::Rescuer(Some(RESCUER)));
    rig.now += 5 * SECOND;
    loan(&rig.take(NOT_FOUND))
}

fn loan(acts: &[Act]) -> Option<(Duration, Option<Vec<Stroke>>)> {
    events(acts).into_iter().find_map(|event| match event {
        Event::Loan { low_for, way, .. } => Some((low_for, way.map(rounded))),
        _ => None,
    })
}

/// Rounded to milliseconds.
fn rounded(way: Vec<Stroke>) -> Vec<Stroke> {
    let round = |seconds: f32| (seconds * 1000.0).round() / 1000.0;
    let stroke = |Stroke { left, right }| Stroke {
        left: round(left),
        right: round(right),
    };
    way.into_iter().map(stroke).collect()
}

#[test]
fn the_first_loan_contains_the_path_from_the_station() {
    let (low_for, way) = loan_after(driven()).unwrap();
    assert_eq!(low_for, 5 * SECOND);
    assert_eq!(way, Some(vec![WAY]));
}

#[test]
fn the_first_commands_are_still_stop_and_search() {
    let mut rig = driven();
    let acts = rig.take(Fact::Power(power(15)));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn each_turn_is_a_stroke_and_standing_is_not() {
    let mut rig = driven();
    rig.ask(Intent::Stop);
    rig.pass(10 * SECOND, true);
    rig.ask(Intent::Move {
        motion: crate::robot::MotionId(2),
        setpoint: Setpoint::from_percent(-100.0, 100.0).unwrap(),
        duration: Some(500 * MS),
    });
    rig.pass(SECOND, true);
    let turn = Stroke {
        left: -0.5,
        right: 0.5,
    };
    assert_eq!(loan_after(rig).unwrap().1, Some(vec![WAY, turn]));
}

#[test]
fn no_later_loan_contains_the_path() {
    let mut rig = driven();
    rig.take(Fact::Power(power(15)));
    rig.take(Fact::Rescuer(Some(RESCUER)));
    rig.now += SECOND;
    assert!(loan(&rig.take(NOT_FOUND)).unwrap().1.is_some());
    rig.pass(20 * SECOND, true);
    assert_eq!(loan(&rig.take(NOT_FOUND)).unwrap().1, None);
}

#[test]
fn any_other_motion_makes_the_path_unknown() {
    let low = power(90);
    let up = |docked| Fact::LinkUp { docked, power: low };
    let cases: [(&str, Vec<Fact>); 5] = [
        ("the link dropped", vec![Fact::LinkDown, up(false)]),
        ("the machine slept", vec![Fact::Suspended]),
        (
            "on its station, and carried off",
            vec![
                Fact::Engine(EngineReport::Docked),
                Fact::Engine(EngineReport::Undocked),
            ],
        ),
        ("carried", vec![Fact::Engine(EngineReport::Undocked)]),
        (
            "charges, then no longer",
            // The first of them may be older than the undocking.
            [
                vec![Fact::Power(charging(90)); 10],
                vec![Fact::Power(power(90))],
            ]
            .concat(),
        ),
    ];
    for (why, facts) in cases {
        let mut rig = driven();
        for fact in facts {
            rig.now += SECOND;
            rig.take(fact);
        }
        let way = loan_after(rig).and_then(|(_, way)| way);
        assert_eq!(way, None, "{why}");
    }
}

#[test]
fn a_search_by_the_robot_makes_the_path_unknown() {
    let mut rig = driven();
    rig.dock(7);
    rig.now += SECOND;
    rig.ask(Intent::CancelDock);
    assert_eq!(loan_after(rig).unwrap().1, None);
}

#[test]
fn a_robot_first_seen_off_its_station_has_no_known_path() {
    let mut rig = Rig::online(90);
    rig.drive(1, None);
    rig.pass(2 * SECOND, true);
    assert_eq!(loan_after(rig).unwrap().1, None);
}

#[test]
fn an_event_during_the_first_search_makes_the_path_unknown() {
    let low = power(15);
    let up = Fact::LinkUp {
        docked: false,
        power: low,
    };
    let cases: [(&str, Vec<Fact>); 3] = [
        ("the link dropped", vec![Fact::LinkDown, up]),
        ("the machine slept", vec![Fact::Suspended]),
        ("carried", vec![Fact::Engine(EngineReport::Undocked)]),
    ];
    for (why, facts) in cases {
        let mut rig = driven();
        rig.take(Fact::Power(low));
        rig.take(Fact::Rescuer(Some(RESCUER)));
        for fact in facts {
            rig.now += SECOND;
            rig.take(fact);
        }
        rig.pass(2 * SECOND, true);
        assert_eq!(loan(&rig.take(NOT_FOUND)).unwrap().1, None, "{why}");
    }
}

#[test]
fn a_leg_makes_the_path_unknown() {
    let mut rig = driven();
    rig.take(Fact::Power(power(15)));
    rig.now += SECOND;
    assert_eq!(loan(&rig.take(NOT_FOUND)), None);
    rig.pass(5 * SECOND, true);
    rig.take(Fact::Rescuer(Some(RESCUER)));
    assert_eq!(loan(&rig.take(NOT_FOUND)).unwrap().1, None);
}

#[test]
fn each_undocking_begins_a_new_path() {
    let mut rig = driven();
    rig.take(Fact::Engine(EngineReport::Docked));
    rig.report(charging(90));
    rig.report(charging(90));
    rig.undock(2);
    rig.now += SECOND;
    rig.take(Fact::Engine(EngineReport::Undocked));
    rig.drive(2, None);
    rig.pass(2 * SECOND, true);
    assert_eq!(loan_after(rig).unwrap().1, Some(vec![WAY]));
}
