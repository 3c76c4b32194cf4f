//! Requests of other programs to an active run, through its private socket.

use std::io::Write as _;
use std::os::unix::net::UnixStream;

use rustix::process::Signal;
use spykee::sim::Firmware;
use spykee::wire::{Command, Engage, Led, Sound};
use tokio::time::timeout;

use crate::rig::{
    QUIET_WORLD, Rig, Run, Stopwatch, WAIT_LIMIT, assert_contains, docked, moves, run_spykee,
    succeed,
};

const DRIVE: &str = "while true do robot.move(30, 30, 0.5) end";
const IDLE: &str = "task.wait(600)";

/// Starts a run and waits until it is connected to the robot; its socket exists then.
async fn running(rig: &Rig, script: &str) -> Run {
    let run = rig.run(script);
    run.says("connected").await;
    run
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|_| panic!("{text}"))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_reports_its_state_and_carries_out_requests() {
    let rig = Rig::quiet().await;
    let run = running(&rig, IDLE).await;
    let user = rig.sim.state().user;
    let (code, text) = run_spykee(&rig, &["status", "--json"]).await;
    let status = json(&text)[0].clone();
    assert_eq!(
        (code, status["target"].as_str()),
        (Some(0), Some(&*rig.address))
    );
    assert_eq!(status["behaviours"][0]["name"].as_str(), Some("script"));
    assert_eq!(status["place"].as_str(), Some("off its station"));
    assert_eq!(status["state"].as_str(), Some("free"));
    assert_eq!(status["battery"]["percent"].as_u64(), Some(90));
    assert_eq!(
        status["process"].as_i64(),
        Some(run.pid().as_raw_nonzero().get().into())
    );
    let (code, text) = run_spykee(&rig, &["status"]).await;
    assert_eq!(code, Some(0));
    assert_contains(&text, &["90 %", "script"]);
    // A volume that the robot already has is not sent again.
    for (robot, (volume, told)) in [
        (&["--robot", &*rig.address][..], ("30", 30)),
        (&[], ("40", 40)),
    ] {
        let ask = |args: &[&'static str]| [&["robot"], args, robot].concat();
        let text = succeed(&rig, &ask(&["battery"])).await;
        assert_contains(&text, &["90 %"]);
        let (code, text) = run_spykee(&rig, &ask(&["battery", "--json"])).await;
        assert_eq!((code, json(&text)["percent"].as_u64()), (Some(0), Some(90)));
        assert!(json(&text).get("minutes_left").is_some(), "{text}");
        let (_, text) = run_spykee(&rig, &ask(&["info", "--json"])).await;
        assert_eq!(json(&text)["uid"].as_str(), Some("SPYKEE0001"), "{text}");
        succeed(&rig, &ask(&["snapshot", "-o", "seen.jpg"])).await;
        let jpeg = std::fs::read(rig.folder().join("seen.jpg")).unwrap();
        spykee::vision::validate_markers(&jpeg).unwrap();
        for (args, wanted) in [
            (&["play", "laser"][..], Command::Play(Sound::Laser)),
            (&["play", "--stop"], Command::StopSound),
            (&["volume", volume], Command::Volume(told)),
        ] {
            let from = rig.sim.heard_count();
            succeed(&rig, &ask(args)).await;
            rig.heard(from, |command| *command == wanted).await;
        }
    }
    for on in [true, false] {
        let from = rig.sim.heard_count();
        let word = if on { "on" } else { "off" };
        succeed(&rig, &["robot", "led", "flash", word]).await;
        let led = Led::Flash;
        rig.heard(from, |command| *command == Command::Led { led, on })
            .await;
    }
    succeed(&rig, &["robot", "undock"]).await;
    let (code, text) = run_spykee(&rig, &["robot", "log", "--robot", &rig.address]).await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["a run uses the robot"]);
    assert_eq!(rig.sim.state().user, user, "the run has lost its link");
    assert!(
        run.text().matches("connected").count() == 1,
        "{}",
        run.text()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sound_file_is_played_through_a_run_and_without_one() {
    let rig = Rig::quiet().await;
    let mut wav =
        b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0\x01\0\x01\0\x80\x3e\0\0\0\0\0\0\0\0\x10\0".to_vec();
    wav.extend(b"data\0\x7d\0\0");
    wav.extend([7; 32_000]);
    std::fs::write(rig.folder().join("hello.wav"), &wav).unwrap();
    let spoken = |from: usize| -> usize {
        let heard = rig.commands(from).into_iter();
        heard
            .map(|command| match command {
                Command::Audio(samples) => samples.len(),
                _ => 0,
            })
            .sum()
    };
    let say = ["robot", "say", "hello.wav", "--robot", &rig.address];
    succeed(&rig, &say).await;
    assert_eq!(spoken(0), 32_000);
    let _run = running(&rig, IDLE).await;
    let from = rig.sim.heard_count();
    succeed(&rig, &say).await;
    assert_eq!(spoken(from), 32_000);
    rig.file("no.wav", "RIFF");
    let (code, text) = run_spykee(&rig, &["robot", "say", "no.wav"]).await;
    assert_eq!(code, Some(2), "{text}");
    assert_contains(&text, &["not a WAV file"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn stop_stops_what_a_run_drives_and_ends_the_run() {
    let rig = Rig::quiet().await;
    let mut run = running(&rig, DRIVE).await;
    let moving = rig.heard_motion(0).await;
    let text = succeed(&rig, &["robot", "stop"]).await;
    assert_contains(&text, &["has executed the stop"]);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    let stopped = rig.heard_stop(moving).await;
    assert!(!rig.commands(stopped).iter().any(moves));
    assert!(!rig.sim.state().moving());
    let text = succeed(&rig, &["status"]).await;
    assert_contains(&text, &["no run is active"]);
    let sockets = rig.folder().join("spykee-data/.run");
    assert!(!sockets.exists(), "the folder of the sockets is left");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_config_that_cannot_be_used_does_not_prevent_a_stop() {
    let rig = Rig::quiet().await;
    let mut run = running(&rig, DRIVE).await;
    let moving = rig.heard_motion(0).await;
    rig.file("spykee.yaml", "watchdog: { lo: 25 }\n");
    let (code, text) = run_spykee(&rig, &["robot", "stop"]).await;
    let told = text.contains("unknown key") && text.contains("has executed the stop");
    assert_eq!((code, told), (Some(0), true), "{text}");
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    let stopped = rig.heard_stop(moving).await;
    let stop = ["robot", "stop", "--robot", &rig.address];
    succeed(&rig, &stop).await;
    rig.heard_stop(stopped + 1).await;
    let (code, text) = run_spykee(&rig, &["robot", "stop"]).await;
    let told = text.contains("unknown key") && text.contains("--robot");
    assert_eq!((code, told), (Some(2), true), "{text}");

    rig.file("spykee.yaml", &format!("robot: {}\n", rig.address));
    let mut stop = rig.spykee_with(&["robot", "stop"], &[("SPYKEE_ROBOT", "http://x")]);
    let code = stop.code().await;
    let told = stop.text().contains("$SPYKEE_ROBOT: expected HOST");
    assert_eq!((code, told), (Some(0), true), "{}", stop.text());

    // The file is trusted no more than without the warning: it was found, not named.
    let remote = "remote: { url: 'http://127.0.0.1:9', token_file: /etc/passwd }\n";
    rig.file("spykee.yaml", remote);
    for environment in [&[("SPYKEE_ROBOT", "http://x")][..], &[]] {
        let mut stop = rig.spykee_with(&["robot", "stop"], environment);
        let code = stop.code().await;
        let told = stop.text().contains("was found in the current folder");
        assert_eq!((code, told), (Some(2), true), "{}", stop.text());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn stop_overrides_the_watchdogs_search_and_reports_the_low_battery() {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let mut run = running(&rig, DRIVE).await;
    rig.heard_motion(0).await;
    rig.sim.set_battery(12.0);
    rig.heard_dock(0).await;
    let text = succeed(&rig, &["robot", "stop"]).await;
    assert_contains(&text, &["the battery is low"]);
    assert_eq!(run.code().await, Some(5), "{}", run.text());
    let tracks = |command: &Command| matches!(command, Command::Move { .. } | Command::Engine(_));
    let last = rig.commands(0).into_iter().rfind(tracks);
    assert_eq!(last, Some(Command::STOP));
    rig.stands_still().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn docking_by_a_person_has_the_highest_priority_and_ends_with_the_request() {
    let rig = Rig::near_home().await;
    rig.file("idle.lua", IDLE);
    rig.file("drive.lua", DRIVE);
    let run = rig.spykee(&["run", "idle.lua", "drive.lua", "--robot", &rig.address]);
    rig.heard_motion(0).await;
    rig.sim.hide_station(true);
    let mut dock = rig.spykee(&["robot", "dock"]);
    let asked = rig.heard_dock(0).await;
    run.says("the script was ended from outside").await;
    dock.signal(Signal::INT);
    assert_eq!(dock.code().await, Some(130), "{}", dock.text());
    let cancel = |command: &Command| *command == Command::Engine(Engage::CancelDock);
    let cancelled = rig.heard(asked, cancel).await;
    assert!(!rig.commands_between(asked, cancelled).iter().any(moves));
    // What drove has ended with the order, and drives again when a person starts it.
    succeed(&rig, &["behaviour", "start", "drive"]).await;
    rig.heard_motion(cancelled).await;
    rig.sim.hide_station(false);
    let (code, text) = run_spykee(&rig, &["robot", "dock", "--json"]).await;
    assert_eq!(code, Some(0), "{text} {}", run.text());
    assert_eq!(json(&text)["end"].as_str(), Some("done"));
    assert!(rig.sim.state().docked);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_of_which_a_docking_has_ended_the_last_behaviour_ends_on_the_station() {
    let rig = Rig::near_home().await;
    let mut run = running(&rig, DRIVE).await;
    rig.heard_motion(0).await;
    let text = succeed(&rig, &["robot", "dock"]).await;
    assert_contains(&text, &["on its station"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert!(rig.sim.state().docked);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_loop_that_drives_a_robot_on_its_station_is_told_why_it_stands() {
    let rig = Rig::new(&docked(), Firmware::default()).await;
    let script = "task.delay(2, function() script.stop() end) local loops = 0
        script.on_stop(function() print('loops ' .. loops) end)
        while true do robot.move(30, 30, 1) loops += 1 end";
    let mut run = rig.run(script);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    assert_eq!(text.matches("robot.undock() first").count(), 1, "{text}");
    let loops = text.lines().find_map(|line| line.split("loops ").nth(1));
    let loops = loops.and_then(|rest| rest.split_whitespace().next());
    let loops: u32 = loops.unwrap().parse().unwrap();
    assert!((1..=21).contains(&loops), "{text}");
    assert!(!rig.commands(0).iter().any(moves));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_with_a_low_robot_refuses_to_undock() {
    let world = docked().replace("level: 90", "level: 12");
    let rig = Rig::new(&world, Firmware::default()).await;
    let _run = running(&rig, IDLE).await;
    let (code, text) = run_spykee(&rig, &["robot", "undock"]).await;
    assert_eq!(code, Some(5), "{text}");
    let undock = Command::Engine(Engage::Undock);
    assert!(!rig.commands(0).contains(&undock));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_socket_of_a_killed_run_disturbs_nothing() {
    let rig = Rig::quiet().await;
    let mut run = running(&rig, IDLE).await;
    run.signal(Signal::KILL);
    run.status().await;
    let socket = rig
        .folder()
        .join("spykee-data/.run")
        .join(format!("{}.sock", run.pid().as_raw_nonzero()));
    assert!(socket.exists());
    let (code, text) = run_spykee(&rig, &["status", "--json"]).await;
    assert_eq!((code, &*text), (Some(0), "[]"));
    let free = rig.sim.wait_state(|state| state.user.is_none());
    timeout(WAIT_LIMIT, free).await.unwrap();
    let text = succeed(&rig, &["robot", "battery", "--robot", &rig.address]).await;
    assert_contains(&text, &["90 %"]);
    let _run = running(&rig, IDLE).await;
    assert!(!socket.exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn silent_or_invalid_clients_block_neither_the_robot_nor_other_clients() {
    let rig = Rig::quiet().await;
    let run = running(&rig, "robot.move(30, 30) task.wait(600)").await;
    rig.heard_motion(0).await;
    let name = format!("spykee-data/.run/{}.sock", run.pid().as_raw_nonzero());
    let connect = || UnixStream::connect(rig.folder().join(&name)).unwrap();
    let from = rig.sim.heard_count();
    let watch = Stopwatch::start();
    let silent: Vec<UnixStream> = (0..12).map(|_| connect()).collect();
    for nonsense in [
        &[0xff; 64][..],
        b"\0\0\0\x02\x01\x7f",
        b"GET / HTTP/1.1\r\n\r\n",
    ] {
        let _ = connect().write_all(nonsense);
    }
    // Others are served beside them.
    let told = async {
        loop {
            let (code, text) = run_spykee(&rig, &["status", "--json"]).await;
            if code == Some(0) && text.contains("\"off its station\"") {
                return;
            }
        }
    };
    timeout(WAIT_LIMIT, told)
        .await
        .expect("other clients are not served");
    for _ in 0..3 {
        rig.heard_motion(rig.sim.heard_count()).await;
    }
    drop(silent);
    let heard = rig.sim.heard_since(from);
    let at: Vec<_> = heard
        .iter()
        .filter(|heard| moves(&heard.command))
        .map(|heard| heard.at)
        .collect();
    let longest = at.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    println!("longest gap between MOVEs {longest:?}");
    let longest = longest.saturating_sub(watch.stalled());
    assert!(longest < std::time::Duration::from_secs(2), "{longest:?}");
    rig.drives_on(&run, from).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulated_run_accepts_requests_and_two_runs_must_be_told_apart() {
    let home = Rig::quiet().await;
    home.file("script.lua", IDLE);
    home.file("world.yaml", QUIET_WORLD);
    let mut first = home.spykee(&["run", "script.lua", "--sim", "world.yaml"]);
    first.says("connected").await;
    let text = succeed(&home, &["robot", "battery"]).await;
    assert_contains(&text, &["90 %"]);
    // Also if the config names a robot that it does not use.
    home.file("other.yaml", "robot: 192.0.2.1");
    let text = succeed(&home, &["behaviour", "list", "--config", "other.yaml"]).await;
    assert_contains(&text, &["script", "running"]);
    let second = home.spykee(&["run", "script.lua", "--robot", &home.address]);
    second.says("connected").await;
    let (code, text) = run_spykee(&home, &["robot", "battery"]).await;
    assert_eq!(code, Some(2), "{text}");
    assert_contains(&text, &["several runs"]);
    let text = succeed(&home, &["robot", "battery", "--robot", &home.address]).await;
    assert_contains(&text, &["90 %"]);
    drop(second);
    succeed(&home, &["robot", "stop"]).await;
    assert_eq!(first.code().await, Some(130), "{}", first.text());
}
