//! A slow system: making a folder or a process takes five seconds. The robot must not notice.
//! `strace` delays the calls; where it is missing or may not trace, the test is skipped with a
//! message.

use std::process::{Child, Command as Process, Stdio};
use std::time::Duration;

use rustix::process::Pid;

use crate::rig::{Rig, Stopwatch, moves};

/// The delayed calls: all that make a folder, a process or a thread.
const SLOW: &str = "inject=mkdir,mkdirat,clone,clone3,fork,vfork:delay_enter=5000000";

/// One script that drives forever, and beside it one that fails twice a second and is restarted.
const DRIVER: &str = "while true do robot.move(30, 30) task.wait(0.1) end";
const RESTLESS: &str = "task.wait(0.5) error('again')";

#[tokio::test(flavor = "multi_thread")]
async fn slow_folders_and_processes_delay_neither_motion_nor_the_way_home() {
    let rig = Rig::quiet().await;
    rig.file("driver.lua", DRIVER);
    rig.file("restless.lua", RESTLESS);
    let run = rig.run_config(
        "behaviours:\n  - { file: driver.lua }\n  - file: restless.lua\n    restart: \
         { policy: on-failure, max_restarts: 100, within: 1000, first_pause: 0.1, max_pause: 0.2 }\n",
    );
    rig.heard_motion(0).await;
    run.says("restart 1").await;
    let Some(mut tracer) = trace(
        run.pid(),
        &[
            "-f",
            "-e",
            "trace=mkdir,mkdirat,clone,clone3,fork,vfork",
            "-e",
            SLOW,
        ],
    ) else {
        return;
    };
    let from = rig.sim.heard_count();
    let watch = Stopwatch::start();
    tokio::time::sleep(Duration::from_secs(8)).await;
    let injected = rig.sim.heard_count();
    rig.sim.set_battery(10.0);
    let dock = rig.heard_dock(injected).await;
    let low = rig.at(injected.max(1) - 1).0;
    let _ = tracer.kill();
    let _ = tracer.wait();
    let heard = rig.sim.heard_since(from);
    let at: Vec<Duration> = heard
        .iter()
        .filter(|heard| moves(&heard.command))
        .map(|heard| heard.at)
        .collect();
    let longest = at.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    println!(
        "longest gap between MOVEs {longest:?}, BASE_FIND after {:?}",
        rig.at(dock).0 - low
    );
    let stalled = watch.stalled();
    let limit = Duration::from_secs(2) + stalled;
    assert!(longest < limit, "{longest:?}, {stalled:?}");
    assert!(rig.at(dock).0 - low < limit, "{stalled:?}");
}

/// Attaches `strace` to a process or thread and waits until it traces; `None`, with a message, if
/// that is not possible.
pub fn trace(pid: Pid, arguments: &[&str]) -> Option<Child> {
    use std::io::{BufRead, BufReader};
    let mut process = Process::new("strace");
    process
        .args(["-p", &pid.as_raw_nonzero().to_string()])
        .args(arguments);
    process.stdout(Stdio::null()).stderr(Stdio::piped());
    let Ok(mut tracer) = process.spawn() else {
        println!("skipped: there is no strace on this machine");
        return None;
    };
    let mut lines = BufReader::new(tracer.stderr.take().unwrap()).lines();
    let first = lines.next().and_then(Result::ok).unwrap_or_default();
    if !first.contains("attached") {
        println!("skipped: strace may not trace here: {first}");
        let _ = tracer.wait();
        return None;
    }
    // The tracer must not block on a full pipe.
    std::thread::spawn(move || lines.for_each(drop));
    Some(tracer)
}
