//! However the agent ends or hangs (killed, stopped, hung, interrupted by any signal), the robot
//! stops. The simulated robot keeps driving when its user disconnects, the worst case of the
//! firmware.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use rustix::process::{
    Pid, Resource, Rlimit, Signal, getrlimit, kill_process, kill_process_group, prlimit,
};
use spykee::guardian::{StopAnswer, request_stop};
use spykee::sim::{Fault, FaultKind, Options, Timing, World};
use spykee::wire::{Command, Engage, Refusal, Report};
use tokio::io::AsyncReadExt as _;
use tokio::net::TcpListener;
use tokio::time::{Instant, timeout};

use crate::rig::{
    QUIET_WORLD, Rig, Run, Stopwatch, WAIT_LIMIT, assert_contains, becomes, near_home, state_of,
};

/// Twice the time that the guardian promises, for a busy machine.
const LIMIT: Duration = Duration::from_secs(2);

const DRIVE: &str = "robot.move(40, 40) task.wait(600)";

/// A robot that drives, and whose guardian has had time to start.
async fn driving() -> (Rig, Run) {
    let rig = Rig::quiet().await;
    let run = rig.run(DRIVE);
    rig.heard_motion(0).await;
    assert!(run.guardian().is_some(), "no guardian: {}", run.text());
    (rig, run)
}

/// Waits until the tracks rest; returns how long that took.
async fn rests(rig: &Rig) -> Duration {
    let began = Stopwatch::start();
    let resting = rig.sim.wait_state(|state| !state.moving());
    timeout(WAIT_LIMIT, resting)
        .await
        .expect("the tracks do not rest");
    began.elapsed()
}

/// Wakes a stopped agent: its first command is a stop, and it sends a low robot home as before.
async fn goes_on_with_a_stop(rig: &Rig, run: &Run) {
    let slept = rig.sim.heard_count();
    run.signal(Signal::CONT);
    rig.heard(slept, |_| true).await;
    assert_eq!(rig.commands(slept)[0], Command::STOP);
    rig.sim.set_battery(10.0);
    rig.heard_dock(slept).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_the_agent_is_killed() {
    let (rig, run) = driving().await;
    run.signal(Signal::KILL);
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_the_agents_process_group_is_killed() {
    use std::os::unix::process::CommandExt as _;
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", DRIVE);
    let mut agent = std::process::Command::new(env!("CARGO_BIN_EXE_spykee"))
        .args(["run", script.to_str().unwrap(), "--robot", &rig.address])
        .current_dir(rig.folder())
        .process_group(0)
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    rig.heard_motion(0).await;
    for signal in [Signal::HUP, Signal::KILL] {
        let _ = kill_process_group(Pid::from_child(&agent), signal);
    }
    agent.wait().unwrap();
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_the_agent_is_stopped_and_the_agent_can_resume() {
    let (rig, run) = driving().await;
    run.signal(Signal::STOP);
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
    tokio::time::sleep(Duration::from_secs(2)).await;
    goes_on_with_a_stop(&rig, &run).await;
}

/// The guardian acts in a hang that is too short to count as a suspension.
#[tokio::test(flavor = "multi_thread")]
async fn an_agent_that_hung_briefly_begins_the_docking_again_that_the_guardian_has_ended() {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let run = rig.run("robot.dock({ retries = 0 }) task.wait(600)");
    let dock = rig.heard_dock(0).await;
    run.signal(Signal::STOP);
    let cancel = Command::Engine(Engage::CancelDock);
    let cancelled = rig.heard(dock, |command| *command == cancel).await;
    run.signal(Signal::CONT);
    rig.heard_dock(cancelled).await;
}

/// The driving thread does not return from a wait, as if it hung in a driver.
#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_the_driving_thread_hangs() {
    let (rig, run) = driving().await;
    let core = thread_called(run.pid(), "core");
    let Some(mut tracer) = crate::slow_system::trace(
        core,
        &[
            "-e",
            "trace=epoll_wait",
            "-e",
            "inject=epoll_wait:delay_exit=8000000",
        ],
    ) else {
        return;
    };
    let took = rests(&rig).await;
    let _ = tracer.kill();
    let _ = tracer.wait();
    // Includes the time until the tracer has started.
    assert!(took < 2 * LIMIT, "{took:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_agent_does_not_end_the_search_of_a_low_robot() {
    let rig = Rig::near_home().await;
    let run = rig.run(DRIVE);
    rig.heard_motion(0).await;
    rig.sim.set_battery(10.0);
    let dock = rig.heard_dock(0).await;
    let searching = rig.sim.wait_state(|state| state.searching);
    timeout(WAIT_LIMIT, searching).await.unwrap();
    run.signal(Signal::KILL);
    let home = rig.sim.wait_state(|state| state.charging);
    timeout(2 * WAIT_LIMIT, home)
        .await
        .expect("the robot does not come home");
    // An agent that is killed between two of its steps may have left the same last words once more.
    let find = Command::Engine(Engage::Dock);
    let later = rig.commands(dock + 1);
    let alone = |pair: &[Command]| pair[0] == Command::STOP && pair[1] != find;
    assert!(!later.windows(2).any(alone), "{later:?}");
    assert_ne!(later.last(), Some(&Command::STOP));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_low_robot_between_two_searches_is_sent_home_by_the_guardian() {
    let firmware = spykee::sim::Firmware {
        search_limit: Duration::from_millis(300),
        ..Default::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    let config = rig.file(
        "spykee.yaml",
        "watchdog: { blind_moves: false, rescue: off, dock_pause: 60 }\n",
    );
    let script = rig.file("script.lua", DRIVE);
    let config = config.to_str().unwrap();
    let script = script.to_str().unwrap();
    let run = rig.spykee(&["run", script, "--robot", &rig.address, "--config", config]);
    rig.heard_motion(0).await;
    rig.sim.hide_station(true);
    rig.sim.set_battery(10.0);
    let dock = rig.heard_dock(0).await;
    let ended = rig.sim.wait_state(|state| !state.searching);
    timeout(WAIT_LIMIT, ended).await.unwrap();
    rig.heard_stop(dock).await;
    let killed = rig.sim.heard_count();
    run.signal(Signal::KILL);
    let again = rig.heard_dock(killed).await;
    let words = [Command::STOP, Command::Engine(Engage::Dock)];
    assert_eq!(rig.commands(again - 1)[..2], words);
}

#[tokio::test(flavor = "multi_thread")]
async fn every_signal_that_ends_a_program_ends_a_run_in_order() {
    for signal in [
        Signal::INT,
        Signal::TERM,
        Signal::HUP,
        Signal::QUIT,
        Signal::USR1,
        Signal::USR2,
        Signal::ALARM,
        Signal::VTALARM,
        Signal::XCPU,
    ] {
        let (rig, mut run) = driving().await;
        let told = rig.sim.heard_count();
        run.signal(signal);
        rig.heard_stop(told).await;
        assert_eq!(run.code().await, Some(130), "{signal:?}: {}", run.text());
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn ctrl_z_stops_the_tracks_before_it_stops_the_program() {
    let (rig, run) = driving().await;
    let told = rig.sim.heard_count();
    run.signal(Signal::TSTP);
    rig.heard_stop(told).await;
    becomes(run.pid(), 'T').await;
    rests(&rig).await;
    goes_on_with_a_stop(&rig, &run).await;
}

/// The sockets that a process holds.
fn sockets_of(process: Pid) -> BTreeSet<PathBuf> {
    let open = std::fs::read_dir(format!("/proc/{}/fd", process.as_raw_nonzero())).unwrap();
    let open = open.filter_map(|entry| std::fs::read_link(entry.ok()?.path()).ok());
    open.filter(|path| path.to_string_lossy().starts_with("socket:"))
        .collect()
}

/// Waits until agent and guardian share a link other than these: the socket of the robot.
async fn guarded_link(run: &Run, but: &[PathBuf]) -> PathBuf {
    let guardian = run.guardian().unwrap();
    let shared = async {
        loop {
            let sockets = sockets_of(guardian);
            let agents = sockets_of(run.pid());
            let mut shared = sockets.intersection(&agents).cloned();
            if let Some(link) = shared.find(|link| !but.contains(link)) {
                return link;
            }
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    };
    let waited = timeout(WAIT_LIMIT, shared).await;
    waited.expect("the guardian has no link")
}

/// A robot that drives on after its link was cut, and whose agent logs in again: the login is
/// accepted, and the guardian has its socket, but the battery level comes this much later.
async fn logging_in(power_after_login: Duration) -> (Rig, Run) {
    let firmware = spykee::sim::Firmware {
        power_after_login,
        ..Default::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    let run = rig.run(DRIVE);
    rig.heard_motion(0).await;
    let lost = guarded_link(&run, &[]).await;
    let from = rig.sim.heard_count();
    rig.sim.disconnect_all();
    rig.heard(from, |command| matches!(command, Command::Login(_)))
        .await;
    assert!(rig.sim.state().moving());
    guarded_link(&run, &[lost]).await;
    (rig, run)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_the_agent_is_killed_or_stopped_during_a_login() {
    for signal in [Signal::KILL, Signal::STOP] {
        let (rig, run) = logging_in(Duration::from_secs(2)).await;
        let told = rig.sim.heard_count();
        run.signal(signal);
        rig.heard_stop(told).await;
        rests(&rig).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_that_is_interrupted_during_a_login_stops_the_robot_first() {
    let (rig, mut run) = logging_in(Duration::from_secs(1)).await;
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    let said = run.text().contains("has executed the stop");
    assert!(said, "{}", run.text());
    rests(&rig).await;
}

/// The run ends before the robot obeys: the guardian completes its end.
#[tokio::test(flavor = "multi_thread")]
async fn a_run_that_is_interrupted_during_a_slow_login_leaves_the_stop_to_the_guardian() {
    let (rig, mut run) = logging_in(Duration::from_secs(5)).await;
    let told = rig.sim.heard_count();
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    rig.heard_stop(told).await;
    rests(&rig).await;
}

/// What the robot did before is not known, and it obeys nothing before its first POWER.
#[tokio::test(flavor = "multi_thread")]
async fn a_first_login_that_hangs_is_left_to_the_guardian() {
    for signal in [Signal::KILL, Signal::STOP, Signal::INT] {
        let firmware = spykee::sim::Firmware {
            power_after_login: Duration::from_secs(4),
            ..Default::default()
        };
        let rig = Rig::new(QUIET_WORLD, firmware).await;
        let run = rig.run(DRIVE);
        rig.heard(0, |command| matches!(command, Command::Login(_)))
            .await;
        guarded_link(&run, &[]).await;
        let told = rig.sim.heard_count();
        run.signal(signal);
        rig.heard_stop(told).await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_ignores_signals_to_the_agents_group() {
    let (rig, run) = driving().await;
    let guardian = run.guardian().unwrap();
    for signal in [
        Signal::HUP,
        Signal::INT,
        Signal::TERM,
        Signal::QUIT,
        Signal::TSTP,
    ] {
        kill_process(guardian, signal).unwrap();
    }
    run.signal(Signal::KILL);
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_ends_with_a_run_that_ends_in_order() {
    let (_rig, mut run) = driving().await;
    let guardian = run.guardian().unwrap();
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(130));
    let gone = async {
        while !matches!(state_of(guardian), '?' | 'Z') {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, gone).await.expect("it has not ended");
}

#[tokio::test(flavor = "multi_thread")]
async fn with_little_memory_hosts_are_killed_before_the_agent() {
    let (_rig, run) = driving().await;
    for host in run.hosts() {
        let path = format!("/proc/{}/oom_score_adj", host.as_raw_nonzero());
        assert_eq!(std::fs::read_to_string(path).unwrap().trim(), "500");
    }
}

/// Waits until a guardian other than this one has started.
async fn replaced(run: &Run, old: Pid) {
    run.says("another guardian process watches").await;
    // On a busy machine that one may have been replaced again.
    let another = async {
        while run.guardian().is_none_or(|pid| pid == old) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, another)
        .await
        .expect("no other guardian");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_guardian_that_is_killed_is_replaced() {
    let (rig, run) = driving().await;
    for _ in 0..2 {
        let before = run.text().matches("another guardian").count();
        let old = run.guardian().unwrap();
        kill_process(old, Signal::KILL).unwrap();
        let again = async {
            while run.text().matches("another guardian").count() == before {
                tokio::time::sleep(Duration::from_millis(10)).await;
            }
        };
        timeout(WAIT_LIMIT, again).await.expect("no new guardian");
        replaced(&run, old).await;
    }
    run.signal(Signal::KILL);
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

/// A script that drives on whenever it may.
const DRIVE_ON: &str = "while true do robot.move(40, 40) task.wait(0.1) end";

#[tokio::test(flavor = "multi_thread")]
async fn without_a_guardian_nothing_drives_until_there_is_another_one() {
    for signal in [Signal::KILL, Signal::STOP] {
        let rig = Rig::quiet().await;
        let run = rig.run(DRIVE_ON);
        rig.heard_motion(0).await;
        let old = run.guardian().unwrap();
        let from = rig.sim.heard_count();
        kill_process(old, signal).unwrap();
        let stop = rig.heard_stop(from).await;
        // The guardian wrote nothing itself.
        let cancel = Command::Engine(Engage::CancelDock);
        assert!(!rig.commands(from).contains(&cancel) || run.has_stalled().await);
        run.says("no guardian process answers").await;
        replaced(&run, old).await;
        assert!(matches!(state_of(old), '?' | 'Z'), "it is gone");
        rig.heard_motion(stop).await;
        run.signal(Signal::KILL);
        let took = rests(&rig).await;
        assert!(took < LIMIT, "{took:?}");
    }
}

/// The lowest number that a process has no open file for between its attempts to connect.
async fn next_descriptor(pid: Pid) -> u64 {
    let mut lowest = u64::MAX;
    for _ in 0..20 {
        let open = std::fs::read_dir(format!("/proc/{}/fd", pid.as_raw_nonzero())).unwrap();
        let open: BTreeSet<u64> = open
            .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok())
            .collect();
        lowest = lowest.min((0..).find(|number| !open.contains(number)).unwrap());
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    lowest
}

fn limit_descriptors(pid: Pid, current: Option<u64>) -> Option<u64> {
    let limits = getrlimit(Resource::Nofile);
    let limits = Rlimit { current, ..limits };
    prlimit(Some(pid), Resource::Nofile, limits)
        .unwrap()
        .current
}

/// The guardian could not stop a robot over this link if the agent died.
#[tokio::test(flavor = "multi_thread")]
async fn a_link_whose_socket_cannot_be_duplicated_for_the_guardian_is_not_used() {
    let home = Rig::quiet().await;
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    home.file("script.lua", DRIVE);
    let robot = address.to_string();
    let run = home.spykee(&["run", "script.lua", "--robot", &robot, "--wait"]);
    run.says("trying until it answers").await;
    // One more is the socket itself.
    let one_more = next_descriptor(run.pid()).await + 1;
    let usual = limit_descriptors(run.pid(), Some(one_more));

    let listener = TcpListener::bind(address).await.unwrap();
    let (mut link, _) = timeout(WAIT_LIMIT, listener.accept())
        .await
        .unwrap()
        .unwrap();
    let mut heard = Vec::new();
    let ended = timeout(WAIT_LIMIT, link.read_to_end(&mut heard)).await;
    ended.expect("the link is kept").unwrap();
    assert!(heard.is_empty(), "it has logged in: {heard:?}");
    run.says("no guardian process can watch this link").await;

    limit_descriptors(run.pid(), usual);
    drop((link, listener));
    let options = Options {
        listen: address,
        ..Options::default()
    };
    let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
    let rig = Rig::with(world, options).await;
    rig.heard_motion(0).await;
    run.signal(Signal::KILL);
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

/// Processes other than this one whose name `pkill spykee` would match.
fn called_spykee(pids: impl IntoIterator<Item = Pid>) -> Vec<Pid> {
    let comm = |pid: &Pid| std::fs::read_to_string(format!("/proc/{}/comm", pid.as_raw_nonzero()));
    let matches = |pid: &Pid| comm(pid).is_ok_and(|comm| comm.contains("spykee"));
    pids.into_iter().filter(matches).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_every_process_of_the_programs_name_is_killed() {
    let (rig, run) = driving().await;
    let guardian = run.guardian().unwrap();
    let family = crate::rig::children_of(run.pid());
    let victims = called_spykee(family.into_iter().chain([run.pid()]));
    assert!(victims.contains(&run.pid()) && !victims.contains(&guardian));
    for victim in victims {
        let _ = kill_process(victim, Signal::KILL);
    }
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn another_guardian_starts_though_the_programs_file_was_replaced() {
    let rig = Rig::quiet().await;
    let program = rig.folder().join("program");
    // A file that this process writes cannot be run while a child of another test, just forked,
    // has it open, too.
    let copied = std::process::Command::new("cp")
        .arg(env!("CARGO_BIN_EXE_spykee"))
        .arg(&program)
        .status();
    assert!(copied.unwrap().success());
    let script = rig.file("script.lua", DRIVE_ON);
    let mut agent = std::process::Command::new(&program)
        .args(["run", script.to_str().unwrap(), "--robot", &rig.address])
        .current_dir(rig.folder())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    rig.heard_motion(0).await;
    let pid = Pid::from_child(&agent);
    let old = crate::rig::guardian_of(pid).unwrap();
    let upgrade = rig.file("upgrade", "not a program");
    std::fs::rename(upgrade, &program).unwrap();
    let from = rig.sim.heard_count();
    kill_process(old, Signal::KILL).unwrap();
    let stop = rig.heard_stop(from).await;
    rig.heard_motion(stop).await;
    assert_ne!(crate::rig::guardian_of(pid), Some(old));
    agent.kill().unwrap();
    agent.wait().unwrap();
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

// A stop that is owed.

/// A robot that drives, in a simulator that can have faults.
async fn driving_into_faults() -> (Rig, Run) {
    let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
    let options = Options {
        faults: Some(vec![]),
        ..Options::default()
    };
    let rig = Rig::with(world, options).await;
    let run = rig.run(DRIVE);
    rig.heard_motion(0).await;
    (rig, run)
}

const SECOND: Duration = Duration::from_secs(1);

fn lasting(kind: FaultKind, lasts: Duration) -> Fault {
    let mut fault = Fault::new(kind);
    fault.timing = Timing {
        lasts: Some(lasts),
        ..fault.timing
    };
    fault
}

/// Begins a fault that keeps the agent out, waits until the agent knows, and kills it with this
/// signal; the robot drives on until a stop is heard after the fault.
async fn killed_during(kind: FaultKind, signals: &[Signal]) {
    const LASTS: Duration = Duration::from_secs(5);
    let (rig, run) = driving_into_faults().await;
    let from = rig.sim.heard_count();
    let began = Instant::now();
    let watch = Stopwatch::start();
    rig.sim.begin(lasting(kind, LASTS));
    rig.sim.disconnect_all();
    run.says("reconnecting").await;
    // Past the first attempt to reconnect.
    tokio::time::sleep(SECOND).await;
    let guardian = run.guardian().unwrap();
    for signal in signals {
        run.signal(*signal);
    }
    assert!(rig.sim.state().moving());
    rests(&rig).await;
    let took = began.elapsed();
    let limit = LASTS + 2 * LIMIT + watch.stalled();
    assert!(LASTS <= took && took < limit, "{took:?}");
    rig.heard_stop(from).await;
    let gone = async {
        while !matches!(state_of(guardian), '?' | 'Z') {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, gone).await.expect("it has not ended");
    let record = std::fs::read_to_string(rig.folder().join("spykee-data/guardian.log")).unwrap();
    let dials = format!("the robot may be driving: dialling {}", rig.address);
    assert_contains(&record, &[&dials, "the robot has executed the stop after"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_dials_when_the_agent_is_killed_in_the_pause_of_a_reconnect() {
    killed_during(FaultKind::RefuseLogin(Refusal::InUse), &[Signal::KILL]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_dials_when_the_agent_is_killed_out_of_reach() {
    killed_during(FaultKind::Reboot { forgets: false }, &[Signal::KILL]).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_dials_when_a_run_out_of_reach_is_ended_and_then_killed() {
    let signals = [Signal::TERM, Signal::KILL];
    killed_during(FaultKind::Reboot { forgets: false }, &signals).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_after_a_kill_during_a_login_with_much_video_before_the_first_power() {
    let (rig, run) = logging_in(Duration::from_secs(2)).await;
    let told = rig.sim.heard_count();
    run.signal(Signal::KILL);
    for _ in 0..20 {
        let frame = bytes::Bytes::from_static(&[7; 10_000]);
        rig.sim.inject(Report::Video(frame));
        // The simulator drops frames that are queued behind others.
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    rig.heard_stop(told).await;
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

// A person's STOP.

async fn ask_to_stop(path: &std::path::Path) -> StopAnswer {
    let path = path.to_owned();
    let asked = tokio::task::spawn_blocking(move || request_stop(&path));
    asked.await.unwrap().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_serves_a_persons_stop_in_place_of_an_agent_that_hangs() {
    let rig = Rig::near_home().await;
    rig.sim.hide_station(true);
    let mut run = rig.run(DRIVE);
    rig.heard_motion(0).await;
    rig.sim.set_battery(10.0);
    let dock = rig.heard_dock(0).await;
    let name = format!("spykee-data/.run/{}.guardian", run.pid().as_raw_nonzero());
    let path = rig.folder().join(name);
    let opened = async {
        while !path.exists() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, opened).await.expect("it has no socket");
    assert_eq!(ask_to_stop(&path).await, StopAnswer::Alive);
    run.signal(Signal::STOP);
    becomes(run.pid(), 'T').await;
    let hung = async {
        while ask_to_stop(&path).await == StopAnswer::Alive {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    timeout(WAIT_LIMIT, hung).await.expect("it does not hang");
    rig.heard_cancel(dock).await;
    rests(&rig).await;
    run.signal(Signal::KILL);
    run.code().await;
    let gone = async {
        while path.exists() {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, gone).await.expect("its socket is left");
    // The guardian's last words were the STOP, though the battery is low.
    ends_with_a_stop(&rig, dock);
}

fn ends_with_a_stop(rig: &Rig, from: usize) {
    let tracks = |command: &Command| matches!(command, Command::Move { .. } | Command::Engine(_));
    let last = rig.commands(from).into_iter().rfind(tracks);
    assert_eq!(last, Some(Command::STOP));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_guardian_inherits_no_descriptors_of_the_run() {
    let rig = Rig::quiet().await;
    let script = rig.file("script.lua", DRIVE);
    let kept = rig.file("kept", "");
    let line = "exec 9<kept; exec \"$0\" run \"$1\" --robot \"$2\"";
    let mut agent = std::process::Command::new("sh")
        .args(["-c", line, env!("CARGO_BIN_EXE_spykee")])
        .args([script.to_str().unwrap(), &rig.address])
        .current_dir(rig.folder())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    rig.heard_motion(0).await;
    let holds = |pid: Pid| {
        let open = std::fs::read_dir(format!("/proc/{}/fd", pid.as_raw_nonzero())).unwrap();
        let mut open = open.filter_map(|entry| std::fs::read_link(entry.unwrap().path()).ok());
        open.any(|path| path == kept)
    };
    let pid = Pid::from_child(&agent);
    let guardian = crate::rig::guardian_of(pid).unwrap();
    assert!(holds(pid), "the agent did not inherit it");
    assert!(!holds(guardian));
    agent.kill().unwrap();
    agent.wait().unwrap();
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

/// Lines typed into `spykee repl` through a pipe that stays open.
fn prompt(rig: &Rig, lines: &str) -> (Run, std::process::ChildStdin) {
    let (run, mut pipe) = rig.spykee_with_pipe(&["repl", "--robot", &rig.address]);
    std::io::Write::write_all(&mut pipe, lines.as_bytes()).unwrap();
    (run, pipe)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_a_prompt_is_killed() {
    let rig = Rig::quiet().await;
    let (run, _pipe) = prompt(&rig, "robot.move(40, 40)\n");
    rig.heard_motion(0).await;
    run.signal(Signal::KILL);
    let took = rests(&rig).await;
    assert!(took < LIMIT, "{took:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn ctrl_z_stops_the_robot_of_a_prompt_and_every_ending_signal_ends_it_in_order() {
    let rig = Rig::quiet().await;
    let (run, _pipe) = prompt(&rig, "robot.move(40, 40)\n");
    let moving = rig.heard_motion(0).await;
    run.signal(Signal::TSTP);
    rig.heard_stop(moving).await;
    becomes(run.pid(), 'T').await;
    goes_on_with_a_stop(&rig, &run).await;
    drop(run);
    for signal in [
        Signal::INT,
        Signal::HUP,
        Signal::QUIT,
        Signal::USR1,
        Signal::ALARM,
    ] {
        let rig = Rig::quiet().await;
        let (mut run, _pipe) = prompt(&rig, "robot.move(40, 40)\n");
        let moving = rig.heard_motion(0).await;
        run.signal(signal);
        rig.heard_stop(moving).await;
        assert_eq!(run.code().await, Some(130), "{signal:?}: {}", run.text());
        let said = run.text().contains("has executed the stop");
        assert!(said, "{signal:?}: {}", run.text());
    }
}

/// A robot that searches its station, started by `spykee robot dock`.
async fn docking() -> (Rig, Run) {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let run = rig.spykee(&["robot", "dock", "--robot", &rig.address]);
    rig.heard_dock(0).await;
    let searching = rig
        .sim
        .wait_state(|state| state.searching && state.moving());
    timeout(WAIT_LIMIT, searching).await.unwrap();
    (rig, run)
}

#[tokio::test(flavor = "multi_thread")]
async fn the_robot_stops_when_a_docking_tool_is_killed_stopped_or_ended_by_any_signal() {
    for signal in [Signal::KILL, Signal::STOP] {
        let (rig, run) = docking().await;
        run.signal(signal);
        let took = rests(&rig).await;
        assert!(took < LIMIT, "{signal:?}: {took:?}");
    }
    let (rig, run) = docking().await;
    let told = rig.sim.heard_count();
    run.signal(Signal::TSTP);
    rig.heard_stop(told).await;
    becomes(run.pid(), 'T').await;
    rests(&rig).await;
    for signal in [Signal::HUP, Signal::QUIT, Signal::USR2] {
        let (rig, mut run) = docking().await;
        run.signal(signal);
        assert_eq!(run.code().await, Some(130), "{signal:?}: {}", run.text());
        let said = run.text().contains("has executed the stop");
        assert!(said, "{signal:?}: {}", run.text());
        rests(&rig).await;
    }
}

/// The last command about the tracks of a low robot is a search, and it is under way.
pub fn ends_with_a_search(rig: &Rig, from: usize) {
    let tracks = |command: &Command| matches!(command, Command::Move { .. } | Command::Engine(_));
    let last = rig.commands(from).into_iter().rfind(tracks);
    assert_eq!(last, Some(Command::Engine(Engage::Dock)));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_prompt_stays_until_a_low_robot_is_home() {
    let rig = Rig::near_home().await;
    let (mut run, pipe) = prompt(&rig, "robot.move(20, 20)\n");
    rig.heard_motion(0).await;
    rig.sim.set_battery(15.0);
    rig.heard_dock(0).await;
    drop(pipe);
    assert_eq!(run.code().await, Some(5), "{}", run.text());
    let said = run
        .text()
        .contains("staying until the robot is on its station");
    assert!(said, "{}", run.text());
    let state = rig.sim.state();
    assert!(state.docked && state.charging, "{state:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_docking_tool_brings_a_low_robot_home_or_ctrl_c_leaves_it_searching() {
    let world = near_home().replace("level: 90", "level: 15");
    let rig = Rig::new(&world, Default::default()).await;
    let mut run = rig.spykee(&["robot", "dock", "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert!(rig.sim.state().docked);

    let rig = Rig::new(&world, Default::default()).await;
    rig.sim.hide_station(true);
    let mut run = rig.spykee(&["robot", "dock", "--robot", &rig.address]);
    let dock = rig.heard_dock(0).await;
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(5), "{}", run.text());
    ends_with_a_search(&rig, dock);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_tool_that_only_reads_does_not_end_the_search_of_a_low_robot() {
    let world = QUIET_WORLD.replace("level: 90", "level: 15");
    for tool in [&["battery"][..], &["led", "flash", "on"], &["config"]] {
        let rig = Rig::new(&world, Default::default()).await;
        rig.sim.hide_station(true);
        let mut run = rig.spykee(&[&["robot"], tool, &["--robot", &rig.address]].concat());
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let said = run.text().contains("was told to search for its station");
        assert!(said, "{}", run.text());
        ends_with_a_search(&rig, 0);
    }
    let rig = Rig::new(&world, Default::default()).await;
    let mut run = rig.spykee(&["robot", "stop", "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    assert_contains(&text, &["has executed the stop", "the battery is low"]);
    let dock = Command::Engine(Engage::Dock);
    assert!(!rig.commands(0).contains(&dock));
}

/// The thread of a process with this name.
pub fn thread_called(process: Pid, name: &str) -> Pid {
    let tasks = std::fs::read_dir(format!("/proc/{}/task", process.as_raw_nonzero())).unwrap();
    let mut tasks = tasks.map(|task| task.unwrap().path());
    let named = |path: &std::path::PathBuf| {
        std::fs::read_to_string(path.join("comm")).is_ok_and(|comm| comm.trim() == name)
    };
    let path = tasks.find(named).expect("no thread of that name");
    let number = path.file_name().unwrap().to_str().unwrap();
    Pid::from_raw(number.parse().unwrap()).unwrap()
}
