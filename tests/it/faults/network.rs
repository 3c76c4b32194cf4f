//! Scenarios of the network: bytes that arrive late, damaged or not at all.

use rustix::process::Signal;
use spykee::wire::Command;
use tokio::time::Duration;

use super::fault_run::FaultRun;
use crate::rig::{Stopwatch, moves};

pub async fn drives_on(fault_run: FaultRun) {
    fault_run.begin_faults();
    fault_run.says_more("moved true done", 5).await;
    assert_eq!(
        fault_run.said("hears disconnected"),
        0,
        "{}",
        fault_run.run.text()
    );
    fault_run.ends_well();
}

pub async fn drives_and_sees_on(fault_run: FaultRun) {
    fault_run.begin_faults();
    fault_run.says_more("frame", 6).await;
    assert_eq!(fault_run.said("blind 1"), 0, "{}", fault_run.run.text());
    drives_on(fault_run).await;
}

pub async fn comes_back(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    fault_run.begin_faults();
    fault_run.comes_back(before).await;
    fault_run.drives_on().await;
    fault_run.ends_well();
}

pub async fn comes_back_each_time(fault_run: FaultRun) {
    fault_run.begin_faults();
    for _ in 0..3 {
        fault_run.comes_back(fault_run.newest_client()).await;
    }
    fault_run.end_faults();
    fault_run.drives_on().await;
    fault_run.ends_well();
}

pub async fn comes_back_and_sees(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    fault_run.begin_faults();
    fault_run.comes_back(before).await;
    fault_run.says_more("frame", 3).await;
    fault_run.ends_well();
}

/// The last command that the robot receives over the old connection is a stop.
pub async fn stops_first(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    let from = fault_run.begin_faults();
    fault_run.comes_back(before).await;
    let heard = fault_run.rig.sim.heard_since(from);
    let old = heard.iter().filter(|heard| heard.client == before);
    let motions = |heard: &&_| matches!(heard, Command::Move { .. });
    let last = old.map(|heard| &heard.command).rfind(motions);
    assert_eq!(last, Some(&Command::STOP), "{heard:?}");
    fault_run.drives_on().await;
    fault_run.ends_well();
}

/// Commands of the time when the connection was dead do not arrive later.
pub async fn queues_nothing(fault_run: FaultRun) {
    let before = fault_run.newest_client();
    // Bytes that are in transit at this moment may still arrive.
    fault_run.begin_faults();
    fault_run.run.says("hears disconnected").await;
    let dead = fault_run.rig.sim.heard_count();
    fault_run.comes_back(before).await;
    let heard = fault_run.rig.sim.heard_since(dead);
    let late: Vec<_> = heard
        .iter()
        .filter(|heard| heard.client == before)
        .collect();
    assert!(late.is_empty(), "{late:?}");
    let first = heard.iter().position(|heard| moves(&heard.command));
    let before_it = &heard[..first.unwrap()];
    assert!(before_it.iter().any(|heard| heard.command == Command::STOP));
    fault_run.ends_well();
}

pub async fn ends_in_time(mut fault_run: FaultRun) {
    fault_run.begin_faults();
    fault_run.says_more("moved", 1).await;
    fault_run.run.signal(Signal::INT);
    let interrupted = Stopwatch::start();
    assert_eq!(
        fault_run.run.code().await,
        Some(3),
        "{}",
        fault_run.run.text()
    );
    // One second more than promised, for a busy machine.
    assert!(
        interrupted.elapsed() < Duration::from_secs(3),
        "{:?}",
        interrupted.elapsed()
    );
    assert_eq!(
        fault_run.said("internal error"),
        0,
        "{}",
        fault_run.run.text()
    );
}

pub async fn sees_huge_pictures(fault_run: FaultRun) {
    fault_run.begin_faults();
    fault_run.says_more("frame 65535 seen", 4).await;
    assert_eq!(fault_run.said("blind 1"), 0, "{}", fault_run.run.text());
    assert_eq!(
        fault_run.said("hears disconnected"),
        0,
        "{}",
        fault_run.run.text()
    );
    fault_run.drives_on().await;
    fault_run.ends_well();
}

pub async fn overlooks_bad_pictures(fault_run: FaultRun) {
    fault_run.begin_faults();
    fault_run.says_more("frame", 6).await;
    fault_run.drives_on().await;
    fault_run.end_faults();
    let seen = fault_run.said(" seen ");
    fault_run.says_more(" seen ", seen.min(6)).await;
    assert_eq!(
        fault_run.said("hears disconnected"),
        0,
        "{}",
        fault_run.run.text()
    );
    fault_run.ends_well();
}
