//! The guide for people who write behaviours: every script on it runs.

use crate::rig::Rig;

const GUIDE: &str = include_str!("../../behaviours/README.md");

/// The scripts of the guide, without the reference: behaviours, and scenarios.
fn scripts() -> (Vec<&'static str>, Vec<&'static str>) {
    let (guide, _) = GUIDE.split_once("<!-- reference").unwrap();
    let blocks = guide.split("```lua\n").skip(1);
    blocks
        .map(|block| block.split_once("```").unwrap().0)
        .partition(|script| !script.starts_with("scenario("))
}

#[tokio::test(flavor = "multi_thread")]
async fn every_script_of_the_guide_runs() {
    let rig = Rig::quiet().await;
    let (scripts, _) = scripts();
    assert!(scripts.len() > 12, "{} scripts", scripts.len());
    for (number, script) in scripts.iter().enumerate() {
        let file = rig.file(&format!("guide{number}.lua"), script);
        let mut run = rig.spykee(&[
            "run",
            file.to_str().unwrap(),
            "--sim",
            "--fast",
            "--for",
            "6",
            "--seed",
            "1",
        ]);
        assert_eq!(run.code().await, Some(0), "{script}\n{}", run.text());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_patrol_of_the_guide_keeps_the_promises_of_its_scenarios() {
    let rig = Rig::quiet().await;
    let (behaviours, scenarios) = scripts();
    let [scenario] = scenarios[..] else {
        panic!("{} files of scenarios", scenarios.len());
    };
    rig.file("my_patrol.lua", behaviours.last().unwrap());
    rig.file("my_patrol_test.lua", scenario);
    let mut run = rig.spykee(&["test"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}
