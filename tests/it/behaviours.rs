//! Tests that each ready-made behaviour does what its first comment says, in the simulator.

use std::path::Path;

use spykee::sim::{Firmware, State, World};
use spykee::wire::{Command, Led, Sound};
use tokio::time::timeout;

use crate::rig::{Rig, Run, WAIT_LIMIT};

fn behaviour(rig: &Rig, name: &str) -> Run {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("behaviours")
        .join(name);
    rig.spykee(&[
        "run",
        path.to_str().unwrap(),
        "--robot",
        &rig.address,
        "--seed",
        "3",
    ])
}

async fn until(rig: &Rig, what: &str, run: &Run, wanted: impl Fn(&State) -> bool) -> State {
    let reached = timeout(WAIT_LIMIT * 3, rig.sim.wait_state(wanted)).await;
    reached.unwrap_or_else(|_| panic!("never {what}: {:?}\n{}", rig.sim.state(), run.text()))
}

#[tokio::test(flavor = "multi_thread")]
async fn hello_lights_up_sounds_and_ends_without_driving() {
    let rig = Rig::quiet().await;
    let mut run = behaviour(&rig, "hello.lua");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let heard = rig.commands(0);
    for led in [Led::Left, Led::Flash, Led::Right] {
        assert!(
            heard.contains(&Command::Led { led, on: true }),
            "{led:?}: {heard:?}"
        );
    }
    assert!(heard.contains(&Command::Play(Sound::Robot)), "{heard:?}");
    assert!(heard.contains(&Command::Play(Sound::Laugh)), "{heard:?}");
    assert!(!heard.iter().any(crate::rig::moves), "{heard:?}");
    assert!(run.text().contains("my battery is at"), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn dock_now_brings_the_robot_to_its_station() {
    let rig = Rig::quiet().await;
    let mut run = behaviour(&rig, "dock_now.lua");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let state = rig.sim.state();
    assert!(state.docked && state.charging, "{state:?}");
    assert!(
        run.text().contains("on the station and charging"),
        "{}",
        run.text()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn dock_now_reports_when_it_cannot_dock() {
    let search_limit = std::time::Duration::from_millis(200);
    let firmware = Firmware {
        search_limit,
        ..Firmware::default()
    };
    let rig = Rig::new(crate::rig::QUIET_WORLD, firmware).await;
    rig.sim.hide_station(true);
    let mut run = behaviour(&rig, "dock_now.lua");
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    assert!(
        run.text().contains("could not dock: base_not_found"),
        "{}",
        run.text()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn follow_colour_drives_up_to_the_ball_and_stops_in_front_of_it() {
    let world = "
name: one ball
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
balls: [ { at: [5, 6.5], colour: red } ]
start: { at: [3, 4], heading_degrees: 0 }
";
    let rig = Rig::new(world, Firmware::default()).await;
    let run = behaviour(&rig, "follow_colour.lua");
    let distance = |state: &State| (state.pose.x - 5.0).hypot(state.pose.y - 6.5);
    assert!(distance(&rig.sim.state()) > 3.0);
    until(&rig, "near the ball", &run, |state| distance(state) < 0.8).await;
    let state = until(&rig, "at rest", &run, |state| {
        distance(state) < 0.8 && !state.moving()
    })
    .await;
    assert!(distance(&state) > 0.2, "{state:?}");
    assert!(run.text().contains("following"), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn patrol_drives_photographs_docks_charges_and_goes_again() {
    let rig = Rig::with_world(World::default_world(), Firmware::default()).await;
    let run = behaviour(&rig, "patrol.lua");
    let start = rig.sim.state().pose;
    until(&rig, "on its way", &run, |state| {
        (state.pose.x - start.x).hypot(state.pose.y - start.y) > 0.5
    })
    .await;
    run.says("I see").await;
    rig.sim.set_battery(32.0);
    until(&rig, "on its station", &run, |state| {
        state.docked && state.charging
    })
    .await;
    rig.sim.set_battery(74.0);
    until(&rig, "out again", &run, |state| {
        !state.docked && state.moving()
    })
    .await;
    let pictures = std::fs::read_dir(rig.folder().join("spykee-data/patrol"))
        .unwrap()
        .count();
    assert!(pictures > 0);
}

/// Plays the scenarios that are quick; `scripts/score-behaviours` plays all of them with 20 seeds.
#[test]
fn ready_behaviours_pass_their_scenarios() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("behaviours");
    let pictures = tempfile::tempdir().unwrap();
    let played = std::process::Command::new(env!("CARGO_BIN_EXE_spykee"))
        .args(["test", "--seed", "1", "--pictures"])
        .arg(pictures.path())
        .args(
            ["patrol", "dock_now", "follow_colour"]
                .map(|name| home.join(format!("{name}_test.lua"))),
        )
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&played.stdout);
    assert_eq!(played.status.code(), Some(0), "{said}");
    assert!(said.contains(" runs passed; "), "{said}");
}
