//! What each dock state allows, and what a robot with a low battery does whose dock state is in
//! doubt.

use super::rig::*;
use super::*;
use crate::safety::Source;
use crate::wire::Sound;

/// CHARGE_STOP was sent and the robot has not confirmed it.
fn with_unconfirmed_undocking(percent: u8) -> Rig {
    let mut rig = Rig::docked(power(percent));
    assert_eq!(sent(&rig.undock(1)), [LEAVE]);
    rig
}

#[test]
fn after_an_unconfirmed_undocking_a_robot_that_becomes_low_searches() {
    let mut rig = with_unconfirmed_undocking(80);
    let acts = rig.pass(20 * SECOND, false);
    assert_eq!(undock_ended(&acts), Some(DockEnd::Timeout));
    assert_eq!(rig.dog.dock_state(), DockState::Unknown);
    assert_eq!(
        sent(&rig.handle(Fact::Power(power(20)))),
        [Command::STOP, FIND]
    );
}

#[test]
fn a_robot_that_becomes_low_while_undocking_searches_after_the_timeout() {
    let mut rig = with_unconfirmed_undocking(21);
    assert_eq!(sent(&rig.handle(Fact::Power(power(20)))), []);
    assert_eq!(sent(&rig.pass(19 * SECOND, false)), []);
    assert_eq!(sent(&rig.pass(2 * SECOND, false)), [Command::STOP, FIND]);
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn scripts_may_drive_in_an_unknown_place_but_not_while_backing_out() {
    let mut rig = with_unconfirmed_undocking(80);
    assert_eq!(events(&rig.drive(1, None)), [ended(1, MotionEnd::Docked)]);
    rig.pass(20 * SECOND, false);
    assert_eq!(sent(&rig.drive(2, None)), [FORWARD]);
}

#[test]
fn the_end_of_charging_while_backing_out_does_not_allow_motion_yet() {
    let mut rig = Rig::docked(charging(80));
    rig.undock(1);
    rig.handle(Fact::Power(power(80)));
    assert_eq!(rig.dog.dock_state(), DockState::Left(Source::Power));
    assert_eq!(events(&rig.drive(1, None)), [ended(1, MotionEnd::Docked)]);
    let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
    assert_eq!(undock_ended(&acts), Some(DockEnd::Done));
    assert_eq!(sent(&rig.drive(2, None)), [FORWARD]);
}

#[test]
fn charging_reported_just_after_a_requested_undocking_is_ignored_as_outdated() {
    let mut rig = Rig::docked(charging(80));
    rig.undock(1);
    rig.handle(Fact::Engine(EngineReport::Undocked));
    rig.pass(4 * SECOND, false);
    rig.handle(Fact::Power(charging(80)));
    assert_eq!(rig.dog.dock_state(), DockState::Left(Source::Engine));
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
    rig.pass(6 * SECOND, true);
    rig.handle(Fact::Power(charging(80)));
    assert_eq!(rig.dog.dock_state(), DockState::Charging, "it was put back");
}

#[test]
fn charging_after_an_unrequested_undocking_is_believed() {
    let mut rig = Rig::docked(charging(80));
    rig.handle(Fact::Engine(EngineReport::Undocked));
    rig.handle(Fact::Power(charging(80)));
    assert_eq!(rig.dog.dock_state(), DockState::Charging);
}

#[test]
fn in_an_unknown_place_undocking_and_docking_are_tried_again() {
    let mut rig = with_unconfirmed_undocking(80);
    rig.pass(20 * SECOND, false);
    assert_eq!(sent(&rig.undock(2)), [LEAVE]);
    rig.pass(20 * SECOND, false);
    assert_eq!(sent(&rig.dock(3)), [Command::STOP, FIND]);
}

#[test]
fn a_wrong_login_report_is_believed_until_the_charge_timeout() {
    let mut rig = Rig::docked(power(10));
    assert_eq!(sent(&rig.pass(28 * SECOND, false)), []);
    let acts = rig.pass(2 * SECOND, false);
    assert_eq!(count(&acts, &FIND), 1);
    assert_eq!(count(&acts, &Command::Play(Sound::Alarm)), 1);
    assert_eq!(
        reasons(&acts),
        ["docking failed (not_charging) 1 times: searches again"]
    );
}

#[test]
fn repeated_reconnects_do_not_renew_that_belief() {
    let mut rig = Rig::docked(power(10));
    let mut acts = Vec::new();
    for _ in 0..4 {
        acts.extend(rig.pass(10 * SECOND, false));
        rig.handle(Fact::LinkDown);
        acts.extend(rig.handle(Fact::LinkUp {
            docked: true,
            power: power(10),
        }));
    }
    assert!(count(&acts, &FIND) >= 1, "{acts:?}");
}

#[test]
fn on_a_station_without_current_it_sounds_the_alarm_and_searches_once_undocked() {
    let (mut rig, _) = lost(20, Limits::default());
    rig.pass(3 * SECOND, false);
    rig.handle(Fact::Engine(EngineReport::Docked));
    let acts = rig.pass(29 * SECOND, false);
    assert_eq!(count(&acts, &FIND), 0);
    let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn a_low_robot_that_slides_off_its_station_searches_at_once() {
    let mut rig = Rig::docked(power(10));
    let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    rig.handle(Fact::Engine(EngineReport::Docked));
    let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn a_robot_whose_charge_is_held_by_hysteresis_is_not_undocked() {
    let mut rig = Rig::online(20);
    rig.handle(Fact::Engine(EngineReport::Docked));
    rig.handle(Fact::Power(power(30)));
    assert_eq!(undock_ended(&rig.undock(1)), Some(DockEnd::Safety));
}

#[test]
fn a_robot_that_drives_searches_or_leaves_its_station_moves() {
    let mut rig = Rig::online(60);
    assert!(!rig.dog.is_robot_moving());
    rig.drive(1, None);
    assert!(rig.dog.is_robot_moving());
    rig.ask(Intent::Stop);
    assert!(!rig.dog.is_robot_moving());
    rig.dock(2);
    assert!(rig.dog.is_robot_moving(), "it searches");
    rig.ask(Intent::CancelDock);
    assert!(!rig.dog.is_robot_moving());

    let mut rig = with_unconfirmed_undocking(80);
    assert!(rig.dog.is_robot_moving(), "it leaves");
    rig.handle(Fact::Gone(WHO));
    assert!(rig.dog.is_robot_moving(), "it leaves without a caller");
    rig.handle(Fact::Engine(EngineReport::Undocked));
    assert!(!rig.dog.is_robot_moving());
}
