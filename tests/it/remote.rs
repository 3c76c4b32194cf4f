//! The command line's tools with a service on another computer, through its JSON API: the output
//! and exit codes are the same as through the private socket.

use rustix::process::Signal;
use serde_json::Value;
use spykee::wire::{Command, Sound};

use crate::rig::{Rig, Run, WAIT_LIMIT, assert_contains, run_spykee, succeed};

const CONFIG: &str = "time_zone: UTC\nservice: { user: root }\n\
    live: { listen: '127.0.0.1:0' }\nbehaviours:\n- { file: asked.lua, start: asked }\n\
    - { file: broken.lua, start: asked }\nschedule:\n- { run: asked, at: '0 4 29 2 *' }\n";

/// Starts a service of this robot; returns it with its address.
async fn serve(rig: &Rig) -> (Run, String) {
    rig.file("asked.lua", "robot.play('bomb') task.wait(600)");
    rig.file("broken.lua", "error('no')");
    rig.file("spykee.yaml", CONFIG);
    let args = [
        "serve",
        "--no-check",
        "--config",
        "spykee.yaml",
        "--robot",
        &rig.address,
    ];
    let run = rig.spykee(&args);
    run.says("the page is at ").await;
    run.says("connected").await;
    let text = run.text();
    let url = text.split("the page is at ").nth(1).unwrap();
    let url = url.split_whitespace().next().unwrap();
    let url = url.split("/?").next().unwrap().split("/#").next().unwrap();
    (run, url.trim_end_matches('/').to_owned())
}

#[tokio::test(flavor = "multi_thread")]
async fn tools_work_on_a_remote_service_with_the_same_output_and_codes() {
    let rig = Rig::quiet().await;
    let elsewhere = Rig::quiet().await;
    let (mut run, url) = serve(&rig).await;
    // The outputs may differ only in how they name the run.
    let pairs: [&[&str]; 4] = [
        &["robot", "volume", "37"],
        &["robot", "play", "laser"],
        &["behaviour", "stop", "asked"],
        &["behaviour", "start", "askd"],
    ];
    for args in pairs {
        let here = run_spykee(&rig, args).await;
        let there = run_spykee(&elsewhere, &[args, &["--url", &url]].concat()).await;
        assert_eq!(here.0, there.0, "{args:?}: {} | {}", here.1, there.1);
        let process = format!("process {}", run.pid().as_raw_nonzero());
        assert_eq!(here.1.replace(&process, &url), there.1, "{args:?}");
    }
    rig.heard(0, |command| *command == Command::Volume(37))
        .await;
    let there = ["--url", &url];
    for (args, words) in [
        (&["robot", "info"][..], "SPYKEE"),
        (&["robot", "battery", "--json"], "\"percent\":"),
        (&["robot", "undock", "--json"], "{\"end\":\"not_docked\"}"),
    ] {
        let (code, text) = run_spykee(&elsewhere, &[args, &there[..]].concat()).await;
        assert_eq!(
            (code, text.contains(words)),
            (Some(0), true),
            "{args:?}: {text}"
        );
    }
    let status = ["status", "--json", "--url", &url];
    let (code, text) = run_spykee(&elsewhere, &status).await;
    let told: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(
        (code, told[0]["link"].as_str()),
        (Some(0), Some("up")),
        "{text}"
    );
    let next = told[0]["next"].clone();
    assert_eq!(next["behaviour"], "asked");
    assert!(
        next["at"].as_str().unwrap().ends_with("-02-29T04:00:00Z"),
        "{text}"
    );
    let (_, here) = run_spykee(&rig, &["status", "--json"]).await;
    let here: Value = serde_json::from_str(&here).unwrap();
    assert_eq!(here[0]["next"], next);
    let (_, table) = run_spykee(&elsewhere, &["status", "--url", &url]).await;
    assert_contains(&table, &["NEXT START", "-02-29 04:00"]);
    // A picture is transferred too.
    let shot = [
        "robot",
        "snapshot",
        "-o",
        "room.jpg",
        "--timeout",
        "30",
        "--url",
        &url,
    ];
    succeed(&elsewhere, &shot).await;
    assert!(image::open(elsewhere.folder().join("room.jpg")).is_ok());
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let (code, text) = run_spykee(&elsewhere, &["status", "--url", &url]).await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["is the service running there"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_behaviour_that_was_started_for_a_time_ends_after_it() {
    let rig = Rig::quiet().await;
    let elsewhere = Rig::quiet().await;
    let (mut run, url) = serve(&rig).await;
    for (place, more) in [(&rig, &[][..]), (&elsewhere, &["--url", &url][..])] {
        let from = rig.sim.heard_count();
        let start = [&["behaviour", "start", "asked", "--for", "0.9"][..], more].concat();
        let text = succeed(place, &start).await;
        assert_contains(&text, &["runs, for 0:00:01 at most"]);
        rig.heard(from, |command| *command == Command::Play(Sound::Bomb))
            .await;
        let listed = ["behaviour", "list", "--json"];
        let over = async {
            loop {
                let (_, text) = run_spykee(place, &[&listed[..], more].concat()).await;
                if text.contains("\"idle\"")
                    && text.contains("cancelled")
                    && !text.contains("\"state\":\"running\"")
                {
                    return;
                }
            }
        };
        tokio::time::timeout(WAIT_LIMIT, over)
            .await
            .expect("it does not end");
    }
    assert_eq!(
        run.text().matches("its time is over").count(),
        2,
        "{}",
        run.text()
    );
    let zero = ["behaviour", "start", "asked", "--for", "0s"];
    assert_eq!(run_spykee(&rig, &zero).await.0, Some(2));
    run.signal(Signal::TERM);
    run.code().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_token_requests_are_refused_and_so_are_tools_that_need_the_robot_to_themselves() {
    let rig = Rig::quiet().await;
    let elsewhere = Rig::quiet().await;
    rig.file("spykee.yaml", CONFIG);
    let made = succeed(&rig, &["token", "new", "sofa", "--role", "driver"]).await;
    let token = made.lines().find(|line| line.starts_with("spykee_"));
    let token = token.unwrap_or_else(|| panic!("{made}"));
    let (mut run, url) = serve(&rig).await;
    let wrong = elsewhere.file("wrong", "spykee_0000");
    let wrong = wrong.to_str().unwrap();
    let (code, text) = run_spykee(
        &elsewhere,
        &["status", "--url", &url, "--token-file", wrong],
    )
    .await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["denies access"]);
    elsewhere.file("token", token);
    let right = ["--url", &url, "--token-file", "token"];
    let (code, text) = run_spykee(
        &elsewhere,
        &[&["robot", "volume", "38"], &right[..]].concat(),
    )
    .await;
    assert_eq!(code, Some(0), "{text}");
    rig.heard(0, |command| *command == Command::Volume(38))
        .await;
    // STOP stays in force, and the service continues.
    let text = succeed(&elsewhere, &[&["robot", "stop"], &right[..]].concat()).await;
    assert_contains(&text, &["reset-stop"]);
    assert!(run.lives());
    // The config can name the service, too.
    elsewhere.file(
        "spykee.yaml",
        &format!("remote: {{ url: '{url}', token_file: token }}\n"),
    );
    let named = ["status", "--config", "spykee.yaml"];
    let text = succeed(&elsewhere, &named).await;
    assert_contains(&text, &["stopped by a person"]);
    let log = ["robot", "log", "--config", "spykee.yaml"];
    let (code, text) = run_spykee(&elsewhere, &log).await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["needs it to itself"]);
    run.signal(Signal::TERM);
    run.code().await;
}

/// The body of the reply to a request.
fn fetch(url: &str, path: &str) -> String {
    use std::io::{Read as _, Write as _};
    let host = url.trim_start_matches("http://");
    let mut stream = std::net::TcpStream::connect(host).unwrap();
    write!(
        stream,
        "GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
    )
    .unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}

#[tokio::test(flavor = "multi_thread")]
async fn the_metrics_contain_the_time_from_a_frame_to_the_move_that_answers_it() {
    let rig = Rig::quiet().await;
    let follows = "local power = 20
        robot.on('frame', function() power = 50 - power robot.move(power, power) end) task.wait(600)";
    let (mut run, url) = serve(&rig).await;
    rig.file("asked.lua", follows);
    succeed(&rig, &["behaviour", "start", "asked"]).await;
    let counted = |text: &str| {
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix("spykee_frame_to_move_seconds_count "));
        line.and_then(|count| count.trim().parse::<u64>().ok())
            .unwrap_or_else(|| panic!("{text}"))
    };
    let some = async {
        loop {
            let at = url.clone();
            let path = "/metrics";
            let text = tokio::task::spawn_blocking(move || fetch(&at, path))
                .await
                .unwrap();
            if counted(&text) >= 3 {
                return text;
            }
        }
    };
    let text = tokio::time::timeout(WAIT_LIMIT, some)
        .await
        .expect("it does not react");
    assert_contains(&text, &["spykee_frame_to_move_seconds_bucket{le=\"+Inf\"}"]);
    run.signal(Signal::TERM);
    run.code().await;
}
