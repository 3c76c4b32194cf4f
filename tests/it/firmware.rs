//! Not all of the robot's firmware is known. The promises hold with each alternative of
//! `tests/firmware/`.

use std::path::{Path, PathBuf};

use spykee::sim::Firmware;
use spykee::wire::Command;
use tokio::time::timeout;

use super::sim::*;
use crate::rig::{Rig, assert_contains, run_in, sized};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware")
}

/// The files of the alternative firmwares.
fn matrix() -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder()).unwrap();
    let paths = files.map(|entry| entry.unwrap().path());
    let mut files: Vec<PathBuf> = paths
        .filter(|path| {
            path.extension()
                .is_some_and(|extension| extension == "yaml")
        })
        .collect();
    files.sort_unstable();
    files
}

fn firmware(name: &str) -> Firmware {
    Firmware::load(&folder().join(name)).unwrap()
}

#[test]
fn safety_promises_hold_with_every_firmware() {
    let scenarios = folder().join("safety_test.lua");
    let data = tempfile::tempdir().unwrap();
    let mut failed = Vec::new();
    for firmware in [None].into_iter().chain(matrix().iter().map(Some)) {
        let mut args = vec![
            "test",
            scenarios.to_str().unwrap(),
            "--seeds",
            sized("1", "2"),
        ];
        if let Some(file) = firmware {
            args.extend(["--firmware", file.to_str().unwrap()]);
        }
        let played = run_in(data.path(), &args);
        if played.code != Some(0) {
            failed.push(format!("{firmware:?}:\n{}", played.text()));
        }
    }
    assert!(matrix().len() >= 7, "{:?}", matrix());
    assert!(failed.is_empty(), "{}", failed.join("\n"));
}

#[tokio::test(start_paused = true)]
async fn a_move_during_a_search_ends_it_or_has_no_effect_or_moves_the_robot() {
    for (name, searches, turns) in [
        ("activate_undocks.yaml", false, true),
        ("ignores_moves.yaml", true, false),
        ("obeys_moves.yaml", true, true),
    ] {
        let handle = detached(free_playpen(), firmware(name));
        handle.hide_station(true);
        let mut client = connect(&handle).log_in().await;
        client.send(&[STAND, DOCK].concat()).await;
        let searching = handle.wait_state(|state| state.searching && state.moving());
        timeout(LIMIT, searching).await.unwrap();
        client.send(TURN_LEFT_90).await;
        let from = handle.wait_heard(0, |command| {
            *command
                == Command::Move {
                    left: -90,
                    right: 90,
                }
        });
        timeout(LIMIT, from).await.unwrap();
        tokio::time::sleep(std::time::Duration::from_secs(1)).await;
        let state = handle.state();
        assert_eq!(
            (state.searching, state.speeds.right > 0.3),
            (searches, turns),
            "{name}"
        );
        client.send(STAND).await;
        tokio::time::sleep(std::time::Duration::from_secs(1)).await;
        let state = handle.state();
        assert_eq!(
            (state.searching, state.moving()),
            (searches, searches),
            "{name}"
        );
        client.send(CANCEL).await;
        let still = handle.wait_state(|state| !state.searching && !state.moving());
        timeout(LIMIT, still).await.unwrap();
    }
}

#[tokio::test(start_paused = true)]
async fn a_move_right_after_charge_stop_may_end_the_undocking() {
    for (name, leaves) in [
        ("activate_undocks.yaml", false),
        ("ignores_moves.yaml", true),
    ] {
        let handle = detached(playpen(), firmware(name));
        let mut client = connect(&handle).log_in().await;
        client.send(&[UNDOCK, STAND].concat()).await;
        tokio::time::sleep(std::time::Duration::from_secs(8)).await;
        assert_eq!(!handle.state().docked, leaves, "{name}");
    }
}

#[tokio::test(start_paused = true)]
async fn engine_1_to_the_robot_undocks_it_or_has_no_effect() {
    for (name, leaves) in [("activate_undocks.yaml", true), ("obeys_moves.yaml", false)] {
        let handle = detached(playpen(), firmware(name));
        let mut client = connect(&handle).log_in().await;
        client.send(LEFT_STATION).await;
        tokio::time::sleep(std::time::Duration::from_secs(8)).await;
        assert_eq!(!handle.state().docked, leaves, "{name}");
    }
}

#[tokio::test(start_paused = true)]
async fn late_power_reports_an_earlier_level() {
    let handle = detached(playpen(), firmware("late_power.yaml"));
    let mut client = connect(&handle);
    client.send(LOGIN).await;
    client.next_of_kind(11).await;
    let login = handle.state().time;
    assert_eq!(client.next_of_kind(3).await[5], 0xA6); // -90
    let first = handle.state().time;
    let seconds = |time: std::time::Duration| time.as_secs_f64();
    assert!(seconds(first - login) > 1.9, "{login:?} {first:?}");
    handle.set_battery(50.0);
    assert_eq!(client.next_of_kind(3).await[5], 0xCE); // -50
    let told = handle.state().time;
    assert!(
        (3.8..5.0).contains(&seconds(told - first)),
        "{first:?} {told:?}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unusable_firmware_is_reported_with_its_place() {
    let rig = Rig::quiet().await;
    rig.file("f.yaml", "power_late: 1\nsearch_limt: 3\n");
    rig.file("good.yaml", "move_while_searching: ignored\n");
    rig.file("script.lua", "print('ran')\n");
    for arguments in [
        &["sim", "--listen", "127.0.0.1:0", "--firmware", "f.yaml"][..],
        &["run", "script.lua", "--sim", "--firmware", "f.yaml"],
        &[
            "run",
            "script.lua",
            "--sim",
            "--fast",
            "--firmware",
            "f.yaml",
        ],
    ] {
        let mut run = rig.spykee(arguments);
        assert_eq!(run.code().await, Some(2), "{}", run.text());
        let told = "f.yaml:2:1: unknown field `search_limt`";
        assert_contains(&run.text(), &[told]);
        assert_contains(&run.text(), &["did you mean `search_limit`?"]);
    }
    let mut run = rig.spykee(&[
        "run",
        "script.lua",
        "--sim",
        "--fast",
        "--firmware",
        "good.yaml",
    ]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let mut run = rig.spykee(&[
        "run",
        "script.lua",
        "--robot",
        "127.0.0.1:9",
        "--firmware",
        "good.yaml",
    ]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["--firmware needs --sim"]);
}
