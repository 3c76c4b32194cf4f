//! The tracks pass from one behaviour to another without a gap or a jump: examples with numbers.

use std::time::Duration;

use proptest::prelude::*;
use tokio::time::Instant;

use super::*;
use crate::robot::{EndReason, MotionId, Priority};

const MS: Duration = Duration::from_millis(1);
const PATROL: BehaviourId = BehaviourId(0);
const AVOID: BehaviourId = BehaviourId(1);

fn priority(by: BehaviourId) -> Priority {
    match by {
        AVOID => Priority(10),
        BehaviourId(other) => Priority(i16::from(other > 2)),
    }
}

/// A watchdog online, and a clock that only moves when told.
struct Rig {
    dog: Watchdog,
    now: Instant,
    motions: u64,
}

impl Rig {
    fn new() -> Rig {
        let now = Instant::now();
        let mut dog = Watchdog::new(Limits::default(), now);
        let power = Power {
            percent: 90,
            charging: false,
        };
        dog.handle(
            Fact::LinkUp {
                docked: false,
                power,
            },
            now,
        );
        let now = now + 100 * MS;
        let motions = 0;
        Rig { dog, now, motions }
    }

    fn fact(&mut self, by: BehaviourId, intent: Intent) -> Fact {
        let priority = priority(by);
        Fact::Asked {
            by,
            priority,
            intent,
        }
    }

    fn claim(&mut self, by: BehaviourId, percent: f64, duration: Option<Duration>) -> Fact {
        self.motions += 1;
        let intent = Intent::Move {
            motion: MotionId(self.motions),
            setpoint: Setpoint::from_percent(percent, percent).unwrap(),
            duration,
        };
        self.fact(by, intent)
    }

    fn handle(&mut self, fact: Fact) -> Vec<Act> {
        self.dog.handle(fact, self.now)
    }

    fn drive(&mut self, by: BehaviourId, percent: f64) -> Vec<Act> {
        let claim = self.claim(by, percent, None);
        self.handle(claim)
    }

    /// Lets time pass as the pilot does; these hosts show life.
    fn pass(&mut self, span: Duration, alive: &[BehaviourId]) -> Vec<Act> {
        let end = self.now + span;
        let mut acts = Vec::new();
        while self.now < end {
            let due = self.dog.next_deadline().unwrap_or(end).max(self.now);
            self.now = due.min(self.now + 50 * MS).min(end);
            for &by in alive {
                self.dog.apply(Fact::Alive(by), self.now);
            }
            acts.extend(self.dog.poll(self.now));
            if due == self.now {
                self.now += MS;
            }
        }
        acts
    }
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
    let mut rig = Rig::new();
    rig.drive(PATROL, 40.0);
    rig.now += 100 * MS;
    let acts = rig.drive(AVOID, -50.0);
    assert_eq!(moves(&acts), [-45]);
    rig.now += 100 * MS;
    let release = rig.fact(
        AVOID,
        Intent::Release {
            motion: MotionId(2),
        },
    );
    rig.dog.apply(release, rig.now);
    let again = rig.claim(AVOID, -20.0, None);
    let acts = rig.handle(again);
    assert_eq!(moves(&acts), [-18]);
    assert_eq!(moves(&rig.pass(150 * MS, &[PATROL, AVOID])), [] as [i8; 0]);
}

#[test]
fn a_silent_host_that_stands_by_is_ended_and_the_one_that_drives_is_not_disturbed() {
    let mut rig = Rig::new();
    let mut acts = rig.drive(PATROL, 40.0);
    rig.now += 100 * MS;
    acts.extend(rig.drive(AVOID, -50.0));
    acts.extend(rig.pass(3000 * MS, &[AVOID]));
    assert_eq!(moves(&acts), [36, -45]);
    assert!(acts.contains(&Act::Kill(PATROL, EndReason::Cpu)));
}

#[test]
fn a_silent_driver_is_stopped_before_the_lower_takes_over() {
    let mut rig = Rig::new();
    let mut acts = rig.drive(PATROL, 40.0);
    rig.now += 100 * MS;
    acts.extend(rig.drive(AVOID, -50.0));
    acts.extend(rig.pass(3000 * MS, &[PATROL]));
    assert_eq!(moves(&acts), [36, -45, 0, 36]);
    assert!(acts.contains(&Act::Kill(AVOID, EndReason::Cpu)));
}

#[test]
fn a_silent_host_that_stands_by_does_not_get_the_tracks() {
    let mut rig = Rig::new();
    rig.drive(PATROL, 40.0);
    rig.now += 100 * MS;
    rig.drive(AVOID, -50.0);
    rig.pass(300 * MS, &[AVOID]);
    let release = rig.fact(
        AVOID,
        Intent::Release {
            motion: MotionId(2),
        },
    );
    assert_eq!(moves(&rig.handle(release)), [0]);
    assert_eq!(moves(&rig.drive(PATROL, 30.0)), [] as [i8; 0], "too soon");
    assert_eq!(moves(&rig.pass(50 * MS, &[PATROL])), [27], "alive again");
}

#[test]
fn a_handover_to_the_same_setpoint_sends_nothing() {
    let mut rig = Rig::new();
    rig.drive(PATROL, 40.0);
    rig.now += 100 * MS;
    assert_eq!(rig.drive(AVOID, 40.0), []);
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
        let mut rig = Rig::new();
        let behaviours = [0, 1, 2, 3].map(BehaviourId);
        for step in steps {
            let acts = match step {
                Step::Claim(by, power, ms) => {
                    let duration = ms.map(Duration::from_millis);
                    let claim = rig.claim(BehaviourId(by), f64::from(power) * 25.0, duration);
                    rig.handle(claim)
                }
                Step::Release(by, motion) => {
                    let release = rig.fact(BehaviourId(by), Intent::Release { motion: MotionId(motion) });
                    rig.handle(release)
                }
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
        rig.pass(2000 * MS, &behaviours);
        prop_assert_eq!(rig.dog.moving(), !rig.dog.arbiter.setpoint().is_stop());
    }
}
