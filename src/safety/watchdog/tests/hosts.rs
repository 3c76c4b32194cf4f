//! Hosts that fall silent, and extreme requests.

use super::rig::*;
use super::*;
use crate::robot::{DockPlan, EndReason};

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
    rig.ask(Intent::Dock {
        call: CallId(0),
        plan: DockPlan::default(),
    });
    for call in 1..64 {
        assert_eq!(
            rig.ask(Intent::Dock {
                call: CallId(call),
                plan: DockPlan::default()
            }),
            []
        );
    }
    let acts = rig.ask(Intent::Dock {
        call: CallId(64),
        plan: DockPlan::default(),
    });
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
