//! A person's STOP holds in the next program too, whatever ended this one, until it is released.

use std::time::Duration;

use rustix::process::Signal;
use spykee::wire::{Command, Engage};
use tokio::time::{sleep, timeout};

use crate::live::browser::{address, ask};
use crate::rig::{Rig, Run, WAIT_LIMIT, assert_contains, moves, run_spykee, succeed};

/// Asks to drive again and again; after each attempt it sets another volume.
const DRIVE: &str = "local v = 40 while true do robot.move(30, 30, 0.2) v = 81 - v \
                     robot.volume(v) task.wait(0.1) end";
const CONFIG: &str = "link: { longest_pause: 0.3 }\nservice: { user: root }\n\
                      live: { listen: '127.0.0.1:0' }\nbehaviours:\n- file: drive.lua\n";

async fn serve(rig: &Rig) -> (Run, String) {
    rig.file("drive.lua", DRIVE);
    rig.file("spykee.yaml", CONFIG);
    let run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    let page = address(&run).await;
    run.says("connected").await;
    (run, page)
}

/// Waits until the file that keeps STOP is there, or is not.
async fn kept(rig: &Rig, wanted: bool) {
    let path = rig.folder().join("spykee-data/.stop");
    let changed = async {
        while path.exists() != wanted {
            sleep(Duration::from_millis(10)).await;
        }
    };
    let waited = timeout(WAIT_LIMIT, changed).await;
    waited.unwrap_or_else(|_| panic!("is STOP kept? not {wanted}"));
}

/// Leaves a STOP behind, as a program does that was killed.
fn leave_stop(rig: &Rig) {
    let data = rig.folder().join("spykee-data");
    std::fs::create_dir_all(&data).unwrap();
    std::fs::write(data.join(".stop"), "").unwrap();
}

/// Waits until the behaviour has tried to drive twice, and checks that nothing has moved the robot.
async fn tries_in_vain(rig: &Rig, from: usize) {
    let volume = |volume: u8| move |command: &Command| *command == Command::Volume(volume);
    let first = rig.heard(from, volume(40)).await;
    let second = rig.heard(first, volume(41)).await;
    rig.heard(second, volume(40)).await;
    let search = Command::Engine(Engage::Dock);
    let drives = |command: &Command| moves(command) || *command == search;
    let drove = rig.commands(from).into_iter().find(drives);
    assert_eq!(drove, None, "it moves in spite of STOP");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_was_killed_holds_a_low_robot_still_when_it_starts_again() {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let (mut run, page) = serve(&rig).await;
    rig.heard_motion(0).await;
    let (status, body) = ask(&page, "POST /api/stop", "", "{}").await;
    assert_eq!(status, 200, "{body}");
    kept(&rig, true).await;
    run.signal(Signal::KILL);
    run.status().await;
    let free = rig.sim.wait_state(|state| state.user.is_none());
    timeout(WAIT_LIMIT, free).await.expect("the link stays");
    rig.sim.set_battery(18.0);
    let from = rig.sim.heard_count();
    let (mut next, page) = serve(&rig).await;
    next.says("a person's STOP still holds").await;
    tries_in_vain(&rig, from).await;
    let (_, body) = ask(&page, "GET /api/run", "", "").await;
    assert_contains(&body, &["stopped by a person"]);
    let (_, text) = run_spykee(&rig, &["status"]).await;
    assert_contains(&text, &["stopped by a person"]);
    let (code, text) = run_spykee(&rig, &["robot", "reset-stop"]).await;
    let released = text.contains("the robot may move again");
    assert_eq!((code, released), (Some(0), true), "{text}");
    rig.heard_dock(from).await;
    kept(&rig, false).await;
    next.signal(Signal::TERM);
    next.code().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_that_was_left_behind_holds_for_every_program_but_simulations() {
    let rig = Rig::quiet().await;
    leave_stop(&rig);
    for args in [&["robot", "undock"][..], &["robot", "dock"], &["repl"]] {
        let robot = ["--robot", &rig.address];
        let (code, text) = run_spykee(&rig, &[args, &robot[..]].concat()).await;
        let helped = text.contains("spykee robot reset-stop");
        assert_eq!((code, helped), (Some(5), true), "{args:?}: {text}");
    }
    let from = rig.sim.heard_count();
    let run = rig.run(DRIVE);
    run.says("a person's STOP still holds").await;
    // The battery is good and nothing was searched for: only the login's repeated STOP sends this.
    rig.heard_cancel(from).await;
    tries_in_vain(&rig, from).await;
    succeed(&rig, &["robot", "reset-stop"]).await;
    rig.heard_motion(from).await;
    kept(&rig, false).await;
    drop(run);
    // Without a run, the tool releases what the last one has left behind.
    leave_stop(&rig);
    let simulated = ["run", "script.lua", "--sim", "--for", "1"];
    let (_, text) = run_spykee(&rig, &simulated).await;
    assert!(!text.contains("STOP"), "{text}");
    kept(&rig, true).await;
    for words in ["released", "nothing to release"] {
        let text = succeed(&rig, &["robot", "reset-stop"]).await;
        assert_contains(&text, &[words]);
    }
    kept(&rig, false).await;
}
