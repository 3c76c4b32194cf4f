//! A person's STOP holds in the next program too, whatever ended this one, until it is released.

use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use spykee::control::EmergencyStop;
use spykee::wire::{Command, Engage};
use tokio::time::{sleep, timeout};

use crate::live::browser::{Page, address, ask};
use crate::mqtt::{Broker, Subscriber};
use crate::rig::{Rig, Run, WAIT_LIMIT, assert_contains, moves, run_spykee, sized, succeed};

/// Asks to drive again and again; after each attempt it sets another volume.
const DRIVE: &str = "local v = 40 while true do robot.move(30, 30, 0.2) v = 81 - v \
                     robot.volume(v) task.wait(0.1) end";
const CONFIG: &str = "service: { user: root }\n\
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
    assert_eq!(drives(rig, from), None, "it moves in spite of STOP");
}

/// The first command that moves the robot.
fn drives(rig: &Rig, from: usize) -> Option<Command> {
    let search = Command::Engine(Engage::Dock);
    let drives = |command: &Command| moves(command) || *command == search;
    rig.commands(from).into_iter().find(drives)
}

/// Waits until the journal has these words: it is written within a second.
async fn recorded(rig: &Rig, words: &str) {
    let history = ["history", "alarms", "--config", "spykee.yaml"];
    let recorded = async {
        while !run_spykee(rig, &history).await.1.contains(words) {
            sleep(Duration::from_millis(50)).await;
        }
    };
    timeout(WAIT_LIMIT, recorded).await.expect("not recorded");
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
    recorded(&rig, "stopped the robot").await;
    run.signal(Signal::KILL);
    run.status().await;
    let free = rig.sim.wait_state(|state| state.user.is_none());
    timeout(WAIT_LIMIT, free).await.expect("the link stays");
    rig.sim.set_battery(18.0);
    let from = rig.sim.heard_count();
    let (mut next, page) = serve(&rig).await;
    next.says("a person's STOP still holds").await;
    let (_, body) = ask(&page, "GET /api/status", "", "").await;
    assert_contains(&body, &["stopped by a person", "\"emergency_stop\":true"]);
    let (_, text) = run_spykee(&rig, &["status"]).await;
    assert_contains(&text, &["stopped by a person"]);
    for args in [
        &["robot", "undock"][..],
        &["robot", "dock"],
        &["behaviour", "start", "drive"],
    ] {
        let (code, text) = run_spykee(&rig, args).await;
        let told = text.contains("spykee robot reset-stop") && text.contains("Let it move again");
        assert_eq!((code, told), (Some(5), true), "{args:?}: {text}");
    }
    assert_eq!(drives(&rig, from), None, "it moves in spite of STOP");
    let (code, text) = run_spykee(&rig, &["robot", "reset-stop"]).await;
    let released = text.contains("the robot may move again");
    assert_eq!((code, released), (Some(0), true), "{text}");
    rig.heard_dock(from).await;
    kept(&rig, false).await;
    recorded(&rig, "goes home, STOP is released").await;
    let (_, text) = run_spykee(&rig, &["history", "docks", "--config", "spykee.yaml"]).await;
    assert!(!text.contains("disconnected"), "no link broke: {text}");
    next.signal(Signal::TERM);
    next.code().await;
    let (_, text) = run_spykee(&rig, &["history", "alarms", "--config", "spykee.yaml"]).await;
    let pressed = "stopped the robot: the API, without a token";
    assert_contains(
        &text,
        &[
            pressed,
            "stays where it is; a person's STOP holds",
            "released the robot: the command line, user ID",
        ],
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_that_was_left_behind_holds_for_every_program_but_simulations() {
    let rig = Rig::quiet().await;
    leave_stop(&rig);
    rig.file("script.lua", DRIVE);
    let run = ["run", "script.lua"];
    for args in [
        &["robot", "undock"][..],
        &["robot", "dock"],
        &["repl"],
        &run,
    ] {
        let robot = ["--robot", &rig.address];
        let (code, text) = run_spykee(&rig, &[args, &robot[..]].concat()).await;
        let helped = text.contains("spykee robot reset-stop");
        assert_eq!((code, helped), (Some(5), true), "{args:?}: {text}");
    }
    let from = rig.sim.heard_count();
    // With a page, where a person can release it, a run begins.
    let live = ["--live=127.0.0.1:0", "--robot", &rig.address];
    let run = rig.spykee(&[&run[..], &live].concat());
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

/// Presses STOP in one of the ways, and returns as soon as it is answered. At the broker, waits for
/// the service to say after the given message that it is there.
async fn press(way: usize, rig: &Rig, page: &str, broker: Option<(&Subscriber, usize)>) {
    match (way % 4, broker) {
        (0, _) => {
            let mut page = Page::open(page, "").await.unwrap();
            page.send_text("{\"type\":\"stop\"}").await;
            let is_answered = |state: &Value| {
                state["emergency_stop"] == true && state["stop_confirmation"] != "sending"
            };
            page.until("state", is_answered).await;
        }
        (1, _) => {
            let text = succeed(rig, &["robot", "stop"]).await;
            assert_contains(&text, &["stopped: ", "the service goes on"]);
        }
        (2, Some((subscriber, before))) => {
            let topic = |what: &str| format!("spykee/SPYKEE0001/{what}");
            subscriber
                .wait_for_text(before, &topic("connection"), "ONLINE")
                .await;
            let from = subscriber.len();
            subscriber.publish(&topic("command"), "stop", false).await;
            subscriber.wait_for(from, &topic("answer"), |_| true).await;
        }
        _ => {
            let (status, body) = ask(page, "POST /api/stop", "", "{}").await;
            assert_eq!(status, 200, "{body}");
            assert_contains(&body, &["\"kept\":\"yes\"", "\"stop_confirmation\":"]);
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_answered_stop_holds_in_the_next_program_even_if_this_one_is_killed_at_once() {
    let rig = Rig::quiet().await;
    let data = rig.folder().join("spykee-data");
    let broker = match Broker::start() {
        Some(broker) => {
            let subscriber = Subscriber::connect(&broker).await;
            Some((broker, subscriber))
        }
        None => None,
    };
    let rounds = sized(20, 200);
    let mut held = 0;
    for round in 0..rounds {
        rig.file("drive.lua", DRIVE);
        let mqtt = broker
            .as_ref()
            .map_or_else(String::new, |(broker, _)| broker.config());
        rig.file("spykee.yaml", &format!("{CONFIG}{mqtt}"));
        let args = [
            "serve",
            "--no-check",
            "--config",
            "spykee.yaml",
            "--robot",
            &rig.address,
        ];
        let subscriber = broker
            .as_ref()
            .map(|(_, subscriber)| (subscriber, subscriber.len()));
        let mut run = rig.spykee(&args);
        let page = address(&run).await;
        run.says("connected").await;
        press(round, &rig, &page, subscriber).await;
        sleep(Duration::from_millis(rand::random_range(0..50))).await;
        run.signal(Signal::KILL);
        run.status().await;
        held += usize::from(EmergencyStop::is_kept(&data));
        let _ = EmergencyStop::remove(&data);
    }
    println!("{held} of {rounds} hold in the next program");
    assert_eq!(held, rounds);
}

/// A small disk in a test's folder; only root may mount one.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn mount(path: &Path) -> Option<SmallDisk> {
        std::fs::create_dir_all(path).unwrap();
        let mut mount = std::process::Command::new("mount");
        mount
            .args(["-t", "tmpfs", "-o", "size=1m,mode=700", "none"])
            .arg(path);
        let mounted = mount.output().is_ok_and(|output| output.status.success());
        if !mounted {
            eprintln!("skipped: this user cannot mount a disk");
        }
        mounted.then(|| SmallDisk(path.to_owned()))
    }

    fn fill(&self) {
        let mut filled = std::fs::File::create(self.0.join("filled")).unwrap();
        while std::io::Write::write_all(&mut filled, &[7; 512]).is_ok() {}
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let mut unmount = std::process::Command::new("umount");
        let _ = unmount.arg("--lazy").arg(&self.0).status();
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_full_disk_keeps_a_stop_and_one_that_cannot_is_told() {
    let rig = Rig::quiet().await;
    let data = rig.folder().join("spykee-data");
    let Some(disk) = SmallDisk::mount(&data) else {
        return;
    };
    let (mut run, page) = serve(&rig).await;
    let spare = data.join(format!(".stop-spare-{}", run.pid().as_raw_nonzero()));
    let stop = async || {
        let (status, body) = ask(&page, "POST /api/stop", "", "{}").await;
        assert_eq!(status, 200, "{body}");
        serde_json::from_str::<Value>(&body).unwrap()
    };
    for has_spare in [true, false] {
        while has_spare != spare.exists() {
            let _ = if has_spare {
                Ok(())
            } else {
                std::fs::remove_file(&spare)
            };
            sleep(Duration::from_millis(10)).await;
        }
        disk.fill();
        let answer = stop().await;
        assert_eq!(answer["kept"], "yes", "{answer}");
        assert!(EmergencyStop::is_kept(&data));
        std::fs::remove_file(data.join("filled")).unwrap();
        let (status, body) = ask(&page, "POST /api/reset-stop", "", "{}").await;
        assert_eq!(status, 200, "{body}");
        assert!(!EmergencyStop::is_kept(&data));
    }
    let _ = std::fs::remove_file(&spare);
    drop(disk);
    // A file is in the place of the data folder, which does not come back.
    while std::fs::write(&data, "").is_err() {
        let _ = std::fs::remove_dir_all(&data);
    }
    let answer = stop().await;
    assert_eq!(answer["kept"], "no", "{answer}");
    assert!(answer["why"].is_string(), "{answer}");
    run.signal(Signal::KILL);
    run.status().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn without_robot_all_runs_are_stopped_and_one_that_hangs_delays_none() {
    let rig = Rig::quiet().await;
    let other = Rig::quiet().await;
    let mut hangs = rig.run(DRIVE);
    rig.file("second.lua", DRIVE);
    let mut second = rig.spykee(&["run", "second.lua", "--robot", &other.address]);
    let mut third = rig.spykee(&["run", "second.lua", "--sim"]);
    for run in [&hangs, &second, &third] {
        run.says("connected").await;
    }
    let moving = other.heard_motion(0).await;
    rig.heard_motion(0).await;
    hangs.signal(Signal::STOP);
    let began = std::time::Instant::now();
    let (code, text) = run_spykee(&rig, &["robot", "stop"]).await;
    println!("robot stop took {:?}", began.elapsed());
    assert_eq!(
        code,
        Some(0),
        "the guardian of the one that hangs serves it: {text}"
    );
    let process = format!("process {}", hangs.pid().as_raw_nonzero());
    assert_contains(&text, &[&process, "the simulated robot ends with its run"]);
    assert!(EmergencyStop::is_kept(&rig.folder().join("spykee-data")));
    other.heard_stop(moving).await;
    assert_eq!(second.code().await, Some(130), "{}", second.text());
    assert_eq!(third.code().await, Some(130), "{}", third.text());
    // It finds the request when it continues, and its robot stands.
    let from = rig.sim.heard_count();
    hangs.signal(Signal::CONT);
    assert_eq!(hangs.code().await, Some(130), "{}", hangs.text());
    rig.heard_stop(from).await;
    succeed(&rig, &["robot", "reset-stop"]).await;
    kept(&rig, false).await;
}
