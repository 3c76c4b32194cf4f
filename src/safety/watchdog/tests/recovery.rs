//! What follows a failed search: blind moves, pauses, the alarm, and grants of the tracks to a
//! rescue behaviour.

use super::*;
use crate::robot::{MotionId, Percent, Seconds};
use crate::safety::{LastWords, Rescue};
use crate::wire::{Led, Sound};

const NOT_FOUND: Fact = Fact::Engine(EngineReport::BaseNotFound);

#[test]
fn where_it_finds_no_station_it_drives_a_short_leg_and_searches_from_there() {
    let mut rig = searching(20, Limits::default());
    let acts = rig.handle(NOT_FOUND);
    assert_eq!(
        reasons(&acts),
        [
            "docking failed (base_not_found) 1 times: makes short blind move 1, and searches from there"
        ]
    );
    let acts = [acts, rig.pass(1999 * MS, false)].concat();
    assert_eq!(tracks(&acts), [(0, 0), (27, 27)]);
    assert!(count(&acts, &LEG) >= 10, "sent 5 times a second");
    assert_eq!(sent(&rig.pass(MS, false)), [Command::STOP, FIND]);
    assert_eq!(tracks(&rig.pass(100 * SECOND, false)), [], "it searches");
    let acts = rig.handle(NOT_FOUND);
    assert!(reasons(&acts)[0].contains("makes short blind move 2,"));
    let acts = [acts, rig.pass(2950 * MS, false)].concat();
    assert_eq!(tracks(&acts), [(0, 0), (-27, 27), (27, 27), (0, 0)]);
    assert_eq!(count(&acts, &FIND), 1);
    rig.handle(Fact::Engine(EngineReport::Docked));
    rig.handle(Fact::Power(charging(19)));
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
    assert_eq!(sent(&rig.pass(1000 * SECOND, false)), []);
}

#[test]
fn legs_go_on_for_as_long_as_the_battery_lasts() {
    let mut rig = searching(20, Limits::default());
    for level in [20, 15, 10, 8, 5, 3, 2, 1] {
        for _ in 0..5 {
            rig.handle(Fact::Power(power(level)));
            let acts = [rig.handle(NOT_FOUND), rig.pass(6 * SECOND, false)].concat();
            assert!(tracks(&acts).len() > 1, "{level}");
            assert_eq!(count(&acts, &FIND), 1, "{level}");
        }
    }
}

#[test]
fn without_legs_it_stands_for_one_pause_between_two_searches() {
    let mut rig = searching(20, standing());
    for level in [20, 15, 9, 8, 5] {
        rig.pass(100 * SECOND, false);
        rig.handle(Fact::Power(power(level)));
        let acts = rig.handle(NOT_FOUND);
        assert_eq!(tracks(&acts), [(0, 0)]);
        assert!(reasons(&acts)[0].ends_with("tries again in 20 s"));
        assert_eq!(count(&rig.pass(19 * SECOND, false), &FIND), 0);
        let acts = rig.pass(SECOND, false);
        assert_eq!(count(&acts, &FIND), 1, "{level} %");
        assert_eq!(tracks(&acts), [(0, 0)], "a stop first");
    }
    assert_eq!(rig.dog.state(), WatchdogState::Alarm);
}

#[test]
fn no_two_searches_begin_within_a_second() {
    let limits = Limits {
        dock_pause: Seconds::from_millis(50),
        ..standing()
    };
    let mut rig = searching(20, limits);
    rig.handle(NOT_FOUND);
    assert_eq!(sent(&rig.pass(50 * MS, false)), [Command::STOP, FIND]);
    assert_eq!(sent(&rig.handle(NOT_FOUND)), [Command::STOP]);
    assert_eq!(sent(&rig.pass(999 * MS, false)), []);
    assert_eq!(sent(&rig.pass(MS, false)), [Command::STOP, FIND]);
}

#[test]
fn the_fourth_failure_sounds_the_alarm() {
    let (mut rig, acts) = lost(20, standing());
    let flash = Command::Led {
        led: Led::Flash,
        on: true,
    };
    let alarm = Command::Play(Sound::Alarm);
    let loud = Command::Volume(100);
    assert_eq!(sent(&acts), [Command::STOP, loud, alarm.clone(), flash]);
    assert!(rig.dog.alarm_sounds());
    assert_eq!(
        sent(&rig.handle(Fact::BytesReceived)),
        [],
        "not at every occasion"
    );
    let alarms = count(&rig.pass(59 * SECOND, false), &alarm);
    assert!((3..=5).contains(&alarms), "{alarms}");
    assert_eq!(events(&rig.drive(9, None)), [ended(9, MotionEnd::Safety)]);
    rig.report(charging(21));
    assert_eq!(rig.dog.state(), WatchdogState::Alarm, "one report");
    rig.report(charging(21));
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
    assert!(!rig.dog.alarm_sounds());
}

#[test]
fn the_next_search_and_the_end_of_a_leg_are_deadlines() {
    let mut rig = searching(20, standing());
    rig.pass(100 * SECOND, false);
    rig.handle(NOT_FOUND);
    assert_eq!(rig.dog.next_deadline(), Some(rig.now + 20 * SECOND));
    let mut rig = searching(20, Limits::default());
    rig.handle(NOT_FOUND);
    let due = rig.now + 2 * SECOND;
    rig.pass(1950 * MS, false);
    assert_eq!(rig.dog.next_deadline(), Some(due));
}

#[test]
fn a_search_that_takes_too_long_is_cancelled_and_no_leg_follows() {
    let mut rig = searching(20, Limits::default());
    let acts = rig.pass(180 * SECOND, false);
    assert_eq!(count(&acts, &CANCEL), 1);
    assert_eq!(tracks(&acts), [(0, 0)]);
    let failed = "docking failed (timeout) 1 times: tries again in 20 s";
    assert_eq!(reasons(&acts), [failed]);
}

#[test]
fn release_takeover_and_link_loss_end_a_leg() {
    let stop = || vec![Command::STOP];
    let ends = [
        (Fact::Power(charging(19)), stop()),
        (Fact::Engine(EngineReport::Docked), stop()),
        (Fact::RunEnding, [stop(), vec![FIND]].concat()),
        (Fact::Suspended, [stop(), vec![FIND]].concat()),
        (Fact::LinkDown, vec![]),
    ];
    for (end, expected) in ends {
        let mut rig = searching(20, Limits::default());
        rig.handle(NOT_FOUND);
        rig.pass(500 * MS, false);
        assert!(rig.dog.moving());
        assert_eq!(sent(&rig.handle(end.clone())), expected, "{end:?}");
        assert!(!rig.dog.moving(), "{end:?}");
        let later = rig.pass(100 * SECOND, false);
        assert!(tracks(&later).iter().all(|one| *one == (0, 0)), "{end:?}");
    }
}

#[test]
fn after_a_reconnect_it_searches_before_it_drives_a_leg() {
    let (mut rig, _) = lost(20, Limits::default());
    rig.pass(SECOND, false);
    rig.handle(Fact::LinkDown);
    rig.now += 10 * SECOND;
    let acts = rig.handle(login(false, power(19)));
    assert_eq!(count(&acts, &FIND), 1, "{acts:?}");
    assert_eq!(tracks(&acts), [(0, 0)]);
    assert_eq!(tracks(&rig.pass(100 * SECOND, false)), []);
    rig.handle(NOT_FOUND);
    rig.pass(SECOND, false);
    assert!(rig.dog.moving());
}

#[test]
fn lost_links_do_not_reset_the_count_of_failures() {
    let mut rig = searching(20, standing());
    for _ in 0..4 {
        rig.pass(SECOND, false);
        rig.handle(NOT_FOUND);
        rig.handle(Fact::LinkDown);
        rig.handle(login(false, power(19)));
    }
    assert_eq!(rig.dog.state(), WatchdogState::Alarm);
}

#[test]
fn a_caller_of_a_low_robots_docking_waits_through_its_failures() {
    let mut rig = searching(20, standing());
    assert_eq!(rig.dock(7), []);
    rig.pass(100 * SECOND, false);
    assert_eq!(dock_ended(&rig.handle(NOT_FOUND)), None);
    rig.pass(20 * SECOND, false);
    rig.handle(Fact::Engine(EngineReport::Docked));
    let acts = rig.handle(Fact::Power(charging(20)));
    assert_eq!(dock_ended(&acts), Some((DockEnd::Done, 2)));

    let mut rig = searching(20, standing());
    rig.dock(7);
    let mut acts = Vec::new();
    for _ in 0..4 {
        acts.extend(rig.handle(NOT_FOUND));
        acts.extend(rig.pass(20 * SECOND, false));
    }
    assert_eq!(dock_ended(&acts), Some((DockEnd::Safety, 4)));
}

#[test]
fn load_is_shed_at_the_critical_level_unless_it_charges() {
    let mut rig = searching(9, Limits::default());
    assert!(!rig.dog.shed());
    rig.handle(Fact::Power(power(8)));
    assert!(rig.dog.shed());
    rig.handle(Fact::Engine(EngineReport::Docked));
    assert!(rig.dog.shed(), "not yet");
    rig.handle(Fact::Power(charging(8)));
    assert!(!rig.dog.shed());
}

#[test]
fn a_lost_link_is_not_a_failed_search() {
    let mut rig = searching(20, standing());
    rig.pass(SECOND, false);
    let acts = rig.handle(Fact::LinkDown);
    assert!(
        !reasons(&acts)
            .iter()
            .any(|reason| reason.contains("failed")),
        "{acts:?}"
    );
}

#[test]
fn a_search_that_the_release_ends_is_not_a_failed_one() {
    let mut rig = searching(20, standing());
    rig.pass(SECOND, false);
    let acts: Vec<Act> = (0..4).flat_map(|_| rig.report(power(60))).collect();
    assert_eq!(reasons(&acts), ["battery at 60 %"]);
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
}

const RESCUER: BehaviourId = BehaviourId(9);
const CAPPED: Command = Command::Move {
    left: 40,
    right: 20,
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
fn a_grant_is_announced_and_lasts_eight_seconds_at_less_than_half_power() {
    let (mut rig, acts) = granted(Limits::default());
    let grant = Event::DriveGrant {
        seconds: 8 * SECOND,
        power: Percent::saturating(45),
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
fn the_rescuer_gives_up_searches_but_not_each_first_of_four_in_its_first_minute() {
    let (mut rig, _) = granted(Limits::default());
    let mut given_up = Vec::new();
    for _ in 1..9 {
        rig.ask_as(RESCUER, 0, Intent::Stop);
        rig.pass(9 * SECOND, false);
        let mut acts = rig.ask_as(RESCUER, 0, Intent::CancelDock);
        given_up.push(!acts.is_empty());
        let mut seconds = 18 * SECOND;
        if acts.is_empty() {
            rig.pass(50 * SECOND, false);
            assert_eq!(rig.ask_as(RESCUER, 0, Intent::CancelDock), []);
            rig.pass(SECOND, false);
            acts = rig.ask_as(RESCUER, 0, Intent::CancelDock);
            seconds = 40 * SECOND;
        }
        assert_eq!(sent(&acts)[..2], [CANCEL, Command::STOP]);
        let power = Limits::default().rescue_power;
        assert!(acts.contains(&Act::Tell(RESCUER, Event::DriveGrant { seconds, power })));
    }
    assert_eq!(given_up, [true, true, true, false, true, true, true, false]);
}

#[test]
fn the_rescuer_gives_up_the_first_search_after_a_minute() {
    let mut rig = searching(20, Limits::default());
    rig.handle(Fact::Rescuer(Some(RESCUER)));
    rig.pass(50 * SECOND, false);
    assert_eq!(rig.ask_as(RESCUER, 0, Intent::CancelDock), []);
    rig.pass(10 * SECOND, false);
    let acts = rig.ask_as(RESCUER, 0, Intent::CancelDock);
    assert_eq!(sent(&acts)[..2], [CANCEL, Command::STOP]);
}

#[test]
fn after_a_search_that_was_given_up_no_blind_move_follows_but_a_search() {
    let (mut rig, _) = granted(Limits::default());
    rig.ask_as(RESCUER, 0, Intent::Stop);
    rig.pass(9 * SECOND, false);
    rig.ask_as(RESCUER, 0, Intent::CancelDock);
    let acts = rig.pass(1500 * MS, false);
    assert_eq!((tracks(&acts), count(&acts, &FIND)), (vec![(0, 0)], 1));
}

#[test]
fn nobody_else_gives_up_a_search_and_nothing_but_a_search_is_given_up() {
    let (mut rig, _) = granted(Limits::default());
    drive(&mut rig, 1);
    assert_eq!(rig.ask_as(RESCUER, 0, Intent::CancelDock), []);
    assert!(rig.dog.moving());
    rig.ask_as(RESCUER, 0, Intent::Stop);
    rig.pass(9 * SECOND, false);
    assert_eq!(rig.ask_as(WHO, i16::MAX, Intent::CancelDock), []);
    rig.handle(Fact::Engine(EngineReport::Docked));
    assert_eq!(rig.ask_as(RESCUER, 0, Intent::CancelDock), []);
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
    let stop = Input::Request(RESCUER, Priority(0), Intent::Stop);
    let found = || vec![Command::STOP, FIND];
    let ends = [
        (stop, found()),
        (Fact::Gone(RESCUER).into(), found()),
        (Fact::Rescuer(None).into(), found()),
        (Fact::Rescuer(Some(WHO)).into(), found()),
        (Fact::RunEnding.into(), found()),
        (Fact::Suspended.into(), found()),
        (Fact::LinkDown.into(), vec![]),
        (
            Fact::Engine(EngineReport::Docked).into(),
            vec![Command::STOP],
        ),
        (Fact::Power(charging(20)).into(), vec![Command::STOP]),
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

/// The first minutes of a low robot that reports contact at this level and does not charge, whose
/// searches find no station.
fn on_contacts(percent: u8, minutes: u32) -> (Rig, Vec<Act>) {
    let mut rig = searching(20, Limits::default());
    rig.handle(Fact::Rescuer(Some(RESCUER)));
    rig.handle(Fact::Engine(EngineReport::Docked));
    let mut acts = Vec::new();
    for _ in 0..minutes * 6 {
        acts.extend(rig.handle(Fact::Power(power(percent))));
        acts.extend(rig.pass(10 * SECOND, false));
        if rig.dog.state() != WatchdogState::Docked {
            acts.extend(rig.handle(NOT_FOUND));
        }
    }
    (rig, acts)
}

#[test]
fn no_grant_and_no_blind_move_drives_a_low_robot_off_its_contacts() {
    for percent in [12, 3, 0] {
        let (mut rig, acts) = on_contacts(percent, 30);
        assert!(tracks(&acts).iter().all(|one| *one == (0, 0)), "{percent}");
        let granted = |event: &Event| matches!(event, Event::DriveGrant { .. });
        assert!(!events(&acts).iter().any(granted), "{percent}");
        assert_eq!(rig.dog.state(), WatchdogState::Alarm, "{percent}");
        assert!(!rig.dog.wants_rescue());
        rig.handle(Fact::Engine(EngineReport::Undocked));
        rig.handle(Fact::Power(power(percent)));
        let acts = [rig.handle(NOT_FOUND), rig.pass(SECOND, false)].concat();
        assert!(events(&acts).iter().any(granted), "off them it helps");
    }
}

#[test]
fn at_no_percent_on_its_contacts_it_waits_for_a_quarter_of_an_hour_and_then_calls_a_person() {
    let (mut rig, acts) = on_contacts(0, 14);
    assert_eq!(
        (sent(&acts), rig.dog.state()),
        (vec![], WatchdogState::Docked)
    );
    let acts = rig.pass(61 * SECOND, false);
    assert_eq!(rig.dog.state(), WatchdogState::Alarm);
    assert_eq!(count(&acts, &Command::Play(Sound::Alarm)), 1);
    let acts = rig.pass(3600 * SECOND, false);
    assert_eq!(
        (count(&acts, &FIND), tracks(&acts)),
        (0, vec![]),
        "only the alarm"
    );
    rig.handle(Fact::Power(charging(1)));
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
    assert!(!rig.dog.alarm_sounds());
}

#[test]
fn a_battery_that_charges_from_no_percent_is_left_alone() {
    let (mut rig, acts) = on_contacts(0, 10);
    assert_eq!(sent(&acts), []);
    let acts = rig.handle(Fact::Power(charging(1)));
    assert_eq!(reasons(&acts), ["battery at 1 %"]);
    assert_eq!(sent(&rig.pass(3600 * SECOND, false)), []);
}

#[test]
fn lost_links_do_not_begin_the_quarter_of_an_hour_again() {
    let (mut rig, _) = on_contacts(0, 10);
    rig.handle(Fact::LinkDown);
    rig.now += 120 * SECOND;
    let acts = rig.handle(login(true, power(0)));
    assert_eq!(
        (count(&acts, &FIND), rig.dog.state()),
        (0, WatchdogState::Docked)
    );
    rig.pass(179 * SECOND, false);
    assert_eq!(rig.dog.state(), WatchdogState::Docked);
    rig.pass(2 * SECOND, false);
    assert_eq!(rig.dog.state(), WatchdogState::Alarm);
}
