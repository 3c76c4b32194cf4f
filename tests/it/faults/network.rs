//! Scenarios of the network: bytes that arrive late, damaged or not at all.

use rustix::process::Signal;
use spykee::wire::Command;
use tokio::time::{Duration, Instant};

use super::stage::Stage;
use crate::rig::moves;

pub async fn drives_on(stage: Stage) {
    stage.begin_faults();
    stage.says_more("moved true done", 5).await;
    assert_eq!(stage.said("hears disconnected"), 0, "{}", stage.run.text());
    stage.ends_well();
}

pub async fn drives_and_sees_on(stage: Stage) {
    stage.begin_faults();
    stage.says_more("frame", 6).await;
    assert_eq!(stage.said("blind 1"), 0, "{}", stage.run.text());
    drives_on(stage).await;
}

pub async fn comes_back(stage: Stage) {
    let before = stage.newest_client();
    stage.begin_faults();
    stage.comes_back(before).await;
    stage.drives_on().await;
    stage.ends_well();
}

pub async fn comes_back_each_time(stage: Stage) {
    stage.begin_faults();
    for _ in 0..3 {
        stage.comes_back(stage.newest_client()).await;
    }
    stage.end_faults();
    stage.drives_on().await;
    stage.ends_well();
}

pub async fn comes_back_and_sees(stage: Stage) {
    let before = stage.newest_client();
    stage.begin_faults();
    stage.comes_back(before).await;
    stage.says_more("frame", 3).await;
    stage.ends_well();
}

/// The last command that the robot receives over the old connection is a stop.
pub async fn stops_first(stage: Stage) {
    let before = stage.newest_client();
    let from = stage.begin_faults();
    stage.comes_back(before).await;
    let heard = stage.rig.sim.heard_since(from);
    let old = heard.iter().filter(|heard| heard.client == before);
    let motions = |heard: &&_| matches!(heard, Command::Move { .. });
    let last = old.map(|heard| &heard.command).rfind(motions);
    assert_eq!(last, Some(&Command::STOP), "{heard:?}");
    stage.drives_on().await;
    stage.ends_well();
}

/// Commands of the time when the connection was dead do not arrive later.
pub async fn queues_nothing(stage: Stage) {
    let before = stage.newest_client();
    // Bytes that are in transit at this moment may still arrive.
    stage.begin_faults();
    stage.run.says("hears disconnected").await;
    let dead = stage.rig.sim.heard_count();
    stage.comes_back(before).await;
    let heard = stage.rig.sim.heard_since(dead);
    let late: Vec<_> = heard
        .iter()
        .filter(|heard| heard.client == before)
        .collect();
    assert!(late.is_empty(), "{late:?}");
    let first = heard.iter().position(|heard| moves(&heard.command));
    let before_it = &heard[..first.unwrap()];
    assert!(before_it.iter().any(|heard| heard.command == Command::STOP));
    stage.ends_well();
}

pub async fn ends_in_time(mut stage: Stage) {
    stage.begin_faults();
    stage.says_more("moved", 1).await;
    stage.run.signal(Signal::INT);
    let interrupted = Instant::now();
    assert_eq!(stage.run.code().await, Some(130), "{}", stage.run.text());
    // One second more than promised, for a busy machine.
    assert!(
        interrupted.elapsed() < Duration::from_secs(3),
        "{:?}",
        interrupted.elapsed()
    );
    assert_eq!(stage.said("internal error"), 0, "{}", stage.run.text());
}

pub async fn sees_huge_pictures(stage: Stage) {
    stage.begin_faults();
    stage.says_more("frame 65535 seen", 4).await;
    assert_eq!(stage.said("blind 1"), 0, "{}", stage.run.text());
    assert_eq!(stage.said("hears disconnected"), 0, "{}", stage.run.text());
    stage.drives_on().await;
    stage.ends_well();
}

pub async fn overlooks_bad_pictures(stage: Stage) {
    stage.begin_faults();
    stage.says_more("frame", 6).await;
    stage.drives_on().await;
    stage.end_faults();
    let seen = stage.said(" seen ");
    stage.says_more(" seen ", seen.min(6)).await;
    assert_eq!(stage.said("hears disconnected"), 0, "{}", stage.run.text());
    stage.ends_well();
}
