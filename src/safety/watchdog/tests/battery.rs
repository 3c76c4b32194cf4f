//! Levels and charging: the effect of one report and of several; what each dock state allows; and
//! how a robot with a low battery reacts.

use super::*;
use crate::wire::{Led, Sound};

#[test]
fn a_low_report_stops_and_sends_home_in_one_batch() {
    let mut rig = Rig::online(60);
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
    assert!(rig.dog.moving());
    let acts = rig.handle(Fact::Power(power(30)));
    assert!(!rig.dog.moving());
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    assert_eq!(events(&acts), [ended(1, MotionEnd::Safety)]);
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn while_a_persons_stop_holds_a_low_robot_stays_where_it_is_and_the_reasons_say_so() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::StoppedByPerson(true));
    let acts = [rig.report(power(20)), rig.pass(1000 * SECOND, false)].concat();
    assert_eq!(count(&acts, &FIND), 0);
    assert!(matches!(&reasons(&acts)[..], [one] if one.ends_with(STOP_HOLDS)));
    assert!(!rig.dog.wants_rescue());
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
    let released = |rig: &mut Rig| {
        rig.dog.apply(Fact::StoppedByPerson(false), rig.now);
        let acts = rig.handle(Fact::Suspended);
        assert!(reasons(&acts)[0].ends_with("goes home, STOP is released"));
        assert_eq!(sent(&acts).last(), Some(&FIND));
    };
    released(&mut rig);
    assert_eq!(rig.dog.take_dock_report(), None, "no link broke");
    // Pressed on the way home.
    rig.now += 10 * SECOND;
    let acts = rig.handle(Fact::StoppedByPerson(true));
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
    let report = rig.dog.take_dock_report().unwrap();
    assert_eq!(report.outcome.end, DockEnd::Cancelled);
    assert_eq!(count(&rig.pass(1000 * SECOND, false), &FIND), 0);
    released(&mut rig);
}

#[test]
fn while_a_persons_stop_holds_motions_end_and_are_refused_at_once() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.handle(Fact::StoppedByPerson(true));
    assert_eq!(events(&acts), [ended(1, MotionEnd::Safety)]);
    let acts = rig.drive(2, Some(SECOND));
    assert_eq!(events(&acts), [ended(2, MotionEnd::Safety)]);
    rig.handle(Fact::StoppedByPerson(false));
    rig.now += SECOND;
    assert_eq!(sent(&rig.drive(3, None)), [FORWARD]);
}

#[test]
fn while_a_persons_stop_holds_docking_and_undocking_are_refused_at_once() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::StoppedByPerson(true));
    let acts = rig.dock(1);
    let refused = Some((DockEnd::Safety, 0));
    assert_eq!((sent(&acts), dock_ended(&acts)), (vec![], refused));
    let acts = [rig.report(power(0)), rig.pass(1000 * SECOND, false)].concat();
    assert_eq!(sent(&acts), []);
    let mut rig = Rig::docked(charging(90));
    rig.handle(Fact::StoppedByPerson(true));
    let acts = rig.undock(1);
    let refused = Some(DockEnd::Safety);
    assert_eq!((sent(&acts), undock_ended(&acts)), (vec![], refused));
}

#[test]
fn a_low_level_at_rest_or_at_login_is_enough() {
    let acts = Rig::online(60).handle(Fact::Power(power(10)));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    let mut rig = Rig::with(Limits::default());
    let acts = rig.handle(login(false, power(15)));
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
}

#[test]
fn low_motion_is_refused_until_the_ok_level() {
    let mut rig = Rig::online(60);
    rig.handle(Fact::Power(power(20)));
    let acts = rig.drive(1, Some(SECOND));
    assert_eq!(
        (sent(&acts), events(&acts)),
        (vec![], vec![ended(1, MotionEnd::Safety)])
    );
    rig.handle(Fact::Power(power(49)));
    for _ in 0..2 {
        assert_eq!(sent(&rig.drive(2, None)), []);
        assert_eq!(sent(&rig.report(power(50))), []);
    }
    assert_eq!(sent(&rig.report(power(50))), [CANCEL, Command::STOP]);
    rig.now += SECOND;
    assert_eq!(sent(&rig.drive(3, None)), [FORWARD]);
}

#[test]
fn one_garbage_report_neither_frees_a_low_robot_nor_disturbs_its_search() {
    for garbage in [power(60), power(100), charging(60), charging(10)] {
        let mut rig = Rig::online(60);
        rig.report(power(10));
        for _ in 0..5 {
            rig.report(power(10));
            let acts = [rig.report(garbage), rig.drive(1, None)].concat();
            assert_eq!(sent(&acts), [], "{garbage:?}");
            assert_eq!(events(&acts), [ended(1, MotionEnd::Safety)]);
        }
        assert_eq!(sent(&rig.report(power(10))), []);
        assert_eq!(sent(&rig.pass(100 * SECOND, false)), [], "searches on");
    }
}

#[test]
fn an_unconfirmed_report_of_charging_delays_searches_and_legs() {
    let (mut rig, _) = lost(20, standing());
    rig.report(charging(15));
    let acts = rig.pass(BatteryMonitor::UNCONFIRMED_TIMEOUT - SECOND, false);
    assert_eq!((count(&acts, &FIND), tracks(&acts)), (0, vec![]));
    assert_eq!(
        count(&rig.pass(2 * SECOND, false), &FIND),
        1,
        "then it does"
    );

    let mut rig = Rig::online(20);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    rig.report(charging(20));
    assert_eq!(
        sent(&rig.pass(100 * SECOND, false)),
        [],
        "the next try waits"
    );
    assert_eq!(sent(&rig.report(power(20))), [Command::STOP, FIND]);
}

#[test]
fn contact_confirms_charging_before_and_after_the_report() {
    for contact_first in [true, false] {
        let mut rig = Rig::online(20);
        let mut facts = [
            Fact::Engine(EngineReport::Docked),
            Fact::Power(charging(20)),
        ];
        if !contact_first {
            facts.reverse();
        }
        let [first, second] = facts;
        rig.handle(first);
        assert!(rig.dog.low().is_some());
        assert_eq!(sent(&rig.handle(second)), []);
        assert_eq!(rig.dog.low(), None);
        assert!(rig.dog.docked() && rig.dog.battery().unwrap().charging);
    }
}

#[test]
fn an_unconfirmed_report_of_charging_halts_a_docking_that_backs_off() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    rig.pass(500 * MS, false);
    assert!(rig.dog.moving());
    let acts = rig.handle(Fact::Power(charging(60)));
    assert_eq!(sent(&acts), [Command::STOP]);
    assert_eq!(dock_ended(&acts), None);
    assert_eq!(
        dock_ended(&rig.report(charging(60))),
        Some((DockEnd::Done, 1))
    );

    let mut rig = Rig::online(60);
    rig.dock(7);
    rig.handle(Fact::Power(charging(60)));
    let acts = rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert_eq!(tracks(&acts), [(0, 0)], "it does not back off either");
}

#[test]
fn charging_releases_but_motion_on_the_station_is_refused() {
    let mut rig = Rig::online(20);
    rig.handle(Fact::Engine(EngineReport::Docked));
    rig.handle(Fact::Power(charging(20)));
    assert_eq!(rig.dog.low(), None);
    assert_eq!(events(&rig.drive(1, None)), [ended(1, MotionEnd::Docked)]);
}

#[test]
fn the_end_of_an_alarm_switches_its_light_off() {
    let (mut rig, _) = lost(20, standing());
    let off = Command::Led {
        led: Led::Flash,
        on: false,
    };
    assert_eq!(sent(&rig.handle(Fact::Power(charging(21)))), []);
    assert_eq!(sent(&rig.report(charging(21))), [off]);
}

#[test]
fn a_search_without_end_is_cancelled_after_180_seconds() {
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.pass(178 * SECOND, false)), []);
    assert_eq!(sent(&rig.pass(2 * SECOND, false)), [CANCEL, Command::STOP]);
    assert_eq!(sent(&rig.pass(21 * SECOND, false)), [Command::STOP, FIND]);
}

#[test]
fn critical_refuses_motion_even_while_charging() {
    let mut rig = Rig::docked(charging(8));
    assert_eq!(events(&rig.drive(1, None)), [ended(1, MotionEnd::Safety)]);
}

#[test]
fn a_critical_or_low_robot_and_one_held_by_hysteresis_stays_on_its_station_though_it_charges() {
    let mut held = Rig::online(20);
    held.handle(Fact::Engine(EngineReport::Docked));
    held.handle(Fact::Power(power(40)));
    for mut rig in [Rig::docked(charging(8)), Rig::docked(charging(20)), held] {
        let acts = rig.undock(1);
        let expected = (vec![], Some(DockEnd::Safety));
        assert_eq!((sent(&acts), undock_ended(&acts)), expected);
    }
}

#[test]
fn a_good_level_does_not_interrupt_motion() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    assert_eq!(rig.handle(Fact::Power(power(59))), []);
    assert!(rig.dog.moving());
}

#[test]
fn a_critical_level_is_announced_once() {
    let mut rig = Rig::online(60);
    let announced = |acts: Vec<Act>| {
        let text = "motion is refused except on the way home";
        reasons(&acts).iter().any(|reason| reason.contains(text))
    };
    assert!(!announced(rig.handle(Fact::Power(power(9)))));
    assert!(announced(rig.handle(Fact::Power(power(8)))));
    assert!(!announced(rig.handle(Fact::Power(power(7)))));
}

#[test]
fn ten_minutes_without_a_level_off_the_station_count_as_low() {
    let mut rig = Rig::online(80);
    assert_eq!(sent(&rig.pass(598 * SECOND, false)), []);
    assert_eq!(sent(&rig.pass(2 * SECOND, false)), [Command::STOP, FIND]);
}

#[test]
fn on_the_station_missing_levels_do_not_count_as_low() {
    let mut rig = Rig::docked(charging(80));
    assert_eq!(sent(&rig.pass(4000 * SECOND, false)), []);
}

#[test]
fn each_situation_has_its_state() {
    use WatchdogState::{Alarm, Docked, Docking, Free, LowGoingHome, Offline};
    let mut rig = Rig::with(Limits::default());
    assert_eq!(rig.dog.state(), Offline);
    rig.handle(login(false, power(60)));
    assert_eq!(rig.dog.state(), Free);
    rig.dock(1);
    assert_eq!(rig.dog.state(), Docking);
    rig.handle(Fact::Power(power(10)));
    assert_eq!(rig.dog.state(), LowGoingHome);
    rig.handle(Fact::Engine(EngineReport::Docked));
    assert_eq!(rig.dog.state(), Docked);
    rig.pass(40 * SECOND, false);
    assert_eq!(rig.dog.state(), Alarm);
    rig.handle(Fact::LinkDown);
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
fn sudden_charging_means_docked_and_ends_motion() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts: Vec<Act> = (0..3).flat_map(|_| rig.report(charging(60))).collect();
    assert_eq!(events(&acts)[..1], [ended(1, MotionEnd::Docked)]);
    assert!(sent(&acts).contains(&Command::STOP));
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
}

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
    let mut rig = with_unconfirmed_undocking(31);
    assert_eq!(sent(&rig.handle(Fact::Power(power(30)))), []);
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
    assert_eq!(rig.dog.dock_state(), DockState::Left);
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
    assert_eq!(rig.dog.dock_state(), DockState::Left);
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
        acts.extend(rig.handle(login(true, power(10))));
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

/// Numbers that are no level.
const BEYOND: [Power; 3] = [
    Power {
        percent: 110,
        charging: true,
    },
    Power {
        percent: 128,
        charging: true,
    },
    Power {
        percent: 110,
        charging: false,
    },
];

#[test]
fn on_its_station_a_robot_that_tells_no_level_is_held_there_until_it_has_charged_for_an_hour() {
    for beyond in BEYOND {
        let mut rig = Rig::docked(beyond);
        rig.report(beyond);
        let battery = rig.dog.battery().unwrap();
        assert!(rig.dog.docked() && battery.charging && rig.dog.low().is_none());
        assert_eq!(battery.percent, None);
        assert_eq!(undock_ended(&rig.undock(1)), Some(DockEnd::Safety));
        for _ in 0..62 {
            rig.pass(59 * SECOND, true);
            assert_eq!(sent(&rig.report(beyond)), [], "nothing moves it");
        }
        let acts = rig.undock(2);
        assert_eq!((undock_ended(&acts), sent(&acts)), (None, vec![LEAVE]));
        let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
        assert_eq!(undock_ended(&acts), Some(DockEnd::Done));
        assert_eq!(sent(&rig.drive(3, None)), [FORWARD]);
    }
}

#[test]
fn a_low_robot_that_tells_no_level_while_it_charges_is_home_released_and_held() {
    for beyond in BEYOND {
        let mut rig = Rig::online(60);
        assert_eq!(sent(&rig.report(power(20))), [Command::STOP, FIND]);
        rig.handle(Fact::Engine(EngineReport::Docked));
        let mut acts = rig.report(beyond);
        acts.extend(rig.report(beyond));
        assert!(rig.dog.low().is_none() && rig.dog.docked());
        assert_eq!(sent(&acts), []);
        let acts = [acts, rig.pass(100 * SECOND, true), rig.report(beyond)].concat();
        assert_eq!(sent(&acts), [], "it stays");
        assert_eq!(undock_ended(&rig.undock(1)), Some(DockEnd::Safety));
        // Off the station its level counts at once.
        rig.handle(Fact::Engine(EngineReport::Undocked));
        assert_eq!(sent(&rig.report(power(19))), [Command::STOP, FIND]);
    }
}

#[test]
fn a_docking_is_done_when_a_robot_on_its_contacts_tells_no_level() {
    for beyond in BEYOND {
        let mut rig = Rig::online(60);
        rig.dock(1);
        rig.handle(Fact::Engine(EngineReport::Docked));
        let acts = [rig.report(beyond), rig.report(beyond)].concat();
        assert_eq!(dock_ended(&acts), Some((DockEnd::Done, 1)));
        let acts = rig.undock(2);
        assert_eq!(sent(&acts), [LEAVE], "its last level was good");
    }
}

#[test]
fn off_its_station_a_robot_that_tells_no_level_drives_and_goes_home_after_ten_minutes() {
    let beyond = BEYOND[2];
    let mut rig = Rig::with(Limits::default());
    rig.handle(login(false, beyond));
    rig.now += 20 * MS;
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
    for _ in 0..9 {
        let acts = [rig.pass(59 * SECOND, true), rig.report(beyond)].concat();
        assert!(!sent(&acts).contains(&FIND));
    }
    let acts = rig.pass(60 * SECOND, true);
    assert!(sent(&acts).ends_with(&[Command::STOP, FIND]), "{acts:?}");
}
