//! Silent hosts, a silent robot, a lost link, a suspended machine, and the end of a run: what is
//! sent, and the last words.

use super::*;
use crate::robot::{DockPlan, EndReason};
use crate::safety::LastWords;

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

/// Whether both come, and the stop first.
fn stops_before(acts: &[Act], next: impl Fn(&Act) -> bool) -> bool {
    let stop = acts.iter().position(|act| *act == Act::Send(Command::STOP));
    let next = acts.iter().position(next);
    stop.unwrap() < next.unwrap()
}

#[test]
fn a_silent_stream_while_moving_stops_and_reconnects() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::Streaming(true));
    rig.drive(1, None);
    assert!(!reconnects(&rig.pass(2900 * MS, true)));
    let acts = rig.pass(200 * MS, true);
    assert!(stops_before(&acts, |act| matches!(act, Act::Reconnect(_))));
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
    assert!(!reconnects(&rig.pass(60 * SECOND, true)));
}

#[test]
fn a_search_is_ended_after_a_reconnect_also_if_the_link_may_have_lost_its_cancellation() {
    let up = login(false, power(60));
    let mut rig = Rig::online(60);
    rig.dock(1);
    rig.handle(Fact::LinkDown);
    assert_eq!(sent(&rig.handle(up.clone())), [CANCEL, Command::STOP]);
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
    let acts = rig.handle(login(false, power(19)));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn a_silent_host_is_stopped_first_and_then_ended() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert!(!sent(&rig.pass(240 * MS, false)).contains(&Command::STOP));
    let acts = rig.pass(20 * MS, false);
    assert_eq!(sent(&acts), [Command::STOP]);
    assert!(!acts.iter().any(|act| matches!(act, Act::Kill(..))));
    let acts = rig.pass(2 * SECOND, false);
    assert!(stops_before(&acts, |act| *act == Act::Kill(WHO, EndReason::Cpu)));
    assert!(!sent(&acts).contains(&FORWARD));
    assert!(acts.contains(&Act::Announce(Event::Safety {
        action: SafetyAction::Kill,
        reason: "a script showed no life for 2000 ms".into()
    })));
}

#[test]
fn a_host_that_was_briefly_silent_stops_and_resumes() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert_eq!(sent(&rig.pass(300 * MS, false)), [FORWARD, Command::STOP]);
    assert_eq!(sent(&rig.handle(Fact::Alive(WHO))), [FORWARD]);
    assert!(
        !rig.pass(SECOND, true)
            .iter()
            .any(|act| matches!(act, Act::Kill(..)))
    );
}

#[test]
fn the_setpoint_of_a_host_that_shows_life_is_repeated_at_5_hz() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.pass(10 * SECOND, true);
    assert!(sent(&acts).iter().all(|command| *command == FORWARD));
    assert_eq!(sent(&acts).len(), 50);
}

#[test]
fn a_behaviour_that_has_ended_stops_at_once() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert_eq!(sent(&rig.handle(Fact::Gone(WHO))), [Command::STOP]);
}

#[test]
fn no_duration_from_a_host_overflows_the_clock() {
    for time in [Duration::ZERO, Duration::MAX] {
        let mut rig = Rig::online(60);
        rig.drive(1, Some(time));
        let plan = DockPlan {
            timeout: time,
            retries: u32::MAX,
            charge_timeout: time,
        };
        rig.ask(Intent::Dock {
            call: CallId(1),
            plan,
        });
        rig.handle(Fact::Engine(EngineReport::Docked));
        rig.ask(Intent::Undock {
            call: CallId(2),
            timeout: time,
        });
        rig.pass(SECOND, true);
    }
}

#[test]
fn a_move_lasts_thirty_days_at_most() {
    let mut rig = Rig::online(60);
    rig.drive(1, Some(Duration::MAX));
    let end = rig.now + Duration::from_secs(2_592_000);
    assert_eq!(rig.dog.arbiter.next_deadline(), Some(end));
}

#[test]
fn endless_docking_requests_do_not_fill_the_memory() {
    let mut rig = Rig::online(60);
    for call in 0..64 {
        assert_eq!(dock_ended(&rig.dock(call)), None);
    }
    let acts = rig.dock(64);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Safety, 0)));
}

#[test]
fn a_timed_move_ends_with_a_stop_and_its_answer() {
    let mut rig = Rig::online(60);
    rig.drive(1, Some(SECOND));
    let acts = rig.pass(SECOND, true);
    assert_eq!(sent(&acts).last(), Some(&Command::STOP));
    assert_eq!(events(&acts), [ended(1, MotionEnd::Done)]);
}

#[test]
fn before_a_login_and_with_a_good_battery_the_last_words_are_a_stop() {
    let mut rig = Rig::with(Limits::default());
    assert_eq!(rig.dog.last_words(), LastWords::Stop);
    rig.handle(login(false, power(60)));
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
    let mut rig = Rig::docked(power(31));
    rig.undock(1);
    rig.handle(Fact::Power(power(30)));
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
fn after_a_stall_the_tracks_stop_and_move_again_when_the_host_shows_life() {
    for guardian_wrote in [false, true] {
        let mut rig = Rig::online(60);
        rig.drive(1, None);
        let acts = rig.stall(950 * MS, guardian_wrote);
        assert_eq!(sent(&acts), [Command::STOP]);
        assert_eq!(events(&acts), []);
        assert_eq!(sent(&rig.pass(200 * MS, false)), []);
        assert_eq!(sent(&rig.handle(Fact::Alive(WHO))), [FORWARD]);
    }
}

#[test]
fn a_host_that_is_silent_after_a_stall_is_ended_as_usual() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    rig.stall(950 * MS, false);
    let grace = Limits::default().host_grace.get();
    let acts = rig.pass(grace - MS, false);
    assert_eq!(acts, []);
    let acts = rig.pass(MS, false);
    assert!(acts.contains(&Act::Kill(WHO, EndReason::Cpu)), "{acts:?}");
}

#[test]
fn the_silence_of_a_stall_is_not_the_robots() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::Streaming(true));
    rig.drive(1, None);
    for _ in 0..10 {
        assert!(!reconnects(&rig.stall(SECOND, false)));
        let acts = rig.pass(250 * MS, true);
        assert!(!reconnects(&acts), "{acts:?}");
    }
    assert!(reconnects(&rig.pass(SECOND, true)));
}

#[test]
fn after_a_stall_only_what_the_guardian_has_ended_begins_again() {
    let mut rig = Rig::online(60);
    rig.dock(1);
    assert_eq!(rig.stall(SECOND, false), []);
    assert_eq!(sent(&rig.stall(SECOND, true)), [Command::STOP, FIND]);
    let mut rig = Rig::docked(charging(80));
    rig.undock(1);
    assert_eq!(rig.stall(SECOND, false), []);
    assert_eq!(rig.stall(SECOND, true), [Act::Send(LEAVE)]);
    let (mut rig, _) = lost(20, standing());
    rig.pass(2 * SECOND, false);
    assert_eq!(rig.stall(SECOND, false), []);
    assert_eq!(sent(&rig.stall(SECOND, true)), [Command::STOP, FIND]);
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
    let acts = rig.dock(7);
    assert_eq!(sent(&acts), []);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 0)));
    rig.handle(Fact::Engine(EngineReport::Docked));
    let acts = rig.undock(8);
    assert_eq!(sent(&acts), []);
    assert_eq!(undock_ended(&acts), Some(DockEnd::Cancelled));
}

#[test]
fn at_the_end_of_a_run_a_behaviours_docking_ends_and_the_watchdogs_goes_on() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    assert_eq!(sent(&rig.handle(Fact::RunEnding)), [CANCEL, Command::STOP]);
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.handle(Fact::RunEnding)), [Command::STOP, FIND]);
}

fn safety_actions(acts: &[Act]) -> Vec<SafetyAction> {
    let action = |act: &Act| match act {
        Act::Announce(Event::Safety { action, .. }) => Some(*action),
        _ => None,
    };
    acts.iter().filter_map(action).collect()
}

#[test]
fn without_a_guardian_nothing_drives_until_one_answers_again() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.handle(Fact::Guarded(false));
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(safety_actions(&acts), [SafetyAction::Hold]);
    assert_eq!(rig.handle(Fact::Guarded(false)), [], "it is known");
    let acts = rig.pass(Watchdog::LONGEST_HOLD, true);
    assert_eq!(sent(&acts), []);
    assert_eq!(events(&acts), [ended(1, MotionEnd::Safety)]);
    assert_eq!(rig.dog.refusal(), Some(MotionEnd::Safety));
    assert_eq!(events(&rig.drive(2, None)), [ended(2, MotionEnd::Safety)]);
    assert_eq!(dock_ended(&rig.dock(3)), Some((DockEnd::Safety, 0)));
    assert_eq!(sent(&rig.pass(SECOND, true)), []);
    let acts = rig.handle(Fact::Guarded(true));
    assert_eq!(safety_actions(&acts), [SafetyAction::Release]);
    assert_eq!(sent(&rig.drive(5, None)), [FORWARD]);
}

#[test]
fn setpoints_are_held_without_a_guardian_and_go_on_if_one_answers_soon() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    rig.handle(Fact::Guarded(false));
    let held = Watchdog::LONGEST_HOLD - SECOND;
    let acts = rig.pass(held, true);
    assert_eq!((sent(&acts), events(&acts)), (vec![], vec![]));
    assert_eq!(rig.dog.refusal(), None);
    let acts = rig.drive(2, None);
    assert_eq!(sent(&acts), [], "held, too");
    assert_eq!(events(&acts), [ended(1, MotionEnd::Preempted)]);
    assert_eq!(undock_ended(&rig.undock(3)), Some(DockEnd::NotDocked));
    assert_eq!(dock_ended(&rig.dock(4)), Some((DockEnd::Safety, 0)));
    assert_eq!(sent(&rig.pass(SECOND / 2, true)), []);
    assert_eq!(sent(&rig.handle(Fact::Guarded(true))), [FORWARD]);
    let acts = rig.pass(60 * SECOND, true);
    assert_eq!(events(&acts), [], "it goes on");
    assert_eq!(sent(&rig.handle(Fact::Guarded(false))), [Command::STOP]);
    let acts = rig.pass(60 * SECOND, true);
    assert_eq!(tracks(&acts), []);
    assert_eq!(events(&acts), [ended(2, MotionEnd::Safety)]);
}

#[test]
fn a_held_setpoint_ends_with_a_low_battery_a_stop_or_a_host_that_falls_silent() {
    for fact in [
        Fact::Power(power(20)),
        Fact::RunEnding,
        Fact::Gone(WHO),
        Fact::LinkDown,
    ] {
        let mut rig = Rig::online(60);
        rig.drive(1, None);
        rig.handle(Fact::Guarded(false));
        rig.handle(fact.clone());
        let acts = rig.handle(Fact::Guarded(true));
        assert!(!sent(&acts).contains(&FORWARD), "{fact:?}");
    }
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    rig.handle(Fact::Guarded(false));
    rig.pass(SECOND, false);
    assert_eq!(sent(&rig.handle(Fact::Guarded(true))), []);
}

#[test]
fn without_a_guardian_a_docking_of_a_behaviour_and_an_undocking_end() {
    let mut rig = Rig::online(60);
    rig.dock(1);
    let acts = rig.handle(Fact::Guarded(false));
    assert_eq!(dock_ended(&acts), Some((DockEnd::Safety, 1)));
    assert!(sent(&acts).contains(&CANCEL) && sent(&acts).ends_with(&[Command::STOP]));
    let mut rig = Rig::docked(charging(90));
    rig.undock(1);
    let acts = rig.handle(Fact::Guarded(false));
    assert_eq!(undock_ended(&acts), Some(DockEnd::Safety));
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(undock_ended(&rig.undock(2)), Some(DockEnd::Safety));
}

#[test]
fn without_a_guardian_a_low_robot_still_searches_but_makes_no_blind_move() {
    let mut rig = searching(20, Limits::default());
    assert_eq!(sent(&rig.handle(Fact::Guarded(false))), []);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    let acts = rig.pass(60 * SECOND, false);
    assert!(count(&acts, &FIND) > 0, "{acts:?}");
    assert!(tracks(&acts).iter().all(|setpoint| *setpoint == (0, 0)));
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    rig.handle(Fact::Guarded(false));
    let acts = [rig.report(power(20)), rig.report(power(20))].concat();
    assert_eq!(count(&acts, &FIND), 1, "{acts:?}");
}

#[test]
fn without_a_link_the_loss_of_a_guardian_sends_nothing_and_counts_for_the_next() {
    let mut rig = Rig::with(Limits::default());
    assert_eq!(sent(&rig.handle(Fact::Guarded(false))), []);
    rig.handle(login(false, power(60)));
    rig.now += SECOND;
    assert_eq!(sent(&rig.drive(1, None)), []);
}
