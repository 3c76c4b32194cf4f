//! Behaviours of an active run are started, stopped and restarted by name.

use rustix::process::Signal;
use spykee::wire::Command;

use crate::rig::{Rig, Run, assert_contains, moves, run_spykee, succeed};

const DRIVES: &str = "while true do robot.move(30, 30, 0.5) end";
const IDLES: &str = "task.wait(600)";

/// A run with one behaviour that keeps the run active and one that drives.
async fn running(rig: &Rig) -> Run {
    rig.file("idle.lua", IDLES);
    rig.file("drive.lua", DRIVES);
    let run = rig.spykee(&["run", "idle.lua", "drive.lua", "--robot", &rig.address]);
    run.says("connected").await;
    run
}

fn states(text: &str) -> Vec<(String, String)> {
    let list: serde_json::Value = serde_json::from_str(text).unwrap_or_else(|_| panic!("{text}"));
    let word = |one: &serde_json::Value, key: &str| one[key].as_str().unwrap().to_owned();
    let list = list.as_array().unwrap().iter();
    list.map(|one| (word(one, "name"), word(one, "state")))
        .collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_behaviour_stops_and_starts_by_name_while_another_continues() {
    let rig = Rig::quiet().await;
    let mut run = running(&rig).await;
    let moving = rig.heard_motion(0).await;
    let (code, text) = run_spykee(&rig, &["behaviour", "stop", "drive"]).await;
    assert_eq!((code, &*text), (Some(0), "drive has ended"));
    let stopped = rig.heard_stop(moving).await;
    let (_, text) = run_spykee(&rig, &["behaviour", "list", "--json"]).await;
    let pair = |name: &str, state: &str| (name.to_owned(), state.to_owned());
    assert_eq!(
        states(&text),
        [pair("idle", "running"), pair("drive", "idle")]
    );
    let after = rig.sim.heard_count();
    assert!(
        !rig.commands(stopped).iter().any(moves),
        "the robot still moves"
    );
    succeed(&rig, &["behaviour", "start", "drive"]).await;
    rig.heard_motion(after).await;
    let text = succeed(&rig, &["behaviour", "list"]).await;
    assert_contains(&text, &["cancelled"]);
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_restarted_behaviour_is_loaded_from_its_current_file() {
    let rig = Rig::quiet().await;
    let run = running(&rig).await;
    rig.heard_motion(0).await;
    rig.file("drive.lua", "robot.volume(41) task.wait(600)");
    let (code, text) = run_spykee(&rig, &["behaviour", "restart", "drive"]).await;
    assert_eq!(code, Some(0), "{text} {}", run.text());
    let volume = rig
        .heard(0, |command| *command == Command::Volume(41))
        .await;
    assert!(!rig.commands(volume).iter().any(moves));
    // A script with a mistake is refused, and no behaviour runs in its place.
    rig.file("drive.lua", "robot.mvoe(30, 30)");
    let (code, text) = run_spykee(&rig, &["behaviour", "restart", "drive"]).await;
    assert_eq!(code, Some(1), "{text}");
    assert_contains(&text, &["drive.lua:1"]);
    let (_, text) = run_spykee(&rig, &["behaviour", "list", "--json"]).await;
    assert_eq!(states(&text)[1].1, "idle", "{text}");
}

/// The words that bash offers after `spykee behaviour start` and the beginning of a word.
fn completed(folder: &std::path::Path, begun: &str) -> String {
    let program = std::path::Path::new(env!("CARGO_BIN_EXE_spykee"));
    let path = std::env::var("PATH").unwrap_or_default();
    let path = format!("{}:{path}", program.parent().unwrap().display());
    let script = "source <(spykee completions bash); COMP_WORDS=(spykee behaviour start \"$1\"); \
                  COMP_CWORD=3; _spykee spykee \"$1\" start; echo \"${COMPREPLY[@]}\"";
    let mut bash = std::process::Command::new("bash");
    bash.args(["-c", script, "bash", begun]).env("PATH", path);
    let output = bash.current_dir(folder).output().unwrap();
    String::from_utf8(output.stdout).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_shell_completes_the_behaviours_of_the_run_without_executing_them() {
    let rig = Rig::quiet().await;
    assert!(!completed(rig.folder(), "d").contains("drive"));
    let hostile = "$(touch hacked).lua";
    rig.file(hostile, IDLES);
    rig.file("idle.lua", IDLES);
    rig.file("drive.lua", DRIVES);
    let run = rig.spykee(&[
        "run",
        "idle.lua",
        hostile,
        "drive.lua",
        "--robot",
        &rig.address,
    ]);
    run.says("connected").await;
    let (code, text) = run_spykee(&rig, &["behaviour", "list", "--names"]).await;
    assert_eq!((code, &*text), (Some(0), "idle\ndrive"));
    let offered = completed(rig.folder(), "");
    assert_contains(&offered, &["idle", "drive"]);
    assert_eq!(completed(rig.folder(), "dr").trim(), "drive");
    assert!(!rig.folder().join("hacked").exists());
}

#[tokio::test(flavor = "multi_thread")]
async fn invalid_requests_are_explained() {
    let rig = Rig::quiet().await;
    let _run = running(&rig).await;
    for (args, words) in [
        (["start", "drive"], "`drive` runs already"),
        (["start", "driv"], "did you mean 'drive'?"),
        (["stop", "patrol"], "there are idle, drive"),
    ] {
        let (code, text) = run_spykee(&rig, &[&["behaviour"], &args[..]].concat()).await;
        assert_eq!(code, Some(1), "{text}");
        assert_contains(&text, &[words]);
    }
    assert_eq!(
        run_spykee(&rig, &["behaviour", "stop", "drive"]).await.0,
        Some(0)
    );
    let (code, text) = run_spykee(&rig, &["behaviour", "stop", "drive"]).await;
    assert_eq!(code, Some(1), "{text}");
    assert_contains(&text, &["does not run"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_ends_when_its_last_behaviour_is_stopped() {
    let rig = Rig::quiet().await;
    let mut run = rig.run(DRIVES);
    rig.heard_motion(0).await;
    succeed(&rig, &["behaviour", "stop", "script"]).await;
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let (code, text) = run_spykee(&rig, &["behaviour", "list"]).await;
    assert_eq!(code, Some(3), "{text}");
    assert_contains(&text, &["no run is active"]);
}
