//! The tracks pass from one behaviour to another without a gap or a jump: examples with numbers.

use proptest::prelude::*;

use super::*;
use crate::robot::{EndReason, MotionId, Priority};

const PATROL: BehaviourId = BehaviourId(0);
const AVOID: BehaviourId = BehaviourId(1);

fn asked(by: BehaviourId, intent: Intent) -> Input {
    let priority = match by {
        AVOID => Priority(10),
        BehaviourId(other) => Priority(i16::from(other > 2)),
    };
    Input::Request(by, priority, intent)
}

fn claim(by: BehaviourId, motion: u64, percent: f64, duration: Option<Duration>) -> Input {
    let setpoint = Setpoint::from_percent(percent, percent).unwrap();
    let intent = Intent::Move {
        motion: MotionId(motion),
        setpoint,
        duration,
    };
    asked(by, intent)
}

fn release(by: BehaviourId, motion: u64) -> Input {
    let motion = MotionId(motion);
    asked(by, Intent::Release { motion })
}

/// The patrol drives at 40 %, then avoiding drives at this.
fn taken_over(percent: f64) -> (Rig, Vec<Act>) {
    let mut rig = Rig::online(90);
    let mut acts = rig.handle(claim(PATROL, 1, 40.0, None));
    rig.now += 100 * MS;
    acts.extend(rig.handle(claim(AVOID, 2, percent, None)));
    (rig, acts)
}

/// Lets time pass as the pilot does; these hosts show life.
fn pass(rig: &mut Rig, span: Duration, alive: &[BehaviourId]) -> Vec<Act> {
    let end = rig.now + span;
    let mut acts = Vec::new();
    while rig.now < end {
        let due = rig.dog.next_deadline().unwrap_or(end).max(rig.now);
        rig.now = due.min(rig.now + 50 * MS).min(end);
        for &by in alive {
            rig.dog.apply(Fact::Alive(by), rig.now);
        }
        acts.extend(rig.dog.poll(rig.now));
        if due == rig.now {
            rig.now += MS;
        }
    }
    acts
}

/// The MOVEs, without repetitions.
fn moves(acts: &[Act]) -> Vec<i8> {
    let left = |act: &Act| match act.command() {
        Some(Command::Move { left, .. }) => Some(left),
        _ => None,
    };
    let mut moves: Vec<i8> = acts.iter().filter_map(left).collect();
    moves.dedup();
    moves
}

#[test]
fn releasing_and_retaking_the_tracks_at_once_never_lets_the_lower_drive() {
    let (mut rig, acts) = taken_over(-50.0);
    assert_eq!(moves(&acts), [36, -45]);
    rig.now += 100 * MS;
    release(AVOID, 2).apply(&mut rig.dog, rig.now);
    let acts = rig.handle(claim(AVOID, 3, -20.0, None));
    assert_eq!(moves(&acts), [-18]);
    assert!(moves(&pass(&mut rig, 150 * MS, &[PATROL, AVOID])).is_empty());
}

#[test]
fn a_silent_host_that_stands_by_is_ended_and_the_one_that_drives_is_not_disturbed() {
    let (mut rig, mut acts) = taken_over(-50.0);
    acts.extend(pass(&mut rig, 3000 * MS, &[AVOID]));
    assert_eq!(moves(&acts), [36, -45]);
    assert!(acts.contains(&Act::Kill(PATROL, EndReason::Cpu)));
}

#[test]
fn a_silent_driver_is_stopped_before_the_lower_takes_over() {
    let (mut rig, mut acts) = taken_over(-50.0);
    acts.extend(pass(&mut rig, 3000 * MS, &[PATROL]));
    assert_eq!(moves(&acts), [36, -45, 0, 36]);
    assert!(acts.contains(&Act::Kill(AVOID, EndReason::Cpu)));
}

#[test]
fn a_silent_host_that_stands_by_does_not_get_the_tracks() {
    let (mut rig, _) = taken_over(-50.0);
    pass(&mut rig, 300 * MS, &[AVOID]);
    assert_eq!(moves(&rig.handle(release(AVOID, 2))), [0]);
    let acts = rig.handle(claim(PATROL, 3, 30.0, None));
    assert!(moves(&acts).is_empty(), "too soon");
    assert_eq!(
        moves(&pass(&mut rig, 50 * MS, &[PATROL])),
        [27],
        "alive again"
    );
}

#[test]
fn a_handover_to_the_same_setpoint_sends_nothing() {
    let (mut rig, acts) = taken_over(40.0);
    assert_eq!(sent(&acts).len(), 1);
    assert_eq!(rig.handle(Fact::Gone(AVOID)), []);
}

/// What may happen to three behaviours.
#[derive(Debug, Clone)]
enum Step {
    Claim(u16, i32, Option<u64>),
    Release(u16, u64),
    Gone(u16),
    Pass(u64),
}

fn step() -> impl Strategy<Value = Step> {
    prop_oneof![
        4 => (0u16..4, -4i32..=4, prop::option::weighted(0.4, 1u64..2_000))
            .prop_map(|(by, power, ms)| Step::Claim(by, power, ms)),
        2 => (0u16..4, 1u64..30).prop_map(|(by, motion)| Step::Release(by, motion)),
        1 => (0u16..4).prop_map(Step::Gone),
        2 => (0u64..700).prop_map(Step::Pass),
    ]
}

proptest! {
    #[test]
    fn the_robot_is_sent_the_drivers_setpoint_and_a_stop_only_without_a_driver(
        steps in prop::collection::vec(step(), 1..60),
    ) {
        let mut rig = Rig::online(90);
        let mut motions = 0;
        let behaviours = [0, 1, 2, 3].map(BehaviourId);
        for step in steps {
            let acts = match step {
                Step::Claim(by, power, ms) => {
                    let duration = ms.map(Duration::from_millis);
                    motions += 1;
                    rig.handle(claim(BehaviourId(by), motions, f64::from(power) * 25.0, duration))
                }
                Step::Release(by, motion) => rig.handle(release(BehaviourId(by), motion)),
                Step::Gone(by) => rig.handle(Fact::Gone(BehaviourId(by))),
                Step::Pass(ms) => {
                    let end = rig.now + Duration::from_millis(ms);
                    while rig.now < end {
                        rig.now += MS * 10;
                        behaviours.iter().for_each(|&by| rig.dog.apply(Fact::Alive(by), rig.now));
                        let acts = rig.dog.poll(rig.now);
                        let wanted = rig.dog.arbiter.setpoint().left.get();
                        prop_assert!(moves(&acts).iter().all(|&sent| sent == wanted), "{:?}", acts);
                    }
                    vec![]
                }
            };
            let wanted = rig.dog.arbiter.setpoint().left.get();
            prop_assert!(moves(&acts).iter().all(|&sent| sent == wanted), "{:?}: {:?}", step, acts);
        }
        // Long enough for the accumulated spacing between MOVE messages.
        pass(&mut rig, 2000 * MS, &behaviours);
        prop_assert_eq!(rig.dog.moving(), !rig.dog.arbiter.setpoint().is_stop());
    }
}
