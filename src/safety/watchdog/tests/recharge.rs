//! A station that has ended charging.

use super::*;
use crate::safety::ALARM;

const UNDOCKED: Fact = Fact::Engine(EngineReport::Undocked);
const DOCKED: Fact = Fact::Engine(EngineReport::Docked);

/// On a station that has charged it and no longer does.
fn charged() -> Rig {
    let mut rig = Rig::docked(charging(100));
    assert_eq!(sent(&rig.report(power(100))), []);
    assert_eq!(sent(&rig.pass(125 * SECOND, true)), []);
    rig
}

/// Falls from 99 % to this level.
fn fall(rig: &mut Rig, to: u8) -> Vec<Command> {
    let levels = (to..100).rev();
    levels
        .flat_map(|level| sent(&rig.report(power(level))))
        .collect()
}

#[test]
fn it_leaves_at_80_percent_docks_again_and_charges() {
    let mut rig = charged();
    assert_eq!(fall(&mut rig, 81), []);
    assert_eq!(sent(&rig.report(power(80))), [LEAVE]);
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
    assert_eq!(sent(&rig.handle(UNDOCKED)), [Command::STOP, FIND]);
    rig.pass(8 * SECOND, true);
    rig.handle(DOCKED);
    assert_eq!(sent(&rig.report(charging(79))), []);
    let report = rig.dog.take_dock_report().unwrap();
    assert_eq!((report.by, report.outcome.end), (None, DockEnd::Done));
    assert!(rig.dog.docked() && !rig.dog.recharge.is_away());
}

#[test]
fn a_charging_a_full_and_a_low_robot_stay_where_they_are() {
    let mut full = charged();
    assert_eq!(fall(&mut full, 90), []);
    assert_eq!(sent(&full.pass(580 * SECOND, true)), []);
    let mut charges = Rig::docked(charging(60));
    for level in (30..60).rev() {
        assert_eq!(sent(&charges.report(charging(level))), []);
    }
    let mut low = Rig::docked(power(19));
    assert!(low.dog.low().is_some());
    assert!(!sent(&low.pass(25 * SECOND, true)).contains(&LEAVE));
}

#[test]
fn a_persons_stop_holds_it_on_its_station() {
    let mut rig = charged();
    rig.handle(Fact::StoppedByPerson(true));
    assert_eq!(fall(&mut rig, 75), []);
    assert_eq!(sent(&rig.pass(600 * SECOND, true)), []);
    let acts = rig.handle(Fact::StoppedByPerson(false));
    assert_eq!(sent(&acts), [LEAVE]);
}

#[test]
fn a_behaviour_that_drives_ends_it_and_one_that_stops_does_not() {
    let mut rig = charged();
    assert_eq!(fall(&mut rig, 80), [LEAVE]);
    rig.handle(UNDOCKED);
    assert_eq!(sent(&rig.ask(Intent::Stop)), []);
    assert_eq!(sent(&rig.handle(Fact::Gone(WHO))), []);
    assert_eq!(sent(&rig.drive(1, None)), [CANCEL, Command::STOP]);
    assert!(sent(&rig.pass(SECOND, true)).contains(&FORWARD));
    assert!(!sent(&rig.pass(300 * SECOND, true)).contains(&FIND));
}

#[test]
fn where_it_does_not_find_its_station_it_searches_again_each_minute() {
    let mut rig = charged();
    fall(&mut rig, 80);
    rig.handle(UNDOCKED);
    let not_found = || Fact::Engine(EngineReport::BaseNotFound);
    for _ in 0..4 {
        for _ in 0..3 {
            rig.handle(not_found());
            rig.pass(3 * SECOND, true);
        }
        assert!(rig.dog.docking.is_none());
        assert_eq!(rig.pass(50 * SECOND, true), []);
        assert!(sent(&rig.pass(10 * SECOND, true)).ends_with(&[Command::STOP, FIND]));
        rig.report(power(79));
    }
    // Low, it is the way home as always.
    rig.handle(not_found());
    rig.report(power(20));
    assert!(rig.dog.low().is_some() && !rig.dog.recharge.is_away());
}

#[test]
fn if_it_does_not_charge_again_the_alarm_sounds_once_and_it_waits_for_the_next_fifth() {
    let mut rig = charged();
    fall(&mut rig, 80);
    let mut acts = Vec::new();
    for _ in 0..3 {
        rig.handle(UNDOCKED);
        rig.pass(5 * SECOND, true);
        rig.handle(DOCKED);
        acts.extend(rig.pass(31 * SECOND, true));
    }
    assert_eq!(sent(&acts), [&[LEAVE, LEAVE][..], &ALARM].concat());
    assert!(rig.dog.docked() && rig.dog.low().is_none());
    rig.pass(300 * SECOND, true);
    for level in (61..80).rev() {
        assert_eq!(sent(&rig.report(power(level))), []);
    }
    assert_eq!(sent(&rig.report(power(60))), [LEAVE]);
}

#[test]
fn it_leaves_at_once_when_an_undocking_and_the_wait_for_charging_end_together() {
    let mut rig = Rig::docked(power(31));
    assert_eq!(sent(&rig.undock(1)), [LEAVE]);
    rig.handle(DOCKED);
    // The machine sleeps through both deadlines.
    rig.now += 130 * SECOND;
    let acts = rig.dog.poll(rig.now);
    assert_eq!(sent(&acts), [LEAVE]);
    assert!(rig.dog.next_deadline().is_none_or(|due| due > rig.now));
}
