//! The guide for people who write behaviours: every script in it does what the text says.

mod service;

use crate::rig::{Rig, assert_contains, run_in};

const GUIDE: &str = include_str!("../../behaviours/README.md");
/// The scenarios that check the scripts of the guide.
const SCENARIOS: &str = include_str!("../guide/guide_test.lua");

/// The scripts of the guide, without the reference: behaviours and scenarios.
fn scripts() -> (Vec<&'static str>, Vec<&'static str>) {
    let (guide, _) = GUIDE.split_once("<!-- reference").unwrap();
    let blocks = guide.split("```lua\n").skip(1);
    blocks
        .map(|block| block.split_once("```").unwrap().0)
        .partition(|script| !script.starts_with("scenario("))
}

/// The scripts of the guide by number, and the scenarios that check them.
fn files() -> Vec<(String, &'static str)> {
    let (scripts, _) = scripts();
    let numbered = scripts.into_iter().zip(1..);
    let mut files: Vec<_> = numbered
        .map(|(script, number)| (format!("guide_{number:02}.lua"), script))
        .collect();
    files.push(("guide_test.lua".to_owned(), SCENARIOS));
    files
}

#[test]
fn every_script_of_the_guide_has_a_scenario() {
    let (scripts, _) = scripts();
    assert!(scripts.len() > 20, "{} scripts", scripts.len());
    for number in 1..=scripts.len() {
        let name = format!("scenario(\"{number:02} ");
        assert_eq!(SCENARIOS.matches(&name).count(), 1, "{name}");
    }
}

#[test]
fn every_script_of_the_guide_does_what_its_text_says() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files() {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    let played = run_in(folder.path(), &["test", "guide_test.lua"]);
    let said = played.out;
    assert_eq!(played.code, Some(0), "{said}");
    assert_contains(&said, &[" runs passed; "]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_check_finds_nothing_in_the_guide() {
    let rig = Rig::quiet().await;
    for (file, text) in files() {
        rig.file(&file, text);
        let mut run = rig.spykee(&["check", &file]);
        assert_eq!(run.code().await, Some(0), "{file}: {}", run.text());
        for word in ["warning", "error:"] {
            assert!(!run.text().contains(word), "{file}: {}", run.text());
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_patrol_of_the_guide_passes_its_scenarios() {
    let rig = Rig::quiet().await;
    let (behaviours, scenarios) = scripts();
    let [scenario] = scenarios[..] else {
        panic!("{} files of scenarios", scenarios.len());
    };
    let patrol = behaviours
        .iter()
        .find(|script| script.starts_with("-- Drives legs"));
    rig.file("my_patrol.lua", patrol.unwrap());
    rig.file("my_patrol_test.lua", scenario);
    let mut run = rig.spykee(&["test"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}
