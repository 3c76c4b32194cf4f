//! What follows a failed search: blind moves, pauses, the alarm.

use super::rig::*;
use super::*;
use crate::robot::Seconds;
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
    let acts = rig.handle(Fact::LinkUp {
        docked: false,
        power: power(19),
    });
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
        rig.handle(Fact::LinkUp {
            docked: false,
            power: power(19),
        });
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
