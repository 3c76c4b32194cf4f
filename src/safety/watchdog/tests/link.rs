//! A silent robot, and a lost link.

use super::rig::*;
use super::*;

#[test]
fn a_leg_over_a_silent_stream_stops_and_nothing_is_sent_after_it() {
    let limits = Limits {
        stream_silence: crate::robot::Seconds::from_secs(1),
        ..Limits::default()
    };
    let (mut rig, _) = lost(20, limits);
    rig.handle(Fact::Streaming(true));
    let acts = rig.pass(1500 * MS, false);
    assert!(reconnects(&acts));
    assert_eq!(tracks(&acts).last(), Some(&(0, 0)));
    assert_eq!(count(&acts, &FIND), 0);
}

#[test]
fn a_silent_stream_while_moving_stops_and_reconnects() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::Streaming(true));
    rig.drive(1, None);
    assert!(
        !rig.pass(2900 * MS, true)
            .iter()
            .any(|act| matches!(act, Act::Reconnect(_)))
    );
    let acts = rig.pass(200 * MS, true);
    let stop = acts
        .iter()
        .position(|act| *act == Act::Send(Command::STOP))
        .unwrap();
    let close = acts
        .iter()
        .position(|act| matches!(act, Act::Reconnect(_)))
        .unwrap();
    assert!(stop < close, "{acts:?}");
    assert_eq!(events(&acts), [ended(1, MotionEnd::Disconnected)]);
}

#[test]
fn a_late_stream_gets_the_full_timeout_once() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    rig.pass(10 * SECOND, true);
    rig.handle(Fact::Streaming(true));
    assert!(!reconnects(&rig.pass(2900 * MS, true)));
    rig.handle(Fact::Streaming(true));
    assert!(
        reconnects(&rig.pass(200 * MS, true)),
        "reported twice, no data"
    );
}

#[test]
fn a_robot_that_sends_data_keeps_driving() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::Streaming(true));
    rig.drive(1, None);
    for _ in 0..10 {
        let acts = rig.pass(SECOND, true);
        assert!(!reconnects(&acts) && !sent(&acts).contains(&Command::STOP));
        rig.handle(Fact::BytesReceived);
    }
}

#[test]
fn a_silent_robot_without_a_stream_is_normal() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert!(
        !rig.pass(60 * SECOND, true)
            .iter()
            .any(|act| matches!(act, Act::Reconnect(_)))
    );
}

#[test]
fn a_search_interrupted_by_a_lost_link_is_ended_after_the_reconnect() {
    let mut rig = Rig::online(60);
    rig.dock(1);
    rig.handle(Fact::LinkDown);
    let up = Fact::LinkUp {
        docked: false,
        power: power(60),
    };
    assert_eq!(sent(&rig.handle(up)), [CANCEL, Command::STOP]);
}

#[test]
fn a_cancellation_that_the_link_may_have_lost_is_repeated() {
    let up = Fact::LinkUp {
        docked: false,
        power: power(60),
    };
    let mut rig = Rig::online(60);
    rig.dock(1);
    assert_eq!(sent(&rig.ask(Intent::CancelDock)), [CANCEL, Command::STOP]);
    for _ in 0..2 {
        rig.handle(Fact::LinkDown);
        rig.now += 600 * SECOND;
        assert_eq!(sent(&rig.handle(up.clone())), [CANCEL, Command::STOP]);
    }
    assert_eq!(sent(&rig.handle(Fact::Suspended)), [CANCEL, Command::STOP]);
}

#[test]
fn a_report_that_the_search_has_ended_needs_no_cancellation() {
    for news in [EngineReport::BaseNotFound, EngineReport::Docked] {
        let mut rig = Rig::online(60);
        rig.dock(1);
        rig.ask(Intent::CancelDock);
        rig.handle(Fact::Engine(news));
        rig.handle(Fact::LinkDown);
        let acts = rig.handle(Fact::LinkUp {
            docked: news == EngineReport::Docked,
            power: power(60),
        });
        assert_eq!(sent(&acts), [], "{news:?}");
    }
}

#[test]
fn without_a_link_nothing_is_sent() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.handle(Fact::LinkDown);
    assert_eq!(
        (sent(&acts), events(&acts)),
        (vec![], vec![ended(1, MotionEnd::Disconnected)])
    );
    assert_eq!(
        events(&rig.drive(2, None)),
        [ended(2, MotionEnd::Disconnected)]
    );
    assert_eq!(rig.dog.next_deadline(), None);
}

#[test]
fn after_a_reconnect_a_low_robot_is_sent_home_again() {
    let mut rig = Rig::online(20);
    rig.handle(Fact::LinkDown);
    let acts = rig.handle(Fact::LinkUp {
        docked: false,
        power: power(19),
    });
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}
