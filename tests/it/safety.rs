//! The safety promises from the robot's view: the real binary drives a simulated robot.

use std::time::Duration;

use rustix::process::Signal;
use spykee::sim::{Firmware, FirmwareBehaviour};
use spykee::wire::{Command, Engage, EngineReport, Led, Packet, Power, Report, Sound, kind};
use tokio::time::timeout;

use crate::rig::{QUIET_WORLD, Rig, Stopwatch, WAIT_LIMIT, assert_contains, moves};

/// Drives and then never waits again; switches a light on just before the loop.
const STUCK: &str = "robot.move(50, 50)\ntask.wait(0.3)\nrobot.led('left', true)\ntask.wait(0)\nwhile true do end\n";
/// The same, inside a library function that has no safepoint.
const STUCK_IN_C: &str = "robot.move(50, 50)\ntask.wait(0.3)\nrobot.led('left', true)\ntask.wait(0)\ntable.move({}, 1, 2e9, -2e9, {})\nwhile true do end\n";

/// The command that shows that the loop begins.
fn block_begins(command: &Command) -> bool {
    *command
        == Command::Led {
            led: Led::Left,
            on: true,
        }
}

fn power(percent: u8) -> Report {
    Report::Power(Power {
        percent,
        charging: false,
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stuck_script_is_stopped_within_600_ms_and_the_reason_is_named() {
    for script in [STUCK, STUCK_IN_C] {
        let rig = Rig::quiet().await;
        let mut run = rig.run(script);
        let moving = rig.heard_motion(0).await;
        let watch = Stopwatch::start();
        let block = rig.heard(moving, block_begins).await;
        let stop = rig.heard_stop(block).await;
        let gap = (rig.at(stop).0 - rig.at(block).0).saturating_sub(watch.stalled());
        assert!(gap < Duration::from_millis(600), "{gap:?}");
        assert_eq!(run.code().await, Some(1), "{}", run.text());
        assert_contains(&run.text(), &["cpu"]);
        assert!(!rig.commands(stop).iter().any(moves));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_low_battery_stops_and_sends_home_in_one_write_while_a_script_is_stuck() {
    for script in [STUCK, STUCK_IN_C] {
        let rig = Rig::quiet().await;
        let _run = rig.run(script);
        let moving = rig.heard_motion(0).await;
        let block = rig.heard(moving, block_begins).await;
        let injected = Stopwatch::start();
        rig.sim.inject(power(10));
        let dock = rig.heard_dock(block).await;
        // A limit for a busy machine; on an idle one it takes less than 50 ms.
        assert!(
            injected.elapsed() < Duration::from_millis(500),
            "{:?}",
            injected.elapsed()
        );
        let stop = dock - 1;
        assert_eq!(rig.commands(stop)[0], Command::STOP);
        assert_eq!(rig.at(stop).1, rig.at(dock).1, "in one write");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn while_low_no_script_moves_the_robot() {
    let rig = Rig::quiet().await;
    let run = rig.run(
        "while true do\n\
         local ok, code = robot.move(40, 40, 0.5)\n\
         print('moved', ok, code)\n\
         task.wait(0.05)\n\
         end\n",
    );
    let moving = rig.heard_motion(0).await;
    rig.sim.hide_station(true);
    rig.sim.set_battery(15.0);
    let dock = rig.heard_dock(moving).await;
    run.says("moved false safety").await;
    run.says("moved false safety").await;
    assert!(
        !rig.commands(dock).iter().any(moves),
        "{:?}",
        rig.commands(dock)
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn one_garbage_level_neither_releases_a_low_robot_nor_ends_its_search() {
    let rig = Rig::quiet().await;
    let run = rig.run(
        "robot.on('engine', function(e) print('engine', e.code, robot.move(40, 40, 0.3)) end)\n\
         while true do robot.move(40, 40, 0.3) task.wait(0.05) end\n",
    );
    let moving = rig.heard_motion(0).await;
    rig.sim.hide_station(true);
    rig.sim.set_battery(10.0);
    let dock = rig.heard_dock(moving).await;
    let charging = |percent| {
        let charging = true;
        Report::Power(Power { percent, charging })
    };
    let beyond = |byte: u8| Report::Unknown(Packet::new(kind::POWER, vec![byte]));
    let garbage = [
        beyond(127),
        power(60),
        beyond(0x80),
        power(100),
        charging(60),
        power(10),
        charging(10),
    ];
    for (code, report) in (100..).zip(garbage) {
        rig.sim.inject(report);
        rig.sim.inject(Report::Engine(EngineReport::Unknown(code)));
        run.says(&format!("engine {code} false safety")).await;
    }
    let heard = rig.commands(dock);
    let frees = |command: &Command| *command == Command::Engine(Engage::CancelDock);
    assert!(
        !heard.iter().any(|one| moves(one) || frees(one)),
        "{heard:?}"
    );
    let finds = |command: &&Command| **command == Command::Engine(Engage::Dock);
    assert_eq!(heard.iter().filter(finds).count(), 1, "{heard:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_watchdog_brings_a_low_robot_home_and_it_charges() {
    let rig = Rig::near_home().await;
    let _run = rig.run("robot.move(20, 20) task.wait(600)");
    rig.heard_motion(0).await;
    rig.sim.set_battery(15.0);
    rig.heard_dock(0).await;
    let charging = rig.sim.wait_state(|state| state.docked && state.charging);
    timeout(WAIT_LIMIT * 2, charging)
        .await
        .expect("not docked and charging");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_low_robot_that_cannot_get_home_stands_still_sounds_the_alarm_and_searches_again() {
    let search_limit = Duration::from_millis(200);
    let rig = Rig::new(
        QUIET_WORLD,
        Firmware {
            search_limit,
            ..Firmware::default()
        },
    )
    .await;
    rig.sim.hide_station(true);
    let config = rig.file(
        "spykee.yaml",
        "watchdog: { dock_pause: 0.1, blind_moves: false, rescue: off }\n",
    );
    let script = rig.file(
        "script.lua",
        "while true do robot.move(30, 30) task.wait(0.2) end",
    );
    let script = script.to_str().unwrap();
    let config = config.to_str().unwrap();
    let args = ["run", script, "--config", config, "--robot", &rig.address];
    let run = rig.spykee(&args);
    rig.heard_motion(0).await;
    rig.sim.set_battery(15.0);
    let first = rig.heard_dock(0).await;
    let alarm = |command: &Command| *command == Command::Play(Sound::Alarm);
    let sounded = rig.heard(first, alarm).await;
    let again = rig.heard(sounded + 1, alarm).await;
    rig.heard(again, |command| {
        *command
            == Command::Led {
                led: Led::Flash,
                on: false,
            }
    })
    .await;
    let mut search = first;
    for _ in 0..6 {
        search = rig.heard_dock(search + 1).await;
    }
    let heard = rig.commands(first);
    assert!(!heard.iter().any(moves), "{heard:?}");
    run.says("ALARM").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn scripts_cannot_silence_the_alarm() {
    let search_limit = Duration::from_millis(200);
    let firmware = Firmware {
        search_limit,
        ..Firmware::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    rig.sim.hide_station(true);
    let config = rig.file(
        "spykee.yaml",
        "watchdog: { dock_pause: 0.1, blind_moves: false, rescue: off }\n",
    );
    let script = rig.file(
        "script.lua",
        "robot.stream('audio_out', true)\n\
         while true do\n\
         robot.volume(0) robot.stop_sound() robot.led('flash', false) robot.play('bip_2')\n\
         robot.say(buffer.create(3200))\n\
         task.wait(0.1)\n\
         end\n",
    );
    let script = script.to_str().unwrap();
    let config = config.to_str().unwrap();
    let _run = rig.spykee(&["run", script, "--config", config, "--robot", &rig.address]);
    let hushed = rig.heard(0, |command| *command == Command::Volume(0)).await;
    rig.heard(hushed, |command| *command == Command::StopSound)
        .await;
    rig.sim.set_battery(15.0);
    let alarm = |command: &Command| *command == Command::Play(Sound::Alarm);
    let first = rig.heard(hushed, alarm).await;
    let last = rig.heard(first + 1, alarm).await;
    assert_eq!(rig.commands(first - 1)[0], Command::Volume(100));
    assert_eq!(rig.at(first - 1).1, rig.at(first).1, "in one write");
    let heard = rig.commands_between(first, last);
    let silences = |command: &Command| match command {
        Command::Volume(percent) => *percent < 100,
        Command::Play(sound) => *sound != Sound::Alarm,
        Command::StopSound => true,
        _ => false,
    };
    assert!(!heard.iter().any(silences), "{heard:?}");
    let speaks = |command: &&Command| matches!(command, Command::Audio(_));
    // One message may have been partly written.
    assert!(heard.iter().filter(speaks).count() <= 1, "{heard:?}");
    let dark = Command::Led {
        led: Led::Flash,
        on: false,
    };
    let lit = Command::Led {
        led: Led::Flash,
        on: true,
    };
    let flash: Vec<&Command> = heard
        .iter()
        .filter(|one| **one == dark || **one == lit)
        .collect();
    assert_eq!(flash, [&lit, &dark], "the watchdog's own");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_interrupt_stops_the_tracks_before_the_link_closes() {
    for signal in [Signal::INT, Signal::TERM] {
        let rig = Rig::quiet().await;
        let mut run = rig.run("robot.move(50, 50) task.wait(600)");
        let moving = rig.heard_motion(0).await;
        run.signal(signal);
        let interrupted = Stopwatch::start();
        rig.heard_stop(moving).await;
        assert_eq!(run.code().await, Some(130), "{}", run.text());
        assert!(
            interrupted.elapsed() < Duration::from_secs(3),
            "{:?}",
            interrupted.elapsed()
        );
        timeout(WAIT_LIMIT, rig.sim.wait_state(|state| state.user.is_none()))
            .await
            .unwrap();
        let last = rig
            .commands(moving)
            .into_iter()
            .rfind(|c| matches!(c, Command::Move { .. }));
        assert_eq!(last, Some(Command::STOP));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_interrupt_ends_a_stuck_script_in_time() {
    let rig = Rig::quiet().await;
    let config = rig.file("spykee.yaml", "limits: { callback_budget_ms: 10000 }\n");
    let script = rig.file(
        "script.lua",
        "robot.led('left', true) task.wait(0.1) while true do end",
    );
    let script = script.to_str().unwrap();
    let config = config.to_str().unwrap();
    let mut run = rig.spykee(&["run", script, "--config", config, "--robot", &rig.address]);
    rig.heard(0, block_begins).await;
    tokio::time::sleep(Duration::from_millis(200)).await;
    run.signal(Signal::INT);
    let interrupted = Stopwatch::start();
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    assert!(
        interrupted.elapsed() < Duration::from_secs(3),
        "{:?}",
        interrupted.elapsed()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_host_no_longer_moves_the_robot() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("robot.move(50, 50) task.wait(600)");
    let moving = rig.heard_motion(0).await;
    let hosts = run.hosts();
    assert_eq!(hosts.len(), 1);
    rustix::process::kill_process(hosts[0], Signal::KILL).unwrap();
    let stop = rig.heard_stop(moving).await;
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    assert_contains(&run.text(), &["signal: 9"]);
    assert!(!rig.commands(stop).iter().any(moves));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frozen_host_is_stopped_and_ended() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("robot.move(50, 50) task.wait(600)");
    let moving = rig.heard_motion(0).await;
    rustix::process::kill_process(run.hosts()[0], Signal::STOP).unwrap();
    let stop = rig.heard_stop(moving).await;
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    assert_contains(&run.text(), &["showed no life"]);
    assert!(!rig.commands(stop).iter().any(moves));
}

#[tokio::test(flavor = "multi_thread")]
async fn hosts_do_not_outlive_their_agent() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("robot.led('left', true) task.wait(600)");
    rig.heard(0, block_begins).await;
    let hosts = run.hosts();
    run.signal(Signal::KILL);
    run.status().await;
    let gone = async {
        while hosts
            .iter()
            .any(|&host| rustix::process::test_kill_process(host).is_ok())
        {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, gone)
        .await
        .expect("the host is still there");
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_lost_link_the_first_command_is_a_stop() {
    let rig = Rig::quiet().await;
    let run = rig.run(
        "while true do\n\
         robot.move(40, 40)\n\
         task.wait(0.1)\n\
         end\n",
    );
    let moving = rig.heard_motion(0).await;
    let first = rig.sim.heard_since(moving)[0].client;
    rig.sim.disconnect_all();
    run.says("disconnected").await;
    let again = async {
        loop {
            let index = rig.heard_motion(rig.sim.heard_count()).await;
            if rig.sim.heard_since(index)[0].client > first {
                return;
            }
        }
    };
    timeout(WAIT_LIMIT, again)
        .await
        .expect("it does not drive again");
    let heard = rig.sim.heard_since(moving);
    let second_session: Vec<&Command> = heard
        .iter()
        .filter(|heard| heard.client > first)
        .map(|heard| &heard.command)
        .collect();
    assert!(
        matches!(second_session[0], Command::Login(_)),
        "{second_session:?}"
    );
    assert_eq!(second_session[1], &Command::STOP, "{second_session:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_end_of_a_docking_that_the_link_lost_reaches_the_robot_after_the_reconnect() {
    let firmware = Firmware {
        move_while_searching: FirmwareBehaviour::Ignored,
        search_limit: WAIT_LIMIT * 10,
        ..Firmware::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    rig.sim.hide_station(true);
    let run = rig.run(
        "print('ended', robot.dock({ timeout = 5, retries = 0 }))\n\
         task.wait(600)\n",
    );
    let asked = rig.heard_dock(0).await;
    // What a muted robot has not read is lost with the connection.
    rig.sim.mute(true);
    run.says("ended false timeout").await;
    rig.sim.disconnect_all();
    let alone = rig.sim.wait_state(|state| state.user.is_none());
    timeout(WAIT_LIMIT, alone).await.expect("not disconnected");
    assert!(rig.sim.state().searching);
    rig.sim.mute(false);
    rig.heard_cancel(asked).await;
    rig.stands_still().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_that_falls_silent_during_a_motion_stops_the_robot() {
    let rig = Rig::quiet().await;
    let run = rig.run("robot.stream('video', true) robot.move(40, 40) task.wait(600)");
    rig.heard_motion(0).await;
    timeout(WAIT_LIMIT, rig.sim.wait_state(|state| state.frames > 3))
        .await
        .unwrap();
    rig.sim.mute(true);
    run.says("no bytes from the robot for 3 s while it moves")
        .await;
    run.says("disconnected").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn on_its_station_the_robot_does_not_move() {
    let rig = Rig::near_home().await;
    let mut run = rig.run(
        "print('docked', robot.dock{})\n\
         print('again', robot.dock{})\n\
         print('moved', robot.move(50, 50, 0.5))\n\
         print('undocked', robot.undock{})\n\
         print('undocked twice', robot.undock{})\n\
         print('moved then', robot.move(50, 50, 0.2))\n",
    );
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    for line in [
        "docked true done",
        "again true already_docked",
        "moved false docked",
        "undocked true done",
        "undocked twice true not_docked",
        "moved then true done",
    ] {
        assert!(text.contains(line), "{line}:\n{text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_higher_priority_drives_and_the_lower_receives_preempted() {
    let rig = Rig::quiet().await;
    rig.file(
        "patrol.lua",
        "while true do print('patrol', robot.move(30, 30, 0.3)) task.wait(0.05) end",
    );
    rig.file(
        "avoid.lua",
        "task.wait(1.5) robot.move(-50, -50, 1) task.wait(600)",
    );
    let run = rig
        .run_config("behaviours:\n  - file: patrol.lua\n  - { file: avoid.lua, priority: 10 }\n");
    let forward = Command::Move {
        left: 27,
        right: 27,
    };
    let back = Command::Move {
        left: -45,
        right: -45,
    };
    let patrol = rig.heard(0, |command| *command == forward).await;
    let avoid = rig.heard(patrol, |command| *command == back).await;
    rig.heard(avoid, |command| *command == forward).await;
    run.says("patrol false preempted").await;
    run.says("patrol true done").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_engine_byte_reaches_the_script_as_a_number() {
    let rig = Rig::quiet().await;
    let mut run = rig.run("print('engine', robot.wait_for('engine', 30).code)");
    timeout(WAIT_LIMIT, rig.sim.wait_state(|state| state.user.is_some()))
        .await
        .unwrap();
    let unknown = Report::Engine(EngineReport::Unknown(42));
    let told = async {
        while !run.text().contains("engine 42") {
            rig.sim.inject(unknown.clone());
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    timeout(WAIT_LIMIT, told)
        .await
        .expect("the script receives no event");
    assert_eq!(run.code().await, Some(0));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_stays_until_a_low_robot_is_home_and_ends_with_5() {
    let rig = Rig::near_home().await;
    let mut run = rig.run("robot.move(20, 20, 600) task.wait(0.5)");
    rig.heard_motion(0).await;
    rig.sim.set_battery(15.0);
    assert_eq!(run.code().await, Some(5), "{}", run.text());
    assert_contains(&run.text(), &["staying until the robot is on its station"]);
    let state = rig.sim.state();
    assert!(state.docked && state.charging, "{state:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_that_waits_for_a_low_robot_survives_a_dropped_link_and_ends_on_an_interrupt() {
    let rig = Rig::quiet().await;
    rig.sim.hide_station(true);
    let mut run = rig.run("robot.move(20, 20, 600) task.wait(0.5)");
    rig.heard_motion(0).await;
    rig.sim.set_battery(15.0);
    run.says("staying until the robot is on its station").await;
    let dropped = rig.sim.heard_count();
    rig.sim.disconnect_all();
    rig.heard_dock(dropped).await;
    assert!(run.lives(), "{}", run.text());
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(5), "{}", run.text());
    let tracks = |command: &Command| matches!(command, Command::Move { .. } | Command::Engine(_));
    let last = rig.commands(dropped).into_iter().rfind(tracks);
    assert_eq!(last, Some(Command::Engine(Engage::Dock)));
}
