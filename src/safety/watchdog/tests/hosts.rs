//! Hosts that fall silent, and what they may ask.

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
fn no_time_that_a_host_may_send_breaks_the_clock() {
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
        rig.take(Fact::Engine(EngineReport::Docked));
        rig.ask(Intent::Undock {
            call: CallId(2),
            timeout: time,
        });
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
fn a_host_that_docks_without_end_fills_no_memory() {
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
    assert_eq!(told(&acts), [ended(1, MotionEnd::Done)]);
}
