//! `spykee robot` and `spykee completions`: the real program with the simulated robot.

use std::io::Write;
use std::process::{Command as Process, Stdio};

use spykee::sim::{Fault, Firmware, Options, World};
use spykee::wire::{Command, Engage, FileChunk, Led, Sound};

use crate::rig::{QUIET_WORLD, Rig, assert_contains, command, docked, run_spykee};

async fn run_tool(rig: &Rig, args: &[&str]) -> (Option<i32>, String) {
    run_spykee(
        rig,
        &[&["robot"], args, &["--robot", &rig.address]].concat(),
    )
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn robot_tools_send_the_requested_commands() {
    let rig = Rig::quiet().await;
    let (code, text) = run_tool(&rig, &["info", "--json"]).await;
    let info: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!((code, info["uid"].as_str()), (Some(0), Some("SPYKEE0001")));
    assert_eq!(
        (info["battery"].as_u64(), info["docked"].as_bool()),
        (Some(90), Some(false))
    );
    assert!(run_tool(&rig, &["battery"]).await.1.contains("90 %"));
    for (args, wanted) in [
        (
            &["led", "flash", "on"][..],
            Command::Led {
                led: Led::Flash,
                on: true,
            },
        ),
        (&["play", "laser"], Command::Play(Sound::Laser)),
        (&["play", "--stop"], Command::StopSound),
        (&["volume", "30"], Command::Volume(30)),
    ] {
        let from = rig.sim.heard_count();
        assert_eq!(run_tool(&rig, args).await.0, Some(0), "{args:?}");
        rig.heard(from, |command| *command == wanted).await;
    }
    assert_eq!(run_tool(&rig, &["led", "nose", "on"]).await.0, Some(2));
    assert!(run_tool(&rig, &["log"]).await.1.contains("user connected"));
}

#[tokio::test(flavor = "multi_thread")]
async fn stop_ends_a_motion_that_another_program_left_behind() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("robot.move(50, 50)\ntask.wait(60)");
    rig.heard_motion(0).await;
    run.signal(rustix::process::Signal::KILL);
    run.status().await;
    let from = rig.sim.heard_count();
    let (code, text) = run_tool(&rig, &["stop"]).await;
    assert_eq!(code, Some(0), "{text}");
    let cancel = |command: &Command| *command == Command::Engine(Engage::CancelDock);
    let cancelled = rig.heard(from, cancel).await;
    assert!(
        rig.heard_stop(from).await < cancelled,
        "the first command is not a stop"
    );
    rig.heard_stop(cancelled).await;
    rig.sim.wait_state(|state| !state.moving()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn undock_and_dock_use_the_pilot_and_ctrl_c_ends_the_search_with_a_stop() {
    let world = docked();
    let rig = Rig::new(&world, Firmware::default()).await;
    let (code, text) = run_tool(&rig, &["undock"]).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(&text, &["off its station"]);
    rig.sim
        .wait_state(|state| !state.docked && !state.leaving)
        .await;
    rig.sim.hide_station(true);
    let from = rig.sim.heard_count();
    let mut run = rig.spykee(&["robot", "dock", "--robot", &rig.address]);
    let asked = rig.heard_dock(from).await;
    run.signal(rustix::process::Signal::INT);
    assert_eq!(run.code().await, Some(130));
    rig.heard_stop(asked).await;
    rig.sim
        .wait_state(|state| !state.searching && !state.moving())
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_with_a_low_battery_does_not_leave_the_station() {
    let world = docked().replace("level: 90", "level: 12");
    let rig = Rig::new(&world, Firmware::default()).await;
    assert_eq!(run_tool(&rig, &["undock"]).await.0, Some(5));
    let undock = Command::Engine(Engage::Undock);
    assert!(!rig.commands(0).contains(&undock));
}

#[tokio::test(flavor = "multi_thread")]
async fn settings_change_only_if_the_robot_is_named_and_secrets_are_never_shown() {
    let rig = Rig::quiet().await;
    let (_, text) = run_tool(&rig, &["config"]).await;
    assert_contains(&text, &["wifi-key", "***"]);
    let (_, json) = run_tool(&rig, &["wifi", "--json"]).await;
    assert!(!(text + &json).contains("made-up-key"));
    assert_contains(&json, &["\"essid\":\"home\""]);
    let set = ["config", "--set", "name=Anna"];
    assert_eq!(
        run_tool(&rig, &set).await.0,
        Some(2),
        "set without a confirmation"
    );
    let wrong = [&set[..], &["--yes-i-mean", "SPYKEE9"]].concat();
    assert_eq!(run_tool(&rig, &wrong).await.0, Some(2));
    let unlisted = ["config", "--set", "nmae=x", "--yes-i-mean", "SPYKEE0001"];
    assert_eq!(run_tool(&rig, &unlisted).await.0, Some(2));
    let sets = |command: &Command| matches!(command, Command::ConfigSet(_));
    assert!(!rig.commands(0).iter().any(sets), "nothing was sent");
    let right = [&set[..], &["--yes-i-mean", "SPYKEE0001"]].concat();
    let (code, text) = run_tool(&rig, &right).await;
    assert_eq!(code, Some(0), "{text}");
    rig.heard(0, |command| {
        *command == Command::ConfigSet("name=Anna".into())
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_snapshot_is_a_complete_picture_or_ends_with_3() {
    let rig = Rig::quiet().await;
    let (code, text) = run_tool(&rig, &["snapshot", "-o", "a.jpg"]).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(&text, &["320x240"]);
    let jpeg = std::fs::read(rig.folder().join("a.jpg")).unwrap();
    spykee::vision::validate_markers(&jpeg).unwrap();
    rig.sim.wait_state(|state| state.user.is_none()).await;
    let faults = rig.file("faults.yaml", "faults:\n  - { fault: truncated_frames }\n");
    let options = Options {
        faults: Some(Fault::load_list(&faults).unwrap()),
        ..Options::default()
    };
    let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
    let spoilt = Rig::with(world, options).await;
    let short = ["snapshot", "-o", "b.jpg", "--timeout", "1"];
    let (code, text) = run_tool(&spoilt, &short).await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["no intact frame"]);
    assert!(!spoilt.folder().join("b.jpg").exists());
    let (code, text) = run_tool(&rig, &["snapshot", "-o", "/no/such/folder.jpg"]).await;
    assert_eq!(code, Some(1), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_upload_arrives_complete_and_other_files_than_mp3_are_refused() {
    let rig = Rig::quiet().await;
    let mut frame = vec![0_u8; 417];
    frame[..4].copy_from_slice(&[0xFF, 0xFB, 0x90, 0x00]);
    let sound = frame.repeat(60);
    std::fs::write(rig.folder().join("s.mp3"), &sound).unwrap();
    rig.file("w.mp3", "RIFF no sound");
    assert_eq!(
        run_tool(&rig, &["upload-sound", "user0", "w.mp3"]).await.0,
        Some(2)
    );
    let (code, text) = run_tool(&rig, &["upload-sound", "user0", "s.mp3", "--json"]).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(&text, &["\"bytes\":25020"]);
    let chunks: Vec<FileChunk> = rig
        .commands(0)
        .into_iter()
        .filter_map(|command| match command {
            Command::File(chunk) => Some(chunk),
            _ => None,
        })
        .collect();
    let content: Vec<u8> = chunks
        .iter()
        .flat_map(|chunk| chunk.content().to_vec())
        .collect();
    assert!(content == sound && chunks.len() > 2);
    assert!(
        run_tool(&rig, &["log"])
            .await
            .1
            .contains("file 6 stored, 25020 bytes")
    );
    assert_eq!(
        run_tool(&rig, &["upload-sound", "firmware", "s.mp3"])
            .await
            .0,
        Some(2)
    );
}

#[test]
fn completions_exist_for_every_shell_and_do_not_show_the_host_command() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        let printed = command(&["completions", shell]);
        let text = printed.out;
        assert_eq!(printed.code, Some(0), "{shell}");
        assert!(text.contains("upload-sound"), "{shell}");
        assert!(!text.contains("__host"), "{shell}");
        if shell == "bash" {
            let mut bash = Process::new("bash")
                .arg("-n")
                .stdin(Stdio::piped())
                .spawn()
                .unwrap();
            bash.stdin
                .take()
                .unwrap()
                .write_all(text.as_bytes())
                .unwrap();
            assert!(bash.wait().unwrap().success());
        }
    }
}
