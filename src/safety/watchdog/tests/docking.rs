//! Docking and undocking at the request of behaviours.

use super::rig::*;
use super::*;
use crate::robot::DockPlan;

#[test]
fn a_behaviour_docks_and_docked_means_charging() {
    let mut rig = Rig::online(60);
    rig.drive(1, None);
    let acts = rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
    assert_eq!(sent(&acts), [Command::STOP, FIND]);
    assert_eq!(rig.handle(Fact::Engine(EngineReport::Docked)), []);
    assert_eq!(
        dock_ended(&rig.handle(Fact::Power(charging(60)))),
        Some((DockEnd::Done, 1))
    );
    let again = rig.ask(Intent::Dock {
        call: CallId(8),
        plan: DockPlan::default(),
    });
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

#[test]
fn a_low_battery_takes_over_a_docking_and_its_caller_is_answered() {
    let mut rig = Rig::online(60);
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
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
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
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
fn cancelling_a_docking_answers_its_caller() {
    let mut rig = Rig::online(60);
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
    let acts = rig.ask(Intent::CancelDock);
    assert_eq!(sent(&acts), [CANCEL, Command::STOP]);
    assert_eq!(dock_ended(&acts), Some((DockEnd::Cancelled, 1)));
}

#[test]
fn undocking_waits_for_the_robots_confirmation() {
    let mut rig = Rig::with(Limits::default());
    rig.handle(Fact::LinkUp {
        docked: true,
        power: charging(80),
    });
    rig.now += SECOND;
    let acts = rig.ask(Intent::Undock {
        call: CallId(1),
        timeout: 20 * SECOND,
    });
    assert_eq!(sent(&acts), [Command::Engine(Engage::Undock)]);
    let acts = rig.handle(Fact::Engine(EngineReport::Undocked));
    assert_eq!(
        events(&acts),
        [Event::UndockEnded {
            call: CallId(1),
            end: DockEnd::Done
        }]
    );
    assert_eq!(sent(&rig.drive(1, None)), [FORWARD]);
}

#[test]
fn a_docking_ends_only_with_its_own_caller() {
    let mut rig = Rig::online(60);
    rig.ask(Intent::Dock {
        call: CallId(7),
        plan: DockPlan::default(),
    });
    assert_eq!(rig.handle(Fact::Gone(BehaviourId(1))), []);
    assert_eq!(rig.dog.state(), WatchdogState::Docking);
    assert_eq!(sent(&rig.handle(Fact::Gone(WHO))), [CANCEL, Command::STOP]);
    assert_eq!(rig.dog.state(), WatchdogState::Free);
}

#[test]
fn only_its_caller_is_told_how_an_undocking_ends() {
    for (gone, told_at_the_end) in [(BehaviourId(1), 1), (WHO, 0)] {
        let mut rig = Rig::with(Limits::default());
        rig.handle(Fact::LinkUp {
            docked: true,
            power: charging(80),
        });
        rig.ask(Intent::Undock {
            call: CallId(1),
            timeout: 20 * SECOND,
        });
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
    rig.ask_as(
        other,
        0,
        Intent::Dock {
            call: CallId(8),
            plan: DockPlan::default(),
        },
    );
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
