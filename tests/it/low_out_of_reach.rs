//! A robot with a low battery that was out of reach, and drove on meanwhile, is sent home as soon as
//! it is in reach again. In virtual time, over seeds.

use std::time::Duration;

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::sim::{self, Fault, FaultKind, Timing};
use spykee::simulation::{self, Simulation};
use spykee::wire::{Command, Engage};
use tokio::time::{sleep, timeout};

use crate::fast::{behaviour, quiet_world};
use crate::rig::sized;

const OUTAGES: [u64; 4] = [1, 5, 12, 30];
/// From the moment at which the robot is in reach again to its BASE_FIND.
const LIMIT: Duration = Duration::from_secs(3);
const WATCH: Duration = Duration::from_secs(60);
const DRIVES: &str = "while true do robot.move(30, -20) task.wait(0.2) end";

/// When its battery becomes low.
#[derive(Debug, Clone, Copy)]
enum Low {
    /// In reach: it searches or drives elsewhere when it gets out of reach.
    Before,
    /// Out of reach, while a behaviour's motion goes on.
    Meanwhile,
}

/// How long after it is in reach again it hears BASE_FIND; `None`: not at all.
fn lateness(low: Low, out: u64, seed: u64) -> Option<Duration> {
    let options = simulation::Options {
        sim: sim::Options {
            faults: Some(vec![]),
            ..sim::Options::default()
        },
        seed,
        ..simulation::Options::default()
    };
    let mut rng = StdRng::seed_from_u64(seed);
    let lead = Duration::from_secs_f64(rng.random_range(2.0..12.0));
    let out = Duration::from_secs(out);
    let played = simulation::run(quiet_world(), options, async |simulation: &Simulation| {
        let robot = simulation.sim();
        robot.hide_station(true);
        let _run = simulation.start(vec![behaviour("drives", DRIVES, 0, seed)], None);
        let moves = |command: &Command| matches!(command, Command::Move { left: 1.., .. });
        robot.wait_heard(0, moves).await;
        if let Low::Before = low {
            robot.set_battery(15.0);
        }
        sleep(lead).await;
        robot.begin(Fault {
            timing: Timing {
                lasts: Some(out),
                ..Timing::default()
            },
            ..Fault::new(FaultKind::Reboot { forgets: false })
        });
        robot.set_battery(14.0);
        sleep(out).await;
        let from = robot.heard_count();
        let in_reach = simulation.now();
        let finds = |command: &Command| *command == Command::Engine(Engage::Dock);
        let found = timeout(WATCH, robot.wait_heard(from, finds)).await.ok()?;
        Some(robot.heard()[found].at - in_reach)
    });
    played.unwrap()
}

#[test]
fn a_low_robot_is_sent_home_within_three_seconds_of_being_in_reach_again() {
    let mut late = Vec::new();
    let mut longest = Duration::ZERO;
    for low in [Low::Before, Low::Meanwhile] {
        for out in OUTAGES {
            for seed in 1..=sized(2, 20) {
                match lateness(low, out, seed) {
                    Some(lateness) if lateness <= LIMIT => longest = longest.max(lateness),
                    lateness => late.push((low, out, seed, lateness)),
                }
            }
        }
    }
    println!("at most {longest:?}");
    assert!(late.is_empty(), "{} late: {late:?}", late.len());
}
