//! Docking and undocking at the request of behaviours. A docking has an owner and a priority, like
//! a setpoint.

use super::*;
use crate::robot::{DockPlan, MotionId};

#[test]
fn a_behaviour_docks_and_docked_means_charging() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.dock(7);
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    assert_eq!(rig.handle(Fact::Engine(EngineReport::Docked)), []);
    assert_eq!(
        dock_ended(&rig.handle(Fact::Power(charging(60)))),
        Some((DockEnd::Done, 1))
    );
    let again = rig.dock(8);
    assert_eq!(
        (sent(&again), dock_ended(&again)),
        (vec![], Some((DockEnd::AlreadyDocked, 0)))
    );
}

#[test]
fn between_a_behaviours_tries_the_robot_backs_off() {
    let mut rig = Rig::online(60);
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan {
            retries: 1,
            ..DockPlan::default()
        },
    });
    let back = Command::Move {
        left: -27,
        right: -27,
    };
    let acts = rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert_eq!(sent(&acts)[0], Command::STOP);
    let acts = [acts, rig.pass(2 * SECOND, false)].concat();
    assert!(sent(&acts).contains(&back));
    assert_eq!(sent(&acts)[sent(&acts).len() - 2..], [Command::STOP, FIND]);
    let over = rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert_eq!(dock_ended(&over), Some((DockEnd::BaseNotFound, 2)));
}

const RESCUER: BehaviourId = BehaviourId(9);

/// A docking of `WHO` whose second search has failed, with a rescue behaviour, which drives.
fn granted() -> Rig {
    let mut rig = Rig::online(60);
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::ORDERED,
    });
    assert!(!rig.dog.wants_rescue());
    rig.pass(10 * SECOND, false);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert!(rig.dog.wants_rescue());
    rig.handle(Fact::Rescuer(Some(RESCUER)));
    rig.pass(2 * SECOND, false);
    assert_eq!(rescuer_drives(&mut rig), [ended(1, MotionEnd::Preempted)]);
    rig.pass(10 * SECOND, false);
    let acts = rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    let power = Limits::default().rescue_power;
    let seconds = 21 * SECOND;
    assert_eq!(events(&acts), [Event::DriveGrant { seconds, power }]);
    assert_eq!(rescuer_drives(&mut rig), []);
    rig.pass(50 * MS, false);
    assert!(rig.dog.moving());
    rig
}

fn rescuer_drives(rig: &mut Rig) -> Vec<Event> {
    let acts = rig.ask_as(
        RESCUER,
        0,
        Intent::Move {
            motion: MotionId(1),
            setpoint: Setpoint::from_percent(30.0, 30.0).unwrap(),
            duration: None,
        },
    );
    events(&acts)
}

#[test]
fn between_two_searches_of_a_docking_the_rescue_behaviour_drives() {
    let mut rig = granted();
    // Nobody else does, and its stop begins the next search.
    let refused = rig.drive(2, None);
    assert_eq!(events(&refused), [ended(2, MotionEnd::Preempted)]);
    assert!(rig.dog.moving());
    let acts = rig.ask_as(RESCUER, 0, Intent::Stop);
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    let next = rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    let [Event::DriveGrant { seconds, .. }] = events(&next)[..] else {
        panic!("{next:?}");
    };
    assert_eq!(seconds, Limits::default().rescue_time.get());
    let over = rig.ask(Intent::CancelDock);
    assert_eq!(dock_ended(&over), Some((DockEnd::Cancelled, 3)));
    assert!(!rig.dog.wants_rescue() && !rig.dog.moving());
    // It has nothing to drive for.
    assert_eq!(rescuer_drives(&mut rig), [ended(1, MotionEnd::Preempted)]);
    assert!(!rig.dog.moving());
}

#[test]
fn the_rescue_behaviour_gives_up_a_search_of_a_docking_that_it_helps() {
    let mut rig = granted();
    rig.ask_as(RESCUER, 0, Intent::Stop);
    rig.pass(10 * SECOND, false);
    let acts = rig.ask_as(RESCUER, 0, Intent::CancelDock);
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
    assert!(matches!(events(&acts)[..], [Event::DriveGrant { .. }]));
    // Not one that it does not help.
    let mut rig = Rig::online(60);
    rig.handle(Fact::Rescuer(Some(RESCUER)));
    rig.dock(7);
    rig.pass(10 * SECOND, false);
    assert_eq!(rig.ask_as(RESCUER, 0, Intent::CancelDock), []);
}

#[test]
fn a_docking_with_the_usual_retries_backs_off_and_needs_no_rescue() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    rig.handle(Fact::Engine(EngineReport::BaseNotFound));
    assert!(!rig.dog.wants_rescue());
}

#[test]
fn a_grant_is_over_in_time_and_when_its_host_is_silent_or_gone() {
    let silent = |rig: &mut Rig| rig.pass(SECOND, false);
    let gone = |rig: &mut Rig| rig.handle(Fact::Gone(RESCUER));
    let late = |rig: &mut Rig| {
        let beat = |rig: &mut Rig| {
            rig.handle(Fact::Alive(RESCUER));
            rig.pass(100 * MS, false)
        };
        (0..230).flat_map(|_| beat(rig)).collect()
    };
    let ends: [fn(&mut Rig) -> Vec<Act>; 3] = [silent, gone, late];
    for end in ends {
        let mut rig = granted();
        let acts = end(&mut rig);
        let sent = sent(&acts);
        assert_eq!(sent[sent.len() - 2..], [Command::STOP, FIND]);
        assert!(!rig.dog.moving());
    }
}

#[test]
fn a_grant_ends_with_its_docking() {
    let cancelled = |rig: &mut Rig| rig.ask(Intent::CancelDock);
    let gone = |rig: &mut Rig| rig.handle(Fact::Gone(WHO));
    let stopped = |rig: &mut Rig| rig.handle(Fact::StoppedByPerson(true));
    let run_ends = |rig: &mut Rig| rig.handle(Fact::RunEnding);
    let unguarded = |rig: &mut Rig| rig.handle(Fact::Guarded(false));
    let docked = |rig: &mut Rig| rig.handle(Fact::Engine(EngineReport::Docked));
    let ends: [fn(&mut Rig) -> Vec<Act>; 6] =
        [cancelled, gone, stopped, run_ends, unguarded, docked];
    for end in ends {
        let mut rig = granted();
        let acts = end(&mut rig);
        assert_eq!(sent(&acts).last(), Some(&Command::STOP), "{acts:?}");
        rescuer_drives(&mut rig);
        assert!(!rig.dog.moving(), "{acts:?}");
    }
    // Who takes the tracks with a higher priority has them.
    let mut rig = granted();
    let mut acts = rig.ask_as(
        BehaviourId(3),
        10,
        Intent::Move {
            motion: MotionId(5),
            setpoint: Setpoint::from_percent(50.0, 50.0).unwrap(),
            duration: None,
        },
    );
    assert_eq!(dock_ended(&acts), Some((DockEnd::Preempted, 2)));
    acts.extend(rig.pass(50 * MS, false));
    assert_eq!(sent(&acts).last(), Some(&FORWARD));
    // A low battery continues the way home by its own rules.
    let mut rig = granted();
    assert_eq!(
        sent(&rig.handle(Fact::Power(power(20)))),
        [Command::STOP, FIND]
    );
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn a_low_battery_takes_over_a_docking_and_its_caller_is_answered() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    assert_eq!(
        sent(&rig.handle(Fact::Power(power(20)))),
        [Command::STOP, FIND]
    );
    rig.handle(Fact::Engine(EngineReport::Docked));
    assert_eq!(
        dock_ended(&rig.handle(Fact::Power(charging(20)))),
        Some((DockEnd::Done, 1))
    );
}

#[test]
fn a_docking_that_was_taken_over_is_returned_at_the_ok_level() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    rig.handle(Fact::Power(power(20)));
    for _ in 0..3 {
        assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
        assert_eq!(sent(&rig.report(power(50))), []);
    }
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    assert_eq!(sent(&rig.ask(Intent::CancelDock)), [CANCEL, Command::STOP]);
}

#[test]
fn no_behaviour_can_end_the_watchdogs_own_docking() {
    let mut rig = Rig::online(20);
    assert_eq!(sent(&rig.ask(Intent::CancelDock)), []);
    assert_eq!(sent(&rig.ask(Intent::Stop)), []);
    assert_eq!(sent(&rig.handle(Fact::Gone(WHO))), []);
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn undocking_waits_for_the_robots_confirmation() {
    let mut rig = Rig::docked(charging(80));
    let acts = rig.undock(1);
    assert_eq!(sent(&acts), [Command::Engine(Engage::Undock)]);
    let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
    let call = CallId(1);
    let end = DockEnd::Done;
    assert_eq!(events(&acts), [Event::UndockEnded { call, end }]);
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
}

#[test]
fn a_docking_ends_only_with_its_own_caller() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    assert_eq!(rig.handle(Fact::Gone(BehaviourId(1))), []);
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    assert_eq!(sent(&rig.handle(Fact::Gone(WHO))), [CANCEL, Command::STOP]);
    assert_eq!(rig.dog.state(), WatchdogState::Free);
}

#[test]
fn only_its_caller_is_told_how_an_undocking_ends() {
    for (gone, told_at_the_end) in [(BehaviourId(1), 1), (WHO, 0)] {
        let mut rig = Rig::docked(charging(80));
        rig.undock(1);
        rig.handle(Fact::Gone(gone));
        let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
        assert_eq!(events(&acts).len(), told_at_the_end);
    }
}

#[test]
fn the_remaining_caller_of_a_low_robots_docking_is_answered() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    let other = BehaviourId(1);
    rig.ask_as(other, 0, dock(8));
    rig.handle(Fact::Power(power(20)));
    rig.handle(Fact::Gone(WHO));
    rig.handle(Fact::Engine(EngineReport::Docked));
    let acts = rig.handle(Fact::Power(charging(20)));
    let ended = acts.iter().filter_map(|act| match act {
        Act::Tell(who, Event::DockEnded { call, .. }) => Some((*who, *call)),
        _ => None,
    });
    assert_eq!(ended.collect::<Vec<_>>(), [(other, CallId(8))]);
}

#[test]
fn the_end_of_a_docking_is_reported_once_with_its_caller() {
    let mut rig = Rig::online(60);
    rig.dock(7);
    assert_eq!(rig.dog.take_dock_report(), None);
    rig.handle(Fact::Engine(EngineReport::Docked));
    rig.handle(Fact::Power(charging(60)));
    let report = rig.dog.take_dock_report().unwrap();
    assert_eq!((report.by, report.outcome.attempts), (Some(WHO), 1));
    assert_eq!(report.outcome.end, DockEnd::Done);
    assert_eq!(rig.dog.take_dock_report(), None);
}

#[test]
fn a_robot_off_its_station_is_not_undocked() {
    let acts = Rig::online(80).undock(1);
    assert_eq!(
        (sent(&acts), undock_ended(&acts)),
        (vec![], Some(DockEnd::NotDocked))
    );
}

const HIGH: BehaviourId = BehaviourId(1);

fn dock(call: u64) -> Intent {
    Intent::Dock {
        call: CallId(call),
        plan: DockPlan::default(),
    }
}

fn undock(call: u64) -> Intent {
    Intent::Undock {
        call: CallId(call),
        timeout: 20 * SECOND,
    }
}

fn drive(motion: u64) -> Intent {
    Intent::Move {
        motion: MotionId(motion),
        setpoint: Setpoint::from_percent(50.0, 50.0).unwrap(),
        duration: None,
    }
}

#[test]
fn a_docking_of_lower_priority_than_the_driver_is_refused() {
    let mut rig = Rig::online(60);
    rig.ask_as(HIGH, 10, drive(1));
    let acts = rig.dock(1);
    assert_eq!(sent(&acts), []);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Preempted, 0)));
    assert!(rig.dog.moving());
}

#[test]
fn a_docking_of_equal_priority_takes_the_tracks() {
    let mut rig = Rig::online(60);
    rig.ask_as(HIGH, 0, drive(1));
    assert_eq!(sent(&rig.dock(1)), [Command::STOP, FIND]);
}

#[test]
fn a_docking_ends_when_a_higher_priority_wants_to_drive() {
    let mut rig = Rig::online(60);
    rig.dock(1);
    rig.now += SECOND;
    let acts = rig.ask_as(WHO, 0, drive(1));
    assert_eq!(events(&acts), [ended(1, MotionEnd::Preempted)]);
    let acts = rig.ask_as(HIGH, 10, drive(1));
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
    assert_eq!(sent(&rig.pass(20 * MS, false)), [FORWARD]);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Preempted, 1)));
}

#[test]
fn no_priority_ends_the_watchdogs_own_docking() {
    let mut rig = Rig::online(20);
    let acts = rig.ask_as(HIGH, i16::MAX, drive(1));
    assert_eq!(sent(&acts), []);
    assert_eq!(events(&acts), [ended(1, MotionEnd::Safety)]);
    assert_eq!(rig.dog.state(), WatchdogState::LowGoingHome);
}

#[test]
fn a_docking_is_cancelled_only_by_its_caller_and_by_equal_or_higher_priorities() {
    for give_up in [Intent::Stop, Intent::CancelDock] {
        for (by, priority, ends) in [
            (WHO, -10, true),
            (HIGH, 10, true),
            (HIGH, 5, true),
            (HIGH, 4, false),
        ] {
            let mut rig = Rig::online(60);
            rig.ask_as(WHO, 5, dock(1));
            let acts = rig.ask_as(by, priority, give_up.clone());
            let expected = ends.then_some((DockEnd::Cancelled, 1));
            assert_eq!(dock_ended(&acts), expected, "{give_up:?} of {priority}");
            assert_eq!(rig.dog.docking.is_none(), ends);
        }
    }
}

#[test]
fn of_two_callers_the_higher_keeps_the_docking() {
    let mut rig = Rig::online(60);
    rig.ask_as(WHO, 0, dock(1));
    rig.ask_as(HIGH, 10, dock(2));
    let acts = rig.ask_as(WHO, 0, Intent::CancelDock);
    assert_eq!(sent(&acts), []);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 0)));
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    let acts = rig.handle(Fact::Gone(HIGH));
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
}

#[test]
fn an_undocking_gives_way_only_to_a_higher_one() {
    let mut rig = Rig::docked(charging(80));
    rig.ask_as(WHO, 5, undock(1));
    let acts = rig.ask_as(HIGH, 4, undock(2));
    assert_eq!(sent(&acts), []);
    assert_eq!(undock_ended(&acts), Some(DockEnd::Preempted));
    let acts = rig.ask_as(HIGH, 5, undock(3));
    assert_eq!(sent(&acts), [LEAVE]);
    assert_eq!(undock_ended(&acts), Some(DockEnd::Cancelled));
}

#[test]
fn a_docking_that_waits_for_charging_is_not_undocked_by_a_lower_priority() {
    let mut rig = Rig::docked(power(80));
    rig.ask_as(HIGH, 10, dock(1));
    assert_eq!(undock_ended(&rig.undock(1)), Some(DockEnd::Preempted));
    let acts = rig.ask_as(WHO, 10, undock(2));
    assert_eq!(sent(&acts), [LEAVE], "as high");
}

#[test]
fn no_script_stops_a_leg_of_the_watchdog() {
    let (mut rig, _) = lost(20, Limits::default());
    rig.pass(SECOND, false);
    assert!(rig.dog.moving());
    for priority in [0, i16::MAX] {
        assert_eq!(sent(&rig.ask_as(WHO, priority, Intent::Stop)), []);
    }
    assert!(rig.dog.moving());
    assert_eq!(sent(&rig.pass(2 * SECOND, false)).last(), Some(&FIND));
}
