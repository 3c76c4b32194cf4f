//! Grants of the tracks to a rescue behaviour between two searches.

use super::rig::*;
use super::*;
use crate::robot::{MotionId, Percent, Seconds};
use crate::safety::{LastWords, Rescue};

const NOT_FOUND: Fact = Fact::Engine(EngineReport::BaseNotFound);
const RESCUER: BehaviourId = BehaviourId(9);
const CAPPED: Command = Command::Move {
    left: 27,
    right: 13,
};

/// A search has failed, and a rescue behaviour is running.
fn granted(limits: Limits) -> (Rig, Vec<Act>) {
    let mut rig = searching(20, limits);
    assert!(rig.dog.wants_rescue());
    rig.handle(Fact::Rescuer(Some(RESCUER)));
    let acts = rig.handle(NOT_FOUND);
    (rig, acts)
}

fn drive(rig: &mut Rig, motion: u64) -> Vec<Act> {
    let intent = Intent::Move {
        motion: MotionId(motion),
        setpoint: Setpoint::from_percent(100.0, 50.0).unwrap(),
        duration: None,
    };
    let acts = rig.ask_as(RESCUER, 0, intent);
    [acts, alive(rig, 20)].concat()
}

/// Lets this many milliseconds pass; the rescuer shows life.
fn alive(rig: &mut Rig, ms: u32) -> Vec<Act> {
    let end = rig.now + ms * MS;
    let mut acts = Vec::new();
    while rig.now < end {
        rig.now = (rig.now + 20 * MS).min(end);
        acts.extend(rig.handle(Fact::Alive(RESCUER)));
    }
    acts
}

#[test]
fn a_grant_is_announced_and_lasts_eight_seconds_at_thirty_percent() {
    let (mut rig, acts) = granted(Limits::default());
    let grant = Event::DriveGrant {
        seconds: 8 * SECOND,
        power: Percent::saturating(30),
    };
    assert!(acts.contains(&Act::Tell(RESCUER, grant)));
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(sent(&drive(&mut rig, 1)), [CAPPED]);
    assert_eq!(rig.dog.last_words(), LastWords::StopAndDock);
    assert_eq!(count(&alive(&mut rig, 7900), &FIND), 0);
    let acts = alive(&mut rig, 200);
    assert_eq!(sent(&acts)[sent(&acts).len() - 2..], [Command::STOP, FIND]);
    assert_eq!(events(&acts), [ended(1, MotionEnd::Safety)]);
    let refused = drive(&mut rig, 2);
    assert_eq!(
        (sent(&refused), events(&refused)),
        (vec![], vec![ended(2, MotionEnd::Safety)])
    );
}

#[test]
fn during_a_grant_motion_and_stops_of_others_are_refused() {
    let (mut rig, _) = granted(Limits::default());
    drive(&mut rig, 1);
    assert_eq!(events(&rig.drive(2, None)), [ended(2, MotionEnd::Safety)]);
    assert_eq!(rig.ask_as(WHO, i16::MAX, Intent::Stop), []);
    rig.ask_as(WHO, i16::MAX, Intent::CancelDock);
    assert!(rig.dog.moving());
}

#[test]
fn every_end_of_a_grant_is_followed_by_a_stop_and_a_search() {
    let stop = |by| Fact::Asked {
        by,
        priority: Priority(0),
        intent: Intent::Stop,
    };
    let found = || vec![Command::STOP, FIND];
    let ends = [
        (stop(RESCUER), found()),
        (Fact::Gone(RESCUER), found()),
        (Fact::Rescuer(None), found()),
        (Fact::Rescuer(Some(WHO)), found()),
        (Fact::RunEnding, found()),
        (Fact::Suspended, found()),
        (Fact::LinkDown, vec![]),
        (Fact::Engine(EngineReport::Docked), vec![Command::STOP]),
        (Fact::Power(charging(20)), vec![Command::STOP]),
    ];
    for (end, expected) in ends {
        let (mut rig, _) = granted(Limits::default());
        drive(&mut rig, 1);
        alive(&mut rig, 1000);
        assert!(rig.dog.moving());
        assert_eq!(sent(&rig.handle(end.clone())), expected, "{end:?}");
        assert!(!rig.dog.moving(), "{end:?}");
        assert_eq!(sent(&drive(&mut rig, 2)), [], "{end:?}");
    }
}

#[test]
fn a_rescuer_that_falls_silent_is_stopped_and_the_search_follows() {
    let (mut rig, _) = granted(Limits::default());
    drive(&mut rig, 1);
    alive(&mut rig, 1000);
    let acts = rig.pass(300 * MS, false);
    assert_eq!(sent(&acts)[sent(&acts).len() - 2..], [Command::STOP, FIND]);
    let kills = |act: &Act| matches!(act, Act::Kill(..));
    assert!(!rig.pass(2 * SECOND, false).iter().any(kills));
}

#[test]
fn a_second_without_a_motion_ends_a_grant() {
    let (mut rig, _) = granted(Limits::default());
    drive(&mut rig, 1);
    alive(&mut rig, 1000);
    let acts = rig.ask_as(
        RESCUER,
        0,
        Intent::Release {
            motion: MotionId(1),
        },
    );
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(sent(&rig.pass(990 * MS, false)), []);
    assert_eq!(sent(&rig.pass(10 * MS, false)), [Command::STOP, FIND]);
}

#[test]
fn an_unused_grant_is_followed_by_a_blind_move_where_one_is_allowed() {
    let (mut rig, _) = granted(Limits::default());
    assert_eq!(tracks(&rig.pass(1490 * MS, false)), []);
    assert_eq!(tracks(&rig.pass(20 * MS, false)), [(27, 27)]);
    let (mut rig, _) = granted(standing());
    assert_eq!(sent(&rig.pass(1500 * MS, false)), [Command::STOP, FIND]);
}

#[test]
fn loans_are_made_at_the_critical_level_too() {
    let (mut rig, _) = granted(Limits::default());
    drive(&mut rig, 1);
    rig.handle(Fact::Power(power(3)));
    assert!(rig.dog.moving());
    alive(&mut rig, 9000);
    let acts = rig.handle(NOT_FOUND);
    assert!(
        events(&acts)
            .iter()
            .any(|event| matches!(event, Event::DriveGrant { .. }))
    );
}

#[test]
fn a_release_of_the_robot_ends_a_grant() {
    let (mut rig, _) = granted(Limits::default());
    drive(&mut rig, 1);
    rig.report(power(60));
    rig.handle(Fact::Alive(RESCUER));
    while rig.dog.low().is_some() {
        rig.report(power(60));
    }
    assert!(!rig.dog.moving());
}

#[test]
fn only_a_rescuer_gets_a_grant_and_off_disables_grants() {
    let off = Limits {
        rescue: Rescue::Off,
        ..Limits::default()
    };
    let mut rig = searching(20, off);
    assert!(!rig.dog.wants_rescue());
    rig.handle(Fact::Rescuer(Some(RESCUER)));
    rig.handle(NOT_FOUND);
    assert_eq!(rig.dog.grantee(), None);
}

#[test]
fn a_rescuer_is_wanted_while_a_low_robot_is_off_its_station() {
    let mut rig = Rig::online(60);
    assert!(!rig.dog.wants_rescue());
    rig.handle(Fact::Power(power(20)));
    assert!(rig.dog.wants_rescue());
    rig.handle(Fact::Engine(EngineReport::Docked));
    assert!(!rig.dog.wants_rescue());
    rig.handle(Fact::Engine(EngineReport::Undocked));
    assert!(rig.dog.wants_rescue());
    rig.handle(Fact::RunEnding);
    assert!(!rig.dog.wants_rescue());
}

#[test]
fn time_and_power_of_a_grant_are_settings() {
    let limits = Limits {
        rescue_time: Seconds::from_secs(2),
        rescue_power: Percent::saturating(100),
        ..Limits::default()
    };
    let (mut rig, _) = granted(limits);
    let full = Command::Move {
        left: 90,
        right: 45,
    };
    assert_eq!(sent(&drive(&mut rig, 1)), [full]);
    let acts = alive(&mut rig, 2000);
    assert_eq!(count(&acts, &FIND), 1);
}
