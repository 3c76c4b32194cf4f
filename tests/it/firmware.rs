//! Not all of the robot's firmware is known. The promises hold with each alternative of
//! `tests/firmware/`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use spykee::sim::{Fault, Firmware, Handle, Options, ReceivedCommand, Server};
use spykee::wire::Command;
use tokio::io::DuplexStream;
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
    assert!(matrix().len() >= 8, "{:?}", matrix());
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
        tokio::time::sleep(Duration::from_secs(1)).await;
        let state = handle.state();
        assert_eq!(
            (state.searching, state.speeds.right > 0.3),
            (searches, turns),
            "{name}"
        );
        client.send(STAND).await;
        tokio::time::sleep(Duration::from_secs(1)).await;
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
        tokio::time::sleep(Duration::from_secs(8)).await;
        assert_eq!(!handle.state().docked, leaves, "{name}");
    }
}

#[tokio::test(start_paused = true)]
async fn engine_1_to_the_robot_undocks_it_or_has_no_effect() {
    for (name, leaves) in [("activate_undocks.yaml", true), ("obeys_moves.yaml", false)] {
        let handle = detached(playpen(), firmware(name));
        let mut client = connect(&handle).log_in().await;
        client.send(LEFT_STATION).await;
        tokio::time::sleep(Duration::from_secs(8)).await;
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
    let seconds = |time: Duration| time.as_secs_f64();
    assert!(seconds(first - login) > 1.9, "{login:?} {first:?}");
    handle.set_battery(50.0);
    assert_eq!(client.next_of_kind(3).await[5], 0xCE); // -50
    let told = handle.state().time;
    assert!(
        (3.8..5.0).contains(&seconds(told - first)),
        "{first:?} {told:?}"
    );
}

const CONFIG_QUERY: &[u8] = b"PK\x0D\x00\x00";

fn slow(commands_per_second: f64, queue: Option<usize>) -> Firmware {
    Firmware {
        commands_per_second: Some(commands_per_second),
        queue,
        ..Firmware::default()
    }
}

/// Waits until the robot has executed this many commands, the login included.
async fn executed(handle: &Handle, count: usize) -> Vec<ReceivedCommand> {
    let executed = timeout(LIMIT, handle.wait_heard(count - 1, |_| true)).await;
    assert_eq!(executed, Ok(count - 1));
    handle.heard_since(1)
}

#[tokio::test(start_paused = true)]
async fn a_slow_robot_executes_one_command_a_period_in_order_and_answers_then() {
    let handle = detached(free_playpen(), firmware("slow_queue.yaml"));
    let mut client = connect(&handle).log_in().await;
    let commands = [TURN_LEFT_90, STAND, TURN_LEFT_90, STAND, POWER_QUERY];
    client.send(&commands.concat()).await;
    timeout(LIMIT, handle.wait_state(|state| state.queued == 4))
        .await
        .unwrap();
    let sent = handle.heard_since(1)[0].received;
    client.next_of_kind(3).await;
    let heard = executed(&handle, 6).await;
    for (place, heard) in heard.iter().enumerate() {
        assert_eq!(heard.received, sent);
        assert_eq!(heard.at - sent, Duration::from_millis(200) * place as u32);
    }
    assert_eq!(heard[4].command, Command::PowerQuery);
    // What the robot reports by itself is not late, and an idle robot executes at once.
    handle.set_battery(80.0);
    assert_eq!(client.next_of_kind(3).await[5], 80);
    tokio::time::sleep(Duration::from_secs(1)).await;
    client.send(STAND).await;
    let last = executed(&handle, 7).await.pop().unwrap();
    assert_eq!(last.received, last.at);
}

/// Sends so many commands; returns for how long each waited, in ms.
async fn waits(handle: &Handle, client: &mut Client<DuplexStream>, count: usize) -> Vec<u128> {
    let from = handle.heard_count();
    client.send(&STAND.repeat(count)).await;
    let last = timeout(LIMIT, handle.wait_heard(from + count - 1, |_| true)).await;
    assert_eq!(last, Ok(from + count - 1));
    let heard = handle.heard_since(from);
    let waited = heard.iter().map(|heard| heard.at - heard.received);
    waited.map(|waited| waited.as_millis()).collect()
}

#[tokio::test(start_paused = true)]
async fn a_program_that_is_slow_for_a_while_is_as_fast_as_before_afterwards() {
    let fault = "faults: [{ fault: slow_program, commands_per_second: 2, after: 1, for: 10 }]";
    for usual in [None, Some(5.0)] {
        let options = Options {
            faults: Some(Fault::list_from_yaml(fault, "slow").unwrap()),
            firmware: Firmware {
                commands_per_second: usual,
                ..Firmware::default()
            },
            ..Options::default()
        };
        let server = Server::detached(free_playpen(), options);
        let handle = server.handle();
        tokio::spawn(server.run());
        let mut client = connect(&handle).log_in().await;
        let before = waits(&handle, &mut client, 3).await;
        tokio::time::sleep(Duration::from_secs(1)).await;
        assert_eq!(waits(&handle, &mut client, 3).await, [0, 500, 1000]);
        // What still waits at its end, of work for a minute, is executed at the usual pace.
        let waited = waits(&handle, &mut client, 120).await;
        assert!(
            waited.last().is_some_and(|last| *last < 35_000),
            "{waited:?}"
        );
        tokio::time::sleep(Duration::from_secs(1)).await;
        let after = waits(&handle, &mut client, 3).await;
        let period = usual.map_or(0, |rate| (1000.0 / rate) as u128);
        assert_eq!(before, [0, period, 2 * period]);
        assert_eq!(after, before);
    }
}

#[tokio::test(start_paused = true)]
async fn a_full_queue_is_not_read_until_it_has_a_place() {
    let handle = detached(free_playpen(), slow(2.0, Some(3)));
    let mut client = connect(&handle).log_in().await;
    client.send(&STAND.repeat(10)).await;
    tokio::time::sleep(Duration::from_millis(100)).await;
    assert_eq!(handle.state().queued, 3);
    let heard = executed(&handle, 11).await;
    let waited: Vec<u128> = heard
        .iter()
        .map(|heard| (heard.at - heard.received).as_millis())
        .collect();
    assert_eq!(
        waited,
        [0, 500, 1000, 1500, 1500, 1500, 1500, 1500, 1500, 1500]
    );
}

#[tokio::test(start_paused = true)]
async fn what_was_received_is_executed_after_its_connection_and_before_the_next_ones_commands() {
    let handle = detached(free_playpen(), slow(5.0, Some(8)));
    let mut first = connect(&handle).log_in().await;
    let commands = [
        STAND,
        STAND,
        STAND,
        TURN_LEFT_90,
        TURN_LEFT_90,
        CONFIG_QUERY,
    ];
    first.send(&commands.concat()).await;
    timeout(LIMIT, handle.wait_state(|state| state.queued == 5))
        .await
        .unwrap();
    drop(first);
    timeout(LIMIT, handle.wait_state(|state| state.user.is_none()))
        .await
        .unwrap();
    let login = handle.state().time;
    let mut second = connect(&handle).log_in().await;
    assert!(handle.state().time - login < Duration::from_millis(100));
    second.send(&[STAND, POWER_QUERY].concat()).await;
    timeout(LIMIT, handle.wait_state(|state| state.moving()))
        .await
        .unwrap();
    // The second client gets no answer to the question of the first one.
    assert_eq!(second.next().await.unwrap()[2], 3);
    timeout(LIMIT, handle.wait_state(|state| !state.moving()))
        .await
        .unwrap();
    assert_eq!(handle.state().queued, 0);
}

#[tokio::test(start_paused = true)]
async fn a_robot_may_report_power_only_by_itself() {
    let handle = detached(playpen(), firmware("late_power.yaml"));
    let mut client = connect(&handle).log_in().await;
    client.send(&[POWER_QUERY, CONFIG_QUERY].concat()).await;
    assert_eq!(client.next().await.unwrap()[2], 13, "the next question is");
    client.next_of_kind(3).await;
    assert!(handle.state().time > Duration::from_secs(25));
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
        let told = "f.yaml:2:1: unknown key `search_limt`";
        assert_contains(&run.text(), &[told]);
        assert_contains(&run.text(), &["did you mean 'search_limit'?"]);
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
