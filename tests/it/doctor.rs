//! `spykee doctor`: works with and without a robot, and reports problems by its exit code.

use spykee::config::Config;
use spykee::sim::Firmware;

use crate::rig::{Rig, Run, assert_contains, docked, exact};

async fn doctor(rig: &Rig, args: &[&str]) -> (Option<i32>, String) {
    let mut run: Run = rig.spykee(&[&["doctor"], args].concat());
    (run.code().await, run.text())
}

fn verdict(text: &str, check: &str) -> String {
    let results: serde_json::Value = serde_json::from_str(text).unwrap();
    let found = results
        .as_array()
        .unwrap()
        .iter()
        .find(|f| f["check"] == check);
    found.unwrap_or_else(|| panic!("no {check}: {text}"))["verdict"]
        .as_str()
        .unwrap()
        .to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_answers_and_streams_passes() {
    let rig = Rig::quiet().await;
    let (code, text) = doctor(&rig, &["--robot", &rig.address, "--json"]).await;
    assert_eq!(code, Some(0), "{text}");
    for check in ["robot", "login", "battery", "config"] {
        assert_eq!(verdict(&text, check), "ok", "{check}: {text}");
    }
    assert_ne!(verdict(&text, "video"), "fail", "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_robot_the_rest_is_checked_and_an_unreachable_one_is_exit_code_3() {
    let rig = Rig::quiet().await;
    let (code, text) = doctor(&rig, &[]).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(&text, &["no robot named"]);
    let (code, text) = doctor(&rig, &["--robot", "127.0.0.1:1", "--json"]).await;
    assert_eq!(
        (code, verdict(&text, "robot").as_str()),
        (Some(3), "fail"),
        "{text}"
    );
    rig.file("bad.yaml", "nonsense: 1\n");
    let (code, text) = doctor(&rig, &["--config", "bad.yaml"]).await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["nonsense"]);
}

#[tokio::test]
async fn the_config_in_the_current_folder_is_found_and_checked() {
    let rig = Rig::quiet().await;
    rig.file("spykee.yaml", &format!("robot: {}\n", rig.address));
    let mut run = rig.spykee(&["doctor"]);
    run.code().await;
    let text = run.text();
    assert_contains(&text, &["spykee.yaml is valid"]);
    assert!(text.contains(&rig.address), "{text}");
    rig.file("spykee.yaml", "watchdog: { lwo: 3 }\n");
    let mut run = rig.spykee(&["doctor"]);
    assert_eq!(run.code().await, Some(3));
    let text = run.text();
    assert_contains(&text, &["FAIL  config", "did you mean 'low'?"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stranger_is_described_and_its_config_is_written_once() {
    let firmware = Firmware {
        stops_on_disconnect: true,
        ..Firmware::default()
    };
    let rig = Rig::with_world(exact("classroom"), firmware).await;
    let flags = ["--robot", &rig.address, "--first", "--yes"];
    let (code, text) = doctor(&rig, &flags).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(
        &text,
        &[
            "measured   executes commands     at once",
            "not known  leaves its station",
            "measured   POWER is              a share",
            "measured   without a connection  it stops by itself",
            "Written to spykee.yaml",
        ],
    );
    let config = Config::load(&rig.folder().join("spykee.yaml")).unwrap();
    assert_eq!(config.robot.unwrap().to_string(), rig.address);
    assert!(!rig.sim.state().moving());
}

#[tokio::test(flavor = "multi_thread")]
async fn without_a_person_nothing_moves() {
    let rig = Rig::new(&docked(), Firmware::default()).await;
    let (code, text) = doctor(&rig, &["--robot", &rig.address, "--first"]).await;
    assert_eq!(code, Some(2), "{text}");
    assert_contains(&text, &["needs a person", "--yes", "What this robot is"]);
    assert!(rig.sim.state().docked && !rig.folder().join("spykee.yaml").exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_config_that_does_not_fit_paper_on_the_floor_gets_a_warning() {
    let world = crate::calibrate::paper_world("{ pitch: -10, roll: -4 }", "[2.9, 2.055]");
    let rig = Rig::new(&world, Default::default()).await;
    let args = ["--robot", &rig.address, "--json"];
    let (code, text) = doctor(&rig, &args).await;
    assert_eq!((code, verdict(&text, "camera").as_str()), (Some(0), "warn"));
    assert_contains(&text, &["spykee calibrate camera"]);
    rig.file("spykee.yaml", "camera: { pitch: -10, roll: -4 }\n");
    let (code, text) = doctor(&rig, &args).await;
    assert_eq!((code, verdict(&text, "camera").as_str()), (Some(0), "ok"));
}
