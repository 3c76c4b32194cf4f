//! Every rule by numbers: facts and times in, acts out.

use super::rig::*;
use super::*;
use crate::robot::{DockPlan, EndReason};
use crate::safety::Ask;
use crate::wire::{Engage, Led, Sound};

#[test]
fn a_low_report_stops_and_sends_home_in_one_batch() {
    let mut rig = Rig::online(60);
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
    assert!(rig.dog.moving());
    let acts = rig.take(Fact::Power(power(20)));
    assert!(!rig.dog.moving());
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    assert_eq!(told(&acts), [ended(1, MotionEnd::Safety)]);
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn a_low_report_at_rest_still_says_stop_before_base_find() {
    let mut rig = Rig::online(60);
    assert_eq!(
        sent(&rig.take(Fact::Power(power(10)))),
        [Command::STOP, FIND]
    );
}

#[test]
fn a_low_level_at_login_is_enough() {
    let mut rig = Rig::with(Limits::default());
    let acts = rig.take(Fact::LinkUp {
        docked: false,
        power: power(15),
    });
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn low_motion_is_refused_until_the_ok_level() {
    let mut rig = Rig::online(60);
    rig.take(Fact::Power(power(20)));
    let acts = rig.drive(1, Some(SECOND));
    assert_eq!(
        (sent(&acts), told(&acts)),
        (vec![], vec![ended(1, MotionEnd::Safety)])
    );
    rig.take(Fact::Power(power(49)));
    for _ in 0..2 {
        assert_eq!(sent(&rig.drive(2, None)), []);
        assert_eq!(sent(&rig.hear(power(50))), []);
    }
    assert_eq!(sent(&rig.hear(power(50))), [CANCEL, Command::STOP]);
    rig.now += SECOND;
    assert_eq!(sent(&rig.drive(3, None)), [FORWARD]);
}

#[test]
fn one_garbage_report_neither_frees_a_low_robot_nor_disturbs_its_search() {
    for garbage in [power(60), power(100), charging(60), charging(10)] {
        let mut rig = Rig::online(60);
        rig.hear(power(10));
        for _ in 0..5 {
            rig.hear(power(10));
            let acts = [rig.hear(garbage), rig.drive(1, None)].concat();
            assert_eq!(sent(&acts), [], "{garbage:?}");
            assert_eq!(told(&acts), [ended(1, MotionEnd::Safety)]);
        }
        assert_eq!(sent(&rig.hear(power(10))), []);
        assert_eq!(sent(&rig.pass(100 * SECOND, false)), [], "searches on");
    }
}

#[test]
fn while_one_report_says_charging_no_search_and_no_leg_begins() {
    let (mut rig, _) = lost(20, standing());
    rig.hear(charging(15));
    let acts = rig.pass(BatteryGuard::DOUBT - SECOND, false);
    assert_eq!((count(&acts, &FIND), tracks(&acts)), (0, vec![]));
    assert_eq!(
        count(&rig.pass(2 * SECOND, false), &FIND),
        1,
        "then it does"
    );

    let mut rig = Rig::online(20);
    rig.take(Fact::Engine(EngineNews::BaseNotFound));
    rig.hear(charging(20));
    assert_eq!(
        sent(&rig.pass(100 * SECOND, false)),
        [],
        "the next try waits"
    );
    assert_eq!(sent(&rig.hear(power(20))), [Command::STOP, FIND]);
}

#[test]
fn the_contact_bears_charging_out_before_and_after() {
    for contact_first in [true, false] {
        let mut rig = Rig::online(20);
        let mut facts = [Fact::Engine(EngineNews::Docked), Fact::Power(charging(20))];
        if !contact_first {
            facts.reverse();
        }
        let [first, second] = facts;
        rig.take(first);
        assert!(rig.dog.low().is_some());
        assert_eq!(sent(&rig.take(second)), []);
        assert_eq!(rig.dog.low(), None);
        assert!(rig.dog.docked() && rig.dog.battery().unwrap().charging);
    }
}

#[test]
fn a_docking_that_backs_off_stands_still_while_one_report_says_charging() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    rig.take(Fact::Engine(EngineNews::BaseNotFound));
    rig.pass(500 * MS, false);
    assert!(rig.dog.moving());
    let acts = rig.take(Fact::Power(charging(60)));
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(dock_ended(&acts), None);
    assert_eq!(
        dock_ended(&rig.hear(charging(60))),
        Some((DockEnd::Done, 1))
    );

    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    rig.take(Fact::Power(charging(60)));
    let acts = rig.take(Fact::Engine(EngineNews::BaseNotFound));
    assert_eq!(tracks(&acts), [(0, 0)], "it does not back off either");
}

#[test]
fn it_learns_how_long_the_battery_lasts() {
    let mut rig = Rig::online(60);
    assert_eq!(rig.dog.battery().unwrap().minutes_left, None);
    for percent in (50..60).rev() {
        rig.pass(60 * SECOND, false);
        rig.take(Fact::Power(power(percent)));
    }
    let left = rig.dog.battery().unwrap().minutes_left;
    assert!(
        left.is_some_and(|left| (45.0..55.0).contains(&left)),
        "{left:?}"
    );
}

#[test]
fn charging_releases_and_the_station_still_holds() {
    let mut rig = Rig::online(20);
    rig.take(Fact::Engine(EngineNews::Docked));
    rig.take(Fact::Power(charging(20)));
    assert_eq!(rig.dog.low(), None);
    assert_eq!(told(&rig.drive(1, None)), [ended(1, MotionEnd::Docked)]);
}

#[test]
fn base_not_found_is_tried_three_times_more_without_motion_then_alarm() {
    let mut rig = Rig::online(20);
    let mut acts = Vec::new();
    for _ in 0..3 {
        acts.extend(rig.take(Fact::Engine(EngineNews::BaseNotFound)));
        acts.extend(rig.pass(30 * SECOND, false));
    }
    assert_eq!((count(&acts, &FIND), tracks(&acts)), (3, vec![(0, 0)]));
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
    let alarm = [
        Command::STOP,
        Command::Play(Sound::Alarm),
        Command::Led {
            led: Led::Flash,
            on: true,
        },
    ];
    let (_, acts) = lost(20, standing());
    assert_eq!(sent(&acts), alarm);
    let failed = "docking failed (base_not_found) 4 times: tries again in 60 s";
    assert_eq!(reasons(&acts), [failed]);
}

#[test]
fn the_alarm_is_repeated_and_without_legs_nothing_moves() {
    let (mut rig, _) = lost(20, standing());
    assert_eq!(sent(&rig.take(Fact::Heard)), [], "not at every occasion");
    let acts = rig.pass(59 * SECOND, false);
    let alarms = count(&acts, &Command::Play(Sound::Alarm));
    assert!((3..=5).contains(&alarms), "{alarms}");
    assert_eq!((count(&acts, &FIND), tracks(&acts)), (0, vec![]));
    assert_eq!(told(&rig.drive(9, None)), [ended(9, MotionEnd::Safety)]);
    rig.hear(charging(21));
    assert_eq!(rig.dog.state(), WatchdogState::Alarm, "one report");
    rig.hear(charging(21));
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
}

#[test]
fn after_the_alarm_it_searches_for_ever_after_pauses_that_grow_up_to_a_bound() {
    let (mut rig, _) = lost(20, standing());
    for pause in [60, 120, 240, 300, 300, 300] {
        assert_eq!(count(&rig.pass((pause - 1) * SECOND, false), &FIND), 0);
        let acts = rig.pass(SECOND, false);
        assert_eq!(count(&acts, &FIND), 1, "{pause} s");
        assert_eq!(tracks(&acts), [(0, 0)], "a stop first");
        rig.take(Fact::Power(power(5)));
        let acts = rig.take(Fact::Engine(EngineNews::BaseNotFound));
        assert_eq!(tracks(&acts), [(0, 0)]);
    }
    assert_eq!(rig.dog.state(), WatchdogState::Alarm);
}

#[test]
fn the_next_search_and_the_end_of_a_leg_are_deadlines_of_their_own() {
    let quiet = |limits| Limits {
        alarm_every: crate::robot::Seconds::from_secs(1000),
        ..limits
    };
    let (mut rig, _) = lost(20, quiet(standing()));
    let due = rig.now + 60 * SECOND;
    rig.pass(2 * SECOND, false);
    assert_eq!(rig.dog.next_deadline(), Some(due));
    let (mut rig, _) = lost(20, quiet(Limits::default()));
    let due = rig.now + 2 * SECOND;
    rig.pass(1900 * MS, false);
    assert_eq!(rig.dog.next_deadline(), Some(due));
}

#[test]
fn a_search_under_alarm_that_takes_too_long_is_cancelled_and_no_leg_follows() {
    let (mut rig, _) = lost(20, Limits::default());
    rig.pass(2 * SECOND, false);
    let acts = rig.pass(180 * SECOND, false);
    assert_eq!(count(&acts, &CANCEL), 1);
    assert_eq!(tracks(&acts), [(0, 0)]);
    let failed = "docking failed (timeout) 1 times: tries again in 60 s";
    assert_eq!(reasons(&acts), [failed]);
}

#[test]
fn where_it_finds_no_station_it_drives_a_short_leg_and_searches_from_there() {
    let (mut rig, acts) = lost(20, Limits::default());
    assert_eq!(
        reasons(&acts),
        [
            "docking failed (base_not_found) 4 times: tries again from elsewhere",
            "drives a short leg, 1 of 12, and searches from there"
        ]
    );
    let acts = [acts, rig.pass(1999 * MS, false)].concat();
    assert_eq!(tracks(&acts), [(0, 0), (27, 27)]);
    assert!(count(&acts, &LEG) >= 10, "said 5 times a second");
    assert_eq!(sent(&rig.pass(MS, false)), [Command::STOP, FIND]);
    assert_eq!(tracks(&rig.pass(100 * SECOND, false)), [], "it searches");
    let acts = rig.take(Fact::Engine(EngineNews::BaseNotFound));
    let second = "drives a short leg, 2 of 12, and searches from there";
    assert_eq!(reasons(&acts).last().unwrap(), second);
    let acts = rig.pass(2950 * MS, false);
    assert_eq!(tracks(&acts), [(-27, 27), (27, 27), (0, 0)]);
    assert_eq!(count(&acts, &FIND), 1);
    rig.take(Fact::Engine(EngineNews::Docked));
    rig.take(Fact::Power(charging(19)));
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
    assert_eq!(sent(&rig.pass(1000 * SECOND, false)), []);
}

#[test]
fn all_legs_together_are_as_many_as_the_config_allows() {
    let limits = Limits {
        recovery_legs: 2,
        ..Limits::default()
    };
    let (mut rig, _) = lost(20, limits);
    for pause in [3, 3, 60, 120, 240] {
        assert_eq!(count(&rig.pass(pause * SECOND, false), &FIND), 1);
        rig.take(Fact::Engine(EngineNews::BaseNotFound));
    }
    assert_eq!(tracks(&rig.pass(10 * SECOND, false)), []);
}

#[test]
fn whatever_releases_takes_over_or_cuts_off_the_robot_ends_a_leg() {
    let stop = || vec![Command::STOP];
    let ends = [
        (Fact::Power(charging(19)), stop()),
        (Fact::Power(power(8)), [stop(), vec![FIND]].concat()),
        (Fact::Engine(EngineNews::Docked), stop()),
        (Fact::Parting, [stop(), vec![FIND]].concat()),
        (Fact::LinkDown, vec![]),
    ];
    for (end, expected) in ends {
        let (mut rig, _) = lost(20, Limits::default());
        rig.pass(500 * MS, false);
        assert!(rig.dog.moving());
        assert_eq!(sent(&rig.take(end.clone())), expected, "{end:?}");
        assert!(!rig.dog.moving(), "{end:?}");
        let later = rig.pass(100 * SECOND, false);
        assert!(tracks(&later).iter().all(|one| *one == (0, 0)), "{end:?}");
    }
}

#[test]
fn at_the_critical_level_or_without_a_fresh_level_it_searches_but_drives_no_leg() {
    let (mut rig, acts) = lost(8, Limits::default());
    assert_eq!(tracks(&acts), [(0, 0)]);
    let acts = rig.pass(60 * SECOND, false);
    assert_eq!((count(&acts, &FIND), tracks(&acts)), (1, vec![(0, 0)]));

    let (mut rig, acts) = lost(
        20,
        Limits {
            power_silence: crate::robot::Seconds::from_secs(80),
            ..Limits::default()
        },
    );
    assert_eq!(tracks(&acts), [(0, 0)], "90 s after the last level");
    rig.take(Fact::Power(power(19)));
    assert_eq!(tracks(&rig.pass(61 * SECOND, false)), [(27, 27)]);
}

#[test]
fn after_a_reconnect_under_alarm_it_searches_before_it_drives_a_leg() {
    let (mut rig, _) = lost(20, Limits::default());
    rig.pass(SECOND, false);
    rig.take(Fact::LinkDown);
    rig.now += 10 * SECOND;
    let acts = rig.take(Fact::LinkUp {
        docked: false,
        power: power(19),
    });
    assert_eq!(
        sent(&acts).into_iter().filter(|c| *c == FIND).count(),
        1,
        "{acts:?}"
    );
    assert_eq!(tracks(&acts), [(0, 0)]);
    assert_eq!(tracks(&rig.pass(100 * SECOND, false)), []);
    rig.take(Fact::Engine(EngineNews::BaseNotFound));
    assert!(rig.dog.moving() || tracks(&rig.pass(SECOND, false)).contains(&(27, 27)));
}

#[test]
fn a_leg_over_a_silent_stream_stops_and_nothing_is_said_behind_it() {
    let limits = Limits {
        stream_silence: crate::robot::Seconds::from_secs(1),
        ..Limits::default()
    };
    let (mut rig, _) = lost(20, limits);
    rig.take(Fact::Listening(true));
    let acts = rig.pass(1500 * MS, false);
    assert!(reconnects(&acts));
    assert_eq!(tracks(&acts).last(), Some(&(0, 0)));
    assert_eq!(count(&acts, &FIND), 0);
}

#[test]
fn an_alarm_that_ends_leaves_no_light_on() {
    let (mut rig, _) = lost(20, standing());
    let off = Command::Led {
        led: Led::Flash,
        on: false,
    };
    assert_eq!(sent(&rig.take(Fact::Power(charging(21)))), []);
    assert_eq!(sent(&rig.hear(charging(21))), [off]);
}

#[test]
fn a_search_without_end_is_cancelled_after_180_seconds() {
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.pass(178 * SECOND, false)), []);
    assert_eq!(sent(&rig.pass(2 * SECOND, false)), [CANCEL, Command::STOP]);
    assert_eq!(sent(&rig.pass(6 * SECOND, false)), [Command::STOP, FIND]);
}

#[test]
fn the_state_says_at_a_glance_how_things_stand() {
    use WatchdogState::{Alarm, Docked, Docking, Free, LowGoingHome, Offline};
    let mut rig = Rig::with(Limits::default());
    assert_eq!(rig.dog.state(), Offline);
    rig.take(Fact::LinkUp {
        docked: false,
        power: power(60),
    });
    assert_eq!(rig.dog.state(), Free);
    rig.ask(Ask::Dock(CallId(1), DockPlan::default()));
    assert_eq!(rig.dog.state(), Docking);
    rig.take(Fact::Power(power(10)));
    assert_eq!(rig.dog.state(), LowGoingHome);
    rig.take(Fact::Engine(EngineNews::Docked));
    assert_eq!(rig.dog.state(), Docked);
    rig.pass(40 * SECOND, false);
    assert_eq!(rig.dog.state(), Alarm);
    rig.take(Fact::LinkDown);
    assert_eq!(rig.dog.state(), Offline);
    let words =
        [Offline, Free, Docked, Docking, LowGoingHome, Alarm].map(|state| state.to_string());
    assert_eq!(
        words,
        [
            "offline",
            "free",
            "docked",
            "docking",
            "battery low, going home",
            "battery low, ALARM"
        ]
    );
}

#[test]
fn critical_refuses_motion_and_undocking_even_while_charging() {
    let mut rig = Rig::with(Limits::default());
    rig.take(Fact::LinkUp {
        docked: true,
        power: charging(8),
    });
    assert_eq!(told(&rig.drive(1, None)), [ended(1, MotionEnd::Safety)]);
    let acts = rig.ask(Ask::Undock(CallId(1), SECOND));
    assert_eq!(sent(&acts), []);
    assert_eq!(
        told(&acts),
        [Event::UndockEnded {
            call: CallId(1),
            end: DockEnd::Safety
        }]
    );
}

#[test]
fn a_silent_host_is_stopped_first_and_then_ended() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert!(!sent(&rig.pass(240 * MS, false)).contains(&Command::STOP));
    let acts = rig.pass(20 * MS, false);
    assert_eq!(sent(&acts), [Command::STOP]);
    assert!(!acts.iter().any(|act| matches!(act, Act::Kill(..))));
    let acts = rig.pass(300 * MS, false);
    let stop = acts
        .iter()
        .position(|act| *act == Act::Send(Command::STOP))
        .unwrap();
    let kill = acts
        .iter()
        .position(|act| *act == Act::Kill(WHO, EndReason::Cpu))
        .unwrap();
    assert!(stop < kill, "{acts:?}");
    assert!(!sent(&acts).contains(&FORWARD));
    assert!(acts.contains(&Act::Announce(Event::Safety {
        action: SafetyAction::Kill,
        reason: "a script showed no life for 500 ms".into()
    })));
}

#[test]
fn a_host_that_was_silent_for_a_moment_stops_and_drives_on() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert_eq!(sent(&rig.pass(300 * MS, false)), [FORWARD, Command::STOP]);
    assert_eq!(sent(&rig.take(Fact::Alive(WHO))), [FORWARD]);
    assert!(
        !rig.pass(SECOND, true)
            .iter()
            .any(|act| matches!(act, Act::Kill(..)))
    );
}

#[test]
fn a_host_that_shows_life_drives_on_and_its_setpoint_is_repeated_at_5_hz() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.pass(10 * SECOND, true);
    assert!(sent(&acts).iter().all(|command| *command == FORWARD));
    assert_eq!(sent(&acts).len(), 50);
}

#[test]
fn a_behaviour_that_is_gone_moves_nothing_in_the_same_instant() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert_eq!(sent(&rig.take(Fact::Gone(WHO))), [Command::STOP]);
}

#[test]
fn at_the_end_of_a_run_everything_stops_and_nothing_moves_any_more() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.take(Fact::Parting);
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(told(&acts), [ended(1, MotionEnd::Cancelled)]);
    assert_eq!(told(&rig.drive(2, None)), [ended(2, MotionEnd::Cancelled)]);
}

#[test]
fn at_the_end_of_a_run_nobody_docks_or_undocks_any_more() {
    let mut rig = Rig::online(60);
    rig.take(Fact::Parting);
    let acts = rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    assert_eq!(sent(&acts), []);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 0)));
    rig.take(Fact::Engine(EngineNews::Docked));
    let acts = rig.ask(Ask::Undock(CallId(8), SECOND));
    assert_eq!(sent(&acts), []);
    let end = DockEnd::Cancelled;
    assert_eq!(
        told(&acts),
        [Event::UndockEnded {
            call: CallId(8),
            end
        }]
    );
}

#[test]
fn no_time_that_a_host_may_send_breaks_the_clock() {
    for time in [Duration::ZERO, Duration::MAX] {
        let mut rig = Rig::online(60);
        rig.drive(1, Some(time));
        let plan = DockPlan {
            timeout: time,
            retries: u32::MAX,
            charge_timeout: time,
        };
        rig.ask(Ask::Dock(CallId(1), plan));
        rig.take(Fact::Engine(EngineNews::Docked));
        rig.ask(Ask::Undock(CallId(2), time));
        rig.pass(SECOND, true);
    }
}

#[test]
fn the_longest_move_takes_thirty_days() {
    let mut rig = Rig::online(60);
    rig.drive(1, Some(Duration::MAX));
    let end = rig.now + Duration::from_secs(2_592_000);
    assert_eq!(rig.dog.arbiter.next_deadline(), Some(end));
}

#[test]
fn a_robot_that_is_low_stays_on_its_station_though_it_charges() {
    let mut rig = Rig::with(Limits::default());
    rig.take(Fact::LinkUp {
        docked: true,
        power: charging(20),
    });
    let acts = rig.ask(Ask::Undock(CallId(1), SECOND));
    assert_eq!(sent(&acts), []);
    let end = DockEnd::Safety;
    let call = CallId(1);
    assert_eq!(told(&acts), [Event::UndockEnded { call, end }]);
}

#[test]
fn a_host_that_docks_without_end_fills_no_memory() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(0), DockPlan::default()));
    for call in 1..64 {
        assert_eq!(rig.ask(Ask::Dock(CallId(call), DockPlan::default())), []);
    }
    let acts = rig.ask(Ask::Dock(CallId(64), DockPlan::default()));
    assert_eq!(dock_ended(&acts), Some((DockEnd::Safety, 0)));
}

#[test]
fn at_the_end_of_a_run_a_behaviours_docking_ends_and_the_watchdogs_goes_on() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    assert_eq!(sent(&rig.take(Fact::Parting)), [CANCEL, Command::STOP]);
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.take(Fact::Parting)), [Command::STOP, FIND]);
}

#[test]
fn a_timed_move_ends_with_a_stop_and_its_answer() {
    let mut rig = Rig::online(60);
    rig.drive(1, Some(SECOND));
    let acts = rig.pass(SECOND, true);
    assert_eq!(sent(&acts).last(), Some(&Command::STOP));
    assert_eq!(told(&acts), [ended(1, MotionEnd::Done)]);
}

#[test]
fn a_silent_stream_while_moving_stops_and_reconnects() {
    let mut rig = Rig::online(60);
    rig.take(Fact::Listening(true));
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
    assert_eq!(told(&acts), [ended(1, MotionEnd::Disconnected)]);
}

#[test]
fn a_stream_that_begins_late_has_its_time_and_no_more() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    rig.pass(10 * SECOND, true);
    rig.take(Fact::Listening(true));
    assert!(!reconnects(&rig.pass(2900 * MS, true)));
    rig.take(Fact::Listening(true));
    assert!(
        reconnects(&rig.pass(200 * MS, true)),
        "said twice, heard never"
    );
}

#[test]
fn a_robot_that_is_heard_drives_on() {
    let mut rig = Rig::online(60);
    rig.take(Fact::Listening(true));
    rig.drive(1, None);
    for _ in 0..10 {
        let acts = rig.pass(SECOND, true);
        assert!(!reconnects(&acts) && !sent(&acts).contains(&Command::STOP));
        rig.take(Fact::Heard);
    }
}

#[test]
fn a_good_level_disturbs_no_motion() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert_eq!(rig.take(Fact::Power(power(59))), []);
    assert!(rig.dog.moving());
}

#[test]
fn that_the_level_is_critical_is_said_once() {
    let mut rig = Rig::online(60);
    let said = |acts: Vec<Act>| {
        let mut reasons = acts.into_iter().filter_map(|act| match act {
            Act::Announce(Event::Safety { reason, .. }) => Some(reason),
            _ => None,
        });
        reasons.any(|reason| reason.contains("nothing moves but the docking"))
    };
    assert!(!said(rig.take(Fact::Power(power(9)))));
    assert!(said(rig.take(Fact::Power(power(8)))));
    assert!(!said(rig.take(Fact::Power(power(7)))));
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
fn ten_minutes_without_a_level_off_the_station_count_as_low() {
    let mut rig = Rig::online(80);
    assert_eq!(sent(&rig.pass(598 * SECOND, false)), []);
    assert_eq!(sent(&rig.pass(2 * SECOND, false)), [Command::STOP, FIND]);
}

#[test]
fn on_the_station_a_level_may_stay_away() {
    let mut rig = Rig::with(Limits::default());
    rig.take(Fact::LinkUp {
        docked: true,
        power: charging(80),
    });
    assert_eq!(sent(&rig.pass(4000 * SECOND, false)), []);
}

#[test]
fn without_a_link_nothing_is_sent() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.take(Fact::LinkDown);
    assert_eq!(
        (sent(&acts), told(&acts)),
        (vec![], vec![ended(1, MotionEnd::Disconnected)])
    );
    assert_eq!(
        told(&rig.drive(2, None)),
        [ended(2, MotionEnd::Disconnected)]
    );
    assert_eq!(rig.dog.next_deadline(), None);
}

#[test]
fn after_a_reconnect_a_low_robot_is_sent_home_again() {
    let mut rig = Rig::online(20);
    rig.take(Fact::LinkDown);
    let acts = rig.take(Fact::LinkUp {
        docked: false,
        power: power(19),
    });
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn a_behaviour_docks_and_docked_means_charging() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    assert_eq!(rig.take(Fact::Engine(EngineNews::Docked)), []);
    assert_eq!(
        dock_ended(&rig.take(Fact::Power(charging(60)))),
        Some((DockEnd::Done, 1))
    );
    let again = rig.ask(Ask::Dock(CallId(8), DockPlan::default()));
    assert_eq!(
        (sent(&again), dock_ended(&again)),
        (vec![], Some((DockEnd::AlreadyDocked, 0)))
    );
}

#[test]
fn between_a_behaviours_tries_the_robot_backs_off() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(
        CallId(7),
        DockPlan {
            retries: 1,
            ..DockPlan::default()
        },
    ));
    let back = Command::Move {
        left: -27,
        right: -27,
    };
    let acts = rig.take(Fact::Engine(EngineNews::BaseNotFound));
    assert_eq!(sent(&acts)[0], Command::STOP);
    let acts = [acts, rig.pass(2 * SECOND, false)].concat();
    assert!(sent(&acts).contains(&back));
    assert_eq!(sent(&acts)[sent(&acts).len() - 2..], [Command::STOP, FIND]);
    let over = rig.take(Fact::Engine(EngineNews::BaseNotFound));
    assert_eq!(dock_ended(&over), Some((DockEnd::BaseNotFound, 2)));
}

#[test]
fn low_battery_takes_a_docking_over_and_its_caller_is_served() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    assert_eq!(
        sent(&rig.take(Fact::Power(power(20)))),
        [Command::STOP, FIND]
    );
    rig.take(Fact::Engine(EngineNews::Docked));
    assert_eq!(
        dock_ended(&rig.take(Fact::Power(charging(20)))),
        Some((DockEnd::Done, 1))
    );
}

#[test]
fn a_docking_that_was_taken_over_is_given_back_at_the_ok_level() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    rig.take(Fact::Power(power(20)));
    for _ in 0..3 {
        assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
        assert_eq!(sent(&rig.hear(power(50))), []);
    }
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    assert_eq!(sent(&rig.ask(Ask::CancelDock)), [CANCEL, Command::STOP]);
}

#[test]
fn no_behaviour_can_end_the_watchdogs_own_docking() {
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.ask(Ask::CancelDock)), []);
    assert_eq!(sent(&rig.ask(Ask::Stop)), []);
    assert_eq!(sent(&rig.take(Fact::Gone(WHO))), []);
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn cancelling_a_docking_answers_its_caller() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    let acts = rig.ask(Ask::CancelDock);
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 1)));
}

#[test]
fn undocking_waits_for_the_robots_word() {
    let mut rig = Rig::with(Limits::default());
    rig.take(Fact::LinkUp {
        docked: true,
        power: charging(80),
    });
    rig.now += SECOND;
    let acts = rig.ask(Ask::Undock(CallId(1), 20 * SECOND));
    assert_eq!(sent(&acts), [Command::Engine(Engage::Undock)]);
    let acts = rig.take(Fact::Engine(EngineNews::Undocked));
    assert_eq!(
        told(&acts),
        [Event::UndockEnded {
            call: CallId(1),
            end: DockEnd::Done
        }]
    );
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
}

#[test]
fn only_the_end_of_the_one_who_asked_ends_a_docking() {
    let mut rig = Rig::online(60);
    rig.ask(Ask::Dock(CallId(7), DockPlan::default()));
    assert_eq!(rig.take(Fact::Gone(BehaviourId(1))), []);
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    assert_eq!(sent(&rig.take(Fact::Gone(WHO))), [CANCEL, Command::STOP]);
    assert_eq!(rig.dog.state(), WatchdogState::Free);
}

#[test]
fn only_the_one_who_asked_is_told_how_an_undocking_ends() {
    for (gone, told_at_the_end) in [(BehaviourId(1), 1), (WHO, 0)] {
        let mut rig = Rig::with(Limits::default());
        rig.take(Fact::LinkUp {
            docked: true,
            power: charging(80),
        });
        rig.ask(Ask::Undock(CallId(1), 20 * SECOND));
        rig.take(Fact::Gone(gone));
        let acts = rig.take(Fact::Engine(EngineNews::Undocked));
        assert_eq!(told(&acts).len(), told_at_the_end);
    }
}
