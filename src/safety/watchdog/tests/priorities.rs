//! A docking has an owner and a priority, like a setpoint.

use super::rig::*;
use super::*;
use crate::robot::{DockPlan, MotionId};

const HIGH: BehaviourId = BehaviourId(1);
const PLAN: DockPlan = DockPlan {
    timeout: Duration::from_secs(180),
    retries: 2,
    charge_timeout: Duration::from_secs(30),
};

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
            rig.ask_as(
                WHO,
                5,
                Intent::Dock {
                    call: CallId(1),
                    plan: PLAN,
                },
            );
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
    rig.ask_as(
        WHO,
        0,
        Intent::Dock {
            call: CallId(1),
            plan: PLAN,
        },
    );
    rig.ask_as(
        HIGH,
        10,
        Intent::Dock {
            call: CallId(2),
            plan: PLAN,
        },
    );
    let acts = rig.ask_as(WHO, 0, Intent::CancelDock);
    assert_eq!(sent(&acts), []);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 0)));
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    let acts = rig.handle(Fact::Gone(HIGH));
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
}

#[test]
fn an_undocking_gives_way_only_to_a_higher_one() {
    let undock = |call| Intent::Undock {
        call: CallId(call),
        timeout: 20 * SECOND,
    };
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
    rig.ask_as(
        HIGH,
        10,
        Intent::Dock {
            call: CallId(1),
            plan: PLAN,
        },
    );
    assert_eq!(undock_ended(&rig.undock(1)), Some(DockEnd::Preempted));
    let acts = rig.ask_as(
        WHO,
        10,
        Intent::Undock {
            call: CallId(2),
            timeout: 20 * SECOND,
        },
    );
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
