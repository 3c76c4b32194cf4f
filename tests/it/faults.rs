//! Broken networks and robots: named scenarios, each with a promise, run by the real binary with
//! a simulated robot that has faults. The book shows their table; a test run prints it with the
//! results.

mod fault_run;
mod file;
mod network;
mod robot;
mod table;

use std::io::Write;
use std::sync::Arc;

use tokio::sync::Semaphore;
use tokio::task::JoinSet;

use self::fault_run::FaultRun;
use self::table::{SCENARIOS, Scenario};

/// The chapter of the book on broken networks.
const CHAPTER: &str = include_str!("../../behaviours/guide/trust/networks.md");

/// Scenarios that run in parallel; each is three processes that mostly wait.
const AT_ONCE: usize = 9;

#[tokio::test(flavor = "multi_thread")]
async fn every_promise_on_broken_networks_is_kept() {
    let permits = Arc::new(Semaphore::new(AT_ONCE));
    let mut running = JoinSet::new();
    for (index, scenario) in SCENARIOS.iter().enumerate() {
        let permits = Arc::clone(&permits);
        running.spawn(async move {
            let _permit = permits.acquire_owned().await.unwrap();
            // A separate task, because a broken promise panics.
            (index, tokio::spawn(play(scenario)).await)
        });
    }
    let mut kept = vec![false; SCENARIOS.len()];
    while let Some(ended) = running.join_next().await {
        let (index, outcome) = ended.unwrap();
        kept[index] = outcome.is_ok();
    }
    print_table(&kept);
    let broken = SCENARIOS.iter().zip(&kept).filter(|(_, kept)| !**kept);
    let names: Vec<&str> = broken.map(|(scenario, _)| scenario.name).collect();
    assert!(names.is_empty(), "broken: {}", names.join(", "));
}

/// Plays one scenario by name, for debugging:
/// `FAULT='reset in mid-frame' cargo test one_scenario -- --ignored --nocapture`.
#[tokio::test(flavor = "multi_thread")]
#[ignore = "plays the one scenario that FAULT names"]
async fn one_scenario() {
    let name = std::env::var("FAULT").expect("FAULT must name a scenario");
    let found = SCENARIOS.iter().find(|scenario| scenario.name == name);
    play(found.expect("no scenario of this name")).await;
}

#[test]
fn the_book_shows_every_scenario_and_its_promise() {
    let rows: Vec<&str> = CHAPTER
        .lines()
        .filter(|line| line.starts_with("| "))
        .collect();
    let expected = SCENARIOS.iter().map(row).collect::<Vec<String>>();
    let first = rows
        .iter()
        .position(|row| **row == expected[0])
        .expect("the first scenario is missing");
    assert_eq!(&rows[first..], &expected);
}

#[test]
fn the_faults_of_the_book_are_read() {
    let yaml = CHAPTER
        .split("```yaml\n")
        .find(|text| text.starts_with("faults:"));
    let yaml = yaml
        .and_then(|text| text.split("```").next())
        .expect("no list of faults");
    let faults = spykee::sim::Fault::list_from_yaml(yaml, "the book").unwrap();
    assert!(faults.len() > 3);
}

#[test]
fn at_least_25_scenarios_have_different_names() {
    let mut names: Vec<&str> = SCENARIOS.iter().map(|scenario| scenario.name).collect();
    names.sort_unstable();
    names.dedup();
    assert!(
        names.len() >= 25 && names.len() == SCENARIOS.len(),
        "{names:?}"
    );
}

async fn play(scenario: &'static Scenario) {
    let fault_run = FaultRun::set(scenario).await;
    (scenario.act)(fault_run).await;
}

fn row(scenario: &Scenario) -> String {
    format!("| {} | {} |", scenario.name, scenario.promise)
}

/// Does not use `print!`, so that the table is shown even if all tests pass.
fn print_table(kept: &[bool]) {
    let mut table =
        String::from("\n| broken network or robot | promise | kept |\n| --- | --- | --- |\n");
    for (scenario, kept) in SCENARIOS.iter().zip(kept) {
        table += &format!("{} {} |\n", row(scenario), if *kept { "yes" } else { "NO" });
    }
    let _ = std::io::stderr().write_all(table.as_bytes());
}
