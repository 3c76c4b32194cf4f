//! Last words, and what is sent after a loss of the link or a suspension of the machine, and at the
//! end of a run.

use super::rig::*;
use super::*;
use crate::robot::DockPlan;
use crate::safety::LastWords;

#[test]
fn before_a_login_and_with_a_good_battery_the_last_words_are_a_stop() {
    let mut rig = Rig::with(Limits::default());
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
    rig.handle(Fact::LinkUp {
        docked: false,
        power: power(60),
    });
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
    rig.drive(1, None);
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
}

#[test]
fn a_low_robot_that_searches_is_left_alone_and_any_other_is_sent_home() {
    let mut rig = Rig::online(20);
    assert_eq!(rig.dog.last_words(), LastWords::Nothing);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert_eq!(rig.dog.last_words(), LastWords::StopAndDock);
    rig.pass(5 * SECOND, false);
    assert_eq!(rig.dog.last_words(), LastWords::Nothing);
    let (mut rig, _) = lost(20, Limits::default());
    rig.pass(SECOND, false);
    assert!(rig.dog.moving());
    assert_eq!(rig.dog.last_words(), LastWords::StopAndDock);
}

#[test]
fn on_the_station_there_are_no_last_words_unless_the_robot_backs_out() {
    let mut rig = Rig::docked(charging(80));
    assert_eq!(rig.dog.last_words(), LastWords::Nothing);
    rig.undock(1);
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
    let mut rig = Rig::docked(power(21));
    rig.undock(1);
    rig.handle(Fact::Power(power(20)));
    assert_eq!(rig.dog.last_words(), LastWords::StopAndDock);
}

#[test]
fn with_a_good_battery_a_behaviours_search_is_ended() {
    let mut rig = Rig::online(60);
    rig.dock(1);
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
}

#[test]
fn without_a_link_the_last_words_send_a_low_robot_home() {
    for (rig, expected) in [
        (Rig::online(20), LastWords::StopAndDock),
        (Rig::online(60), LastWords::Stop),
        (Rig::docked(charging(80)), LastWords::Stop),
        (Rig::docked(power(10)), LastWords::Stop),
    ] {
        let mut rig = rig;
        rig.handle(Fact::LinkDown);
        assert_eq!(rig.dog.last_words(), expected);
    }
}

#[test]
fn at_the_end_of_a_run_a_low_robot_is_sent_home() {
    let mut rig = Rig::online(20);
    rig.handle(Fact::RunEnding);
    assert_eq!(rig.dog.last_words(), LastWords::Nothing);
}

#[test]
fn a_reconnect_under_alarm_searches_at_once() {
    for limits in [standing(), Limits::default()] {
        let (mut rig, _) = lost(20, limits);
        rig.pass(SECOND, false);
        rig.handle(Fact::LinkDown);
        rig.now += SECOND;
        let acts = rig.handle(Fact::LinkUp {
            docked: false,
            power: power(19),
        });
        assert_eq!(count(&acts, &FIND), 1, "{acts:?}");
    }
}

#[test]
fn after_a_sleep_nothing_old_is_repeated() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.handle(Fact::Suspended);
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(events(&acts), [ended(1, MotionEnd::Disconnected)]);
    assert_eq!(sent(&rig.pass(SECOND, true)), []);
    assert_eq!(sent(&rig.drive(2, None)), [FORWARD]);
}

#[test]
fn after_a_sleep_a_behaviours_docking_is_over() {
    let mut rig = Rig::online(60);
    rig.dock(1);
    let acts = rig.handle(Fact::Suspended);
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Disconnected, 1)));
    let mut rig = Rig::docked(charging(80));
    rig.undock(1);
    let acts = rig.handle(Fact::Suspended);
    assert_eq!(undock_ended(&acts), Some(DockEnd::Disconnected));
    assert_eq!(rig.dog.dock_state(), DockState::Unknown);
}

#[test]
fn after_a_sleep_a_low_robot_searches_at_once() {
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.handle(Fact::Suspended)), [Command::STOP, FIND]);
    let (mut rig, _) = lost(20, standing());
    rig.pass(2 * SECOND, false);
    assert_eq!(sent(&rig.handle(Fact::Suspended)), [Command::STOP, FIND]);
}

#[test]
fn a_sleep_without_a_link_sends_nothing() {
    let mut rig = Rig::online(20);
    rig.handle(Fact::LinkDown);
    assert_eq!(rig.handle(Fact::Suspended), []);
}

#[test]
fn at_the_end_of_a_run_all_motion_stops_and_is_refused() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.handle(Fact::RunEnding);
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(events(&acts), [ended(1, MotionEnd::Cancelled)]);
    assert_eq!(
        events(&rig.drive(2, None)),
        [ended(2, MotionEnd::Cancelled)]
    );
}

#[test]
fn at_the_end_of_a_run_docking_and_undocking_are_refused() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::RunEnding);
    let acts = rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
    assert_eq!(sent(&acts), []);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 0)));
    rig.handle(Fact::Engine(EngineReport::Docked));
    let acts = rig.ask(Intent::Undock {
        call: CallId(8),
        timeout: SECOND,
    });
    assert_eq!(sent(&acts), []);
    let end = DockEnd::Cancelled;
    assert_eq!(
        events(&acts),
        [Event::UndockEnded {
            call: CallId(8),
            end
        }]
    );
}

#[test]
fn at_the_end_of_a_run_a_behaviours_docking_ends_and_the_watchdogs_goes_on() {
    let mut rig = Rig::online(60);
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
    assert_eq!(sent(&rig.handle(Fact::RunEnding)), [CANCEL, Command::STOP]);
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.handle(Fact::RunEnding)), [Command::STOP, FIND]);
}
