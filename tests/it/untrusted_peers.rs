//! Attacks through the other interfaces of a run: its page, its broker, its webhooks, its journal,
//! and names that others chose. In each case the robot drives on, the run ends when it is asked to,
//! and untrusted input is not trusted. `tests/hostile/README.md` lists all attacks.

mod broker;
mod journal;
mod names;
mod page;
mod webhook;

use rustix::process::Signal;

use crate::rig::{Rig, Run};

/// A script that drives until it is ended.
const DRIVES: &str = "robot.move(30, 30) task.wait(600)";

/// Checks that nothing has stopped the robot since `from`; then interrupts the run, which must end.
async fn drove_on(rig: &Rig, run: &mut Run, from: usize, what: &str) {
    assert!(run.lives(), "{what}: {}", run.text());
    eprintln!("{what}");
    rig.drives_on(run, from).await;
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(130), "{what}: {}", run.text());
    rig.heard_stop(from).await;
}
