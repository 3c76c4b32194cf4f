//! Hours of unattended running with all kinds of faults; `scripts/soak` plays any number of hours.

use std::path::Path;
use std::time::Duration;

use spykee::agent::Behaviour;
use spykee::behaviour::{Launch, Library};
use spykee::lab::{self, Lab, Recorder};
use spykee::robot::Priority;
use spykee::safety::{Limits, Rescue};
use spykee::script;
use spykee::sim::{Firmware, Pose, World};
use tokio::time::timeout;

use crate::rig::in_a_process_of_its_own;

#[path = "../soak/mod.rs"]
mod weeks;

#[test]
fn hours_with_faults_keep_every_promise() {
    in_a_process_of_its_own("soak::hours_with_faults");
}

#[test]
#[ignore = "the test above runs it"]
fn hours_with_faults() {
    let other = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware/all_other.yaml");
    let other = Firmware::load(&other).unwrap();
    let firmwares = std::iter::repeat_n(Firmware::default(), 3).chain([other]);
    let mut total = weeks::Ledger::default();
    for (seed, firmware) in (1..).zip(firmwares) {
        let folder = tempfile::tempdir().unwrap();
        let ledger = weeks::soak(1, seed, &firmware, folder.path(), &mut |_, _| {});
        println!("seed {seed}: {}", ledger.summary());
        total.add(&format!("seed {seed}"), ledger);
    }
    assert!(total.is_kept(), "\n{total}");
    let untested = total.untested(&weeks::CORE);
    assert!(
        untested.is_empty(),
        "never put to the test: {untested:?}\n{total}"
    );
}

/// Places beside the station from which the soak's world hides its beacon, on both sides, each with
/// a heading.
const BLIND: [(f64, f64, f64); 2] = [(0.35, 4.0, -1.15), (0.4, 0.9, 0.5)];

/// Starts there with a low battery and an idle behaviour; returns whether the robot charges within
/// ten minutes, and how often the watchdog did `does`.
fn comes_home_from((x, y, heading): (f64, f64, f64), limits: &Limits, does: &str) -> (bool, usize) {
    let world = World::from_yaml(include_str!("../soak/world.yaml"), "soak").unwrap();
    let (told, events) = std::sync::mpsc::sync_channel(10_000);
    let options = lab::Options {
        events: Some(Recorder::new(move |event| drop(told.try_send(event)))),
        limits: limits.clone(),
        ..lab::Options::default()
    };
    let idle = Behaviour {
        priority: Priority(0),
        launch: Launch {
            source: "task.wait(3600)".into(),
            options: script::Options::new("idle", "idle.lua"),
            library: Library::default(),
        },
        checked: false,
        restart: "never".parse().unwrap(),
        reloads: None,
    };
    let home = lab::run(world, options, async |lab: &Lab| {
        lab.sim().place(Pose { x, y, heading });
        lab.sim().set_battery(19.0);
        let run = lab.start(vec![idle], None);
        let home = lab.sim().wait_state(|state| state.charging);
        let home = timeout(Duration::from_secs(600), home).await.is_ok();
        run.stop();
        home && run.outcome().await.is_ok()
    });
    let done = |event: &lab::Event| event.text.contains(does);
    (home.unwrap(), events.iter().filter(done).count())
}

#[test]
fn a_low_robot_beside_its_station_comes_home_although_it_cannot_find_it_from_there() {
    let blind = Limits {
        rescue: Rescue::Off,
        ..Limits::default()
    };
    for place in BLIND {
        for (limits, does) in [
            (&blind, "drives short leg"),
            (&Limits::default(), "a rescue behaviour may drive"),
        ] {
            let (home, times) = comes_home_from(place, limits, does);
            assert!(home && times > 0, "from {place:?}: {does} {times} times");
        }
    }
}
