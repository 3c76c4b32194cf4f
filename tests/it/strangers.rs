//! Strangers at the doors that a run has beside the robot's: its page, its broker, its webhooks, its
//! journal, and names that others chose. Whatever they do, the robot drives on, the run ends when it is
//! told to, and nothing of theirs is believed. The table of all that was tried is in
//! `tests/hostile/README.md`.

mod broker;
mod journal;
mod names;
mod page;
mod webhook;

use spykee::wire::Command;

use crate::rig::{Rig, Run};

/// Drives until it is ended.
const DRIVES: &str = "robot.move(30, 30) task.wait(600)";

/// Nothing has stopped the robot since `from`, and the run is told to end and does.
async fn drove_on(rig: &Rig, run: &mut Run, from: usize, what: &str) {
    let heard = rig.commands(from);
    assert!(
        !heard.contains(&Command::STOP),
        "{what}: it was stopped: {heard:?}\n{}",
        run.text()
    );
    assert!(run.lives(), "{what}: {}", run.text());
    run.signal(rustix::process::Signal::TERM);
    assert_eq!(run.code().await, Some(130), "{what}: {}", run.text());
    rig.heard_stop(from).await;
}
