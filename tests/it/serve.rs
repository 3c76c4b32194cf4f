//! `spykee serve`: runs a robot permanently.

mod manager;

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use rustix::process::Signal;
use spykee::sim::{Firmware, Options, World};
use spykee::wire::{Command, Engage, Led, Sound};
use tokio::time::timeout;

use crate::rig::{
    QUIET_WORLD, Rig, Run, WAIT_LIMIT, assert_contains, docked, moves, run_spykee, succeed,
};

const DRIVES: &str = "while true do robot.move(30, 30, 0.5) end";

/// The beginning of all configs here; tests may run as root.
const BASE: &str = "time_zone: UTC\n";

fn config(rig: &Rig, service: &str, rest: &str) {
    let service = format!("service: {{ user: root, {service} }}\n");
    rig.file("spykee.yaml", &format!("{BASE}{service}{rest}"));
}

fn serve(rig: &Rig) -> Run {
    rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address])
}

async fn ends_well(run: &mut Run) {
    run.signal(Signal::TERM);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

/// A robot on its station with a full battery.
async fn at_home() -> Rig {
    Rig::new(&docked(), Firmware::default()).await
}

#[tokio::test(flavor = "multi_thread")]
async fn behaviours_that_are_always_on_run_and_the_service_outlives_all_behaviours() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    rig.file("asked.lua", "robot.volume(43)");
    config(
        &rig,
        "",
        "behaviours:\n- file: drive.lua\n- { file: asked.lua, start: asked }\n",
    );
    let mut run = serve(&rig);
    let moving = rig.heard_motion(0).await;
    succeed(&rig, &["behaviour", "stop", "drive"]).await;
    rig.heard_stop(moving).await;
    assert!(!rig.commands(0).contains(&Command::Volume(43)));
    // It continues without behaviours, and starts those that a person requests.
    succeed(&rig, &["behaviour", "start", "asked"]).await;
    rig.heard(0, |command| *command == Command::Volume(43))
        .await;
    assert!(run.lives());
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_service_waits_for_a_robot_that_is_not_there_yet() {
    let home = Rig::quiet().await;
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    home.file("drive.lua", DRIVES);
    config(&home, "", "behaviours:\n- file: drive.lua\n");
    let robot = address.to_string();
    let config = "spykee.yaml";
    let mut run = home.spykee(&["serve", "--config", config, "--robot", &robot]);
    run.says("trying until it answers").await;
    let (code, text) = run_spykee(&home, &["behaviour", "start", "drive"]).await;
    let refused = text.contains("the robot is not connected");
    assert_eq!((code, refused), (Some(1), true), "{text}");
    let options = Options {
        listen: address,
        ..Options::default()
    };
    let late = Rig::with(World::from_yaml(QUIET_WORLD, "test").unwrap(), options).await;
    late.heard_motion(0).await;
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_in_use_is_waited_for_and_its_user_is_named() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    config(&rig, "", "behaviours:\n- file: drive.lua\n");
    let other = rig.run("task.wait(600)");
    other.says("connected").await;
    let mut run = serve(&rig);
    run.says("the robot is in use").await;
    drop(other);
    rig.heard_motion(0).await;
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn recently_missed_starts_are_made_up_for_and_a_power_cut_does_not_end_a_run() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    let rest =
        "behaviours:\n- file: drive.lua\nschedule:\n- { run: drive, at: '* * * * *', for: 1h }\n";
    config(&rig, "", rest);
    let mut run = serve(&rig);
    run.says("starts by the timetable").await;
    rig.heard_motion(0).await;
    recorded(&rig).await;
    run.signal(Signal::KILL);
    run.status().await;
    let free = rig.sim.wait_state(|state| state.user.is_none());
    timeout(WAIT_LIMIT, free).await.unwrap();
    let from = rig.sim.heard_count();
    let mut next = serve(&rig);
    next.says("resumes a run that was interrupted").await;
    rig.heard_motion(from).await;
    assert!(!next.text().contains("starts by the timetable"));
    ends_well(&mut next).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_log_of_a_service_has_what_behaviours_say_and_not_each_light_and_sound() {
    let rig = Rig::quiet().await;
    let blink = "robot.led('left', true) robot.play('laser') log.info('blinked') task.wait(600)";
    rig.file("blink.lua", blink);
    config(&rig, "", "behaviours:\n- file: blink.lua\n");
    let mut run = serve(&rig);
    run.says("blinked").await;
    rig.heard(0, |command| *command == Command::Play(Sound::Laser))
        .await;
    ends_well(&mut run).await;
    let text = run.text();
    assert!(
        !text.contains("left light") && !text.contains("plays laser"),
        "{text}"
    );
}

/// The file that records what is under way.
fn record(rig: &Rig) -> String {
    let path = rig.folder().join("spykee-data/schedule.json");
    std::fs::read_to_string(path).unwrap_or_default()
}

/// Waits until the behaviour is recorded as under way.
async fn recorded(rig: &Rig) {
    let kept = async {
        while !record(rig).contains("drive") {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, kept)
        .await
        .expect("the record was not written");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_that_a_person_has_stopped_goes_on_and_resumes_nothing_when_it_restarts() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    let rest =
        "behaviours:\n- file: drive.lua\nschedule:\n- { run: drive, at: '* * * * *', for: 1h }\n";
    config(&rig, "", rest);
    let mut run = serve(&rig);
    let moving = rig.heard_motion(0).await;
    recorded(&rig).await;
    succeed(&rig, &["robot", "stop"]).await;
    let stopped = rig.heard_stop(moving).await;
    run.signal(Signal::KILL);
    run.status().await;
    let mut next = serve(&rig);
    next.says("is not started: a person's STOP holds").await;
    assert!(!next.text().contains("resumes"), "{}", next.text());
    let drove = rig.commands(stopped).into_iter().find(moves);
    assert_eq!(drove, None, "it drives in spite of STOP");
    ends_well(&mut next).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulated_date_shows_the_effect_of_a_clock_change() {
    let home = Rig::quiet().await;
    home.file("drive.lua", "log.info('here I am') task.wait(600)");
    home.file("world.yaml", QUIET_WORLD);
    home.file(
        "spykee.yaml",
        "time_zone: Europe/Rome\nbehaviours:\n- file: drive.lua\n\
         schedule:\n- { run: drive, at: '30 2 * * *', for: 2s }\n",
    );
    let args = ["serve", "--config", "spykee.yaml", "--sim", "world.yaml"];
    let date = ["--date", "2026-03-29 01:59:57"];
    let mut run = home.spykee(&[&args[..], &date].concat());
    run.says("planned for Sun 2026-03-29 03:00").await;
    run.says("here I am").await;
    run.says("its time is over").await;
    ends_well(&mut run).await;
    let mut wrong = home.spykee(&[&["serve", "--robot", "127.0.0.1:1"][..], &date].concat());
    assert_eq!(wrong.code().await, Some(2), "{}", wrong.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_reload_affects_only_changes_and_a_bad_config_changes_nothing() {
    let rig = Rig::quiet().await;
    rig.file("stays.lua", "robot.volume(41) task.wait(600)");
    rig.file("changes.lua", "robot.volume(42) task.wait(600)");
    let rest = "behaviours:\n- file: stays.lua\n- file: changes.lua\n";
    config(&rig, "", rest);
    let mut run = serve(&rig);
    let volume = |volume: u8| move |command: &Command| *command == Command::Volume(volume);
    rig.heard(0, volume(41)).await;
    rig.heard(0, volume(42)).await;
    let hosts = run.hosts();
    rig.file(
        "spykee.yaml",
        "behaviours: [{ file: stays.lua, nmae: x }]\n",
    );
    run.signal(Signal::HUP);
    run.says("the new settings are invalid").await;
    run.says("nmae").await;
    rig.file("changes.lua", "robot.volume(45) task.wait(600)");
    rig.file("new.lua", "robot.volume(46) task.wait(600)");
    config(&rig, "", &format!("{rest}- file: new.lua\n"));
    run.signal(Signal::HUP);
    rig.heard(0, volume(45)).await;
    rig.heard(0, volume(46)).await;
    let commands = rig.commands(0);
    let heard = |volume: u8| {
        commands
            .iter()
            .filter(|one| **one == Command::Volume(volume))
            .count()
    };
    assert_eq!((heard(41), heard(42)), (1, 1), "{}", run.text());
    assert!(
        run.hosts().iter().any(|pid| hosts.contains(pid)),
        "the one that stays"
    );
    // A behaviour that the config no longer contains is ended.
    config(&rig, "", "behaviours:\n- file: stays.lua\n");
    run.signal(Signal::HUP);
    let alone = async {
        while run.hosts().len() != 1 {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(WAIT_LIMIT, alone)
        .await
        .expect("not exactly one is left");
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_mistake_in_a_script_that_only_people_start_does_not_keep_the_service_from_starting() {
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    rig.file("asked.lua", "robot.volume(43)\nrobot.mvoe(30, 30)\n");
    let rest = "behaviours:\n- file: drive.lua\n- { file: asked.lua, start: asked }\n\
                - { file: missing.lua, start: asked }\n";
    config(&rig, "", rest);
    let (code, text) = run_spykee(&rig, &["config", "check", "spykee.yaml"]).await;
    assert_eq!(code, Some(0), "{text}");
    let told = [
        "`asked` cannot start",
        "asked.lua:2",
        "`missing` cannot start",
    ];
    assert_contains(&text, &told);
    let mut run = serve(&rig);
    rig.heard_motion(0).await;
    assert_contains(&run.text(), &told);
    let text = succeed(&rig, &["behaviour", "list"]).await;
    let row = |text: &str, name: &str| -> String {
        let row = text.lines().find(|line| line.starts_with(name));
        row.unwrap().to_owned()
    };
    assert_contains(&row(&text, "asked"), &["cannot start: ", "asked.lua:2"]);
    assert_contains(&row(&text, "missing"), &["cannot start: "]);
    let (code, text) = run_spykee(&rig, &["behaviour", "start", "asked"]).await;
    assert_eq!(code, Some(1), "{text}");
    assert_contains(&text, &["asked.lua:2"]);
    // It is mended on the disk, and starts.
    rig.file("asked.lua", "robot.volume(43) task.wait(600)");
    succeed(&rig, &["behaviour", "start", "asked"]).await;
    let told = |command: &Command| *command == Command::Volume(43);
    rig.heard(0, told).await;
    let text = succeed(&rig, &["behaviour", "list"]).await;
    assert!(!row(&text, "asked").contains("cannot start"), "{text}");
    // A mistake in what runs already does not end it, and the rest of the new settings counts.
    rig.file("asked.lua", "robot.mvoe(30, 30)");
    rig.file("new.lua", "robot.volume(44) task.wait(600)");
    config(&rig, "", &format!("{rest}- file: new.lua\n"));
    run.signal(Signal::HUP);
    rig.heard(0, |command| *command == Command::Volume(44))
        .await;
    let text = succeed(&rig, &["behaviour", "list"]).await;
    assert_contains(&row(&text, "asked"), &["running"]);
    ends_well(&mut run).await;
    // What starts by itself must be right.
    rig.file("drive.lua", "robot.mvoe(30, 30)");
    let mut run = serve(&rig);
    assert_ne!(run.code().await, Some(0));
    assert_contains(&run.text(), &["drive.lua:1"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn history_says_who_has_started_and_ended_what() {
    let rig = Rig::quiet().await;
    for name in ["guard.lua", "asked.lua", "other.lua"] {
        rig.file(name, "task.wait(600)");
    }
    config(
        &rig,
        "",
        "behaviours:\n- file: guard.lua\n- { file: asked.lua, start: asked }\n\
         - { file: other.lua, start: asked }\n",
    );
    let mut run = serve(&rig);
    run.says("connected").await;
    succeed(&rig, &["behaviour", "start", "asked", "--for", "1s"]).await;
    succeed(&rig, &["behaviour", "start", "other"]).await;
    succeed(&rig, &["behaviour", "stop", "other"]).await;
    run.says("its time is over").await;
    ends_well(&mut run).await;
    let args = ["history", "runs", "--config", "spykee.yaml"];
    let text = succeed(&rig, &args).await;
    let row = |name: &str| text.lines().find(|line| line.contains(name)).unwrap();
    assert_contains(row("guard"), &["always on", "shutdown"]);
    assert_contains(row("asked"), &["the command line", "its time is over"]);
    // Who has started it, and who has ended it.
    assert_eq!(
        row("other").matches("the command line").count(),
        2,
        "{text}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_who_sends_the_robot_home_ends_what_drives_and_history_says_who() {
    let rig = Rig::near_home().await;
    rig.file("watch.lua", "task.wait(600)");
    let patrol =
        "while true do robot.undock() robot.move(30, 30, 0.2) robot.move(-30, -30, 0.2) end";
    rig.file("patrol.lua", patrol);
    let behaviours = "behaviours:\n- file: watch.lua\n- file: patrol.lua\n";
    config(&rig, "", behaviours);
    let mut run = serve(&rig);
    rig.heard_motion(0).await;
    let text = succeed(&rig, &["robot", "dock"]).await;
    assert_contains(&text, &["on its station"]);
    let docked = rig.sim.heard_count();
    let ended =
        async { while run_spykee(&rig, &["behaviour", "stop", "patrol"]).await.0 == Some(0) {} };
    timeout(WAIT_LIMIT, ended).await.expect("patrol goes on");
    assert!(rig.sim.state().docked);
    let leaves = |one: &Command| moves(one) || *one == Command::Engine(Engage::Undock);
    assert!(!rig.commands(docked).iter().any(leaves));
    // A person starts it again.
    succeed(&rig, &["behaviour", "start", "patrol"]).await;
    rig.heard_motion(docked).await;
    ends_well(&mut run).await;
    let args = ["history", "runs", "--config", "spykee.yaml"];
    let text = succeed(&rig, &args).await;
    let ends = "docking, ordered by the command line";
    let rows = |name: &str| text.lines().filter(|line| line.contains(name)).count();
    assert_eq!((rows(ends), rows("watch")), (1, 1), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_idle_robot_is_sent_home() {
    let rig = Rig::near_home().await;
    rig.file("asked.lua", DRIVES);
    config(
        &rig,
        "idle_after: 1s",
        "behaviours:\n- { file: asked.lua, start: asked }\n",
    );
    let mut run = serve(&rig);
    let dock = rig.heard_dock(0).await;
    // A start cancels that.
    succeed(&rig, &["behaviour", "start", "asked"]).await;
    let moving = rig.heard_motion(dock).await;
    assert_eq!(
        run_spykee(&rig, &["behaviour", "stop", "asked"]).await.0,
        Some(0)
    );
    rig.heard_dock(moving).await;
    let home = rig.sim.wait_state(|state| state.docked);
    timeout(WAIT_LIMIT, home)
        .await
        .expect("the robot does not come home");
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_nobody_drives_goes_home_although_a_guard_is_always_on() {
    let rig = Rig::near_home().await;
    rig.file("watch.lua", "while true do task.wait(1) end");
    rig.file("go.lua", "robot.undock() robot.move(30, 30, 0.3)");
    let behaviours = "behaviours:\n- file: watch.lua\n- { file: go.lua, start: asked }\n";
    config(&rig, "idle_after: 1s", behaviours);
    let mut run = serve(&rig);
    let mut from = 0;
    // After the start, after a person has left it off its station, and after a run.
    for order in [
        &["status"][..],
        &["robot", "undock"],
        &["behaviour", "start", "go"],
    ] {
        succeed(&rig, order).await;
        rig.heard_dock(from).await;
        let home = rig.sim.wait_state(|state| state.docked);
        let arrived = timeout(WAIT_LIMIT, home).await;
        arrived.expect("the robot does not come home");
        run.says("the idle robot is on its station").await;
        from = rig.sim.heard_count();
    }
    let text = succeed(&rig, &["status"]).await;
    assert_contains(&text, &["watch"]);
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_idle_robot_on_its_station_is_disconnected_and_connected_again_on_request() {
    let rig = at_home().await;
    rig.file("asked.lua", "robot.volume(44) task.wait(600)");
    config(
        &rig,
        "idle: release, idle_after: 1s",
        "behaviours:\n- { file: asked.lua, start: asked }\n",
    );
    let mut run = serve(&rig);
    run.says("free for others").await;
    let free = || rig.sim.wait_state(|state| state.user.is_none());
    timeout(WAIT_LIMIT, free())
        .await
        .expect("another user cannot log in");
    let text = succeed(&rig, &["status"]).await;
    assert_contains(&text, &["free for others"]);
    let (code, text) = run_spykee(&rig, &["robot", "volume", "37"]).await;
    assert_eq!(code, Some(0), "{text} {}", run.text());
    rig.heard(0, |command| *command == Command::Volume(37))
        .await;
    timeout(WAIT_LIMIT, free())
        .await
        .expect("the service does not disconnect again");
    let (code, text) = run_spykee(&rig, &["behaviour", "start", "asked"]).await;
    assert_eq!(code, Some(0), "{text} {}", run.text());
    rig.heard(0, |command| *command == Command::Volume(44))
        .await;
    assert!(rig.sim.state().user.is_some());
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn in_quiet_hours_scripts_make_no_sound_but_a_person_may() {
    let rig = Rig::quiet().await;
    let noise =
        "robot.play('laser') robot.led('flash', true) robot.led('left', true) task.wait(600)";
    rig.file("noise.lua", noise);
    quiet_now(&rig, "behaviours:\n- { file: noise.lua, start: asked }\n");
    let mut run = serve(&rig);
    run.says("quiet hours").await;
    run.says("connected").await;
    assert_eq!(
        run_spykee(&rig, &["behaviour", "start", "noise"]).await.0,
        Some(0)
    );
    let left = Command::Led {
        led: Led::Left,
        on: true,
    };
    rig.heard(0, |command| *command == left).await;
    let laser = Command::Play(Sound::Laser);
    let flash = Command::Led {
        led: Led::Flash,
        on: true,
    };
    let heard = rig.commands(0);
    assert!(!heard.contains(&laser) && !heard.contains(&flash));
    succeed(&rig, &["robot", "play", "laser"]).await;
    rig.heard(0, |command| *command == laser).await;
    ends_well(&mut run).await;
}

/// A config in whose quiet hours the present time lies, with these additions.
fn quiet_now(rig: &Rig, rest: &str) {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
    let hour = now.unwrap().as_secs() / 3600 % 24;
    let from = (hour + 23) % 24;
    let until = (hour + 2) % 24;
    config(
        rig,
        "",
        &format!("quiet: {from:02}:00-{until:02}:00\n{rest}"),
    );
}

/// Whether the alarm of a robot with a low battery, which finds no station, sounds in quiet hours.
async fn the_alarm_is_heard(settings: &str) -> bool {
    let firmware = Firmware {
        search_limit: Duration::from_millis(300),
        ..Firmware::default()
    };
    let rig = Rig::new(QUIET_WORLD, firmware).await;
    rig.sim.hide_station(true);
    let watchdog =
        "watchdog: { dock_retries: 0, dock_pause: 1, blind_moves: false, rescue: off }\n";
    quiet_now(&rig, &format!("{settings}{watchdog}"));
    let mut run = serve(&rig);
    run.says("quiet hours").await;
    run.says("connected").await;
    rig.sim.set_battery(15.0);
    run.says("action=alarm").await;
    // The next search follows it.
    rig.heard_dock(rig.sim.heard_count()).await;
    run.signal(Signal::TERM);
    run.code().await;
    rig.commands(0).contains(&Command::Play(Sound::Alarm))
}

#[tokio::test(flavor = "multi_thread")]
async fn in_quiet_hours_the_alarm_sounds_only_if_the_config_says_so() {
    let (quiet, loud) = tokio::join!(
        the_alarm_is_heard(""),
        the_alarm_is_heard("quiet_alarm: false\n")
    );
    assert_eq!((quiet, loud), (false, true));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_does_not_run_as_root_unless_its_config_says_so() {
    if !rustix::process::geteuid().is_root() {
        return;
    }
    let rig = Rig::quiet().await;
    rig.file("drive.lua", DRIVES);
    rig.file(
        "spykee.yaml",
        &format!("{BASE}behaviours:\n- file: drive.lua\n"),
    );
    let mut run = serve(&rig);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["service: { user: NAME }"]);
    let data = tempfile::tempdir().unwrap();
    let data = data.path().join("data");
    std::fs::set_permissions(
        data.parent().unwrap(),
        std::os::unix::fs::PermissionsExt::from_mode(0o755),
    )
    .unwrap();
    let rest = format!("data: {}\nservice: {{ user: nobody }}\n", data.display());
    let behaviours = "behaviours:\n- file: drive.lua\n";
    rig.file("spykee.yaml", &format!("{BASE}{rest}{behaviours}"));
    std::fs::set_permissions(
        rig.folder(),
        std::os::unix::fs::PermissionsExt::from_mode(0o755),
    )
    .unwrap();
    let mut run = serve(&rig);
    rig.heard_motion(0).await;
    let status = format!("/proc/{}/status", run.pid().as_raw_nonzero());
    let status = std::fs::read_to_string(status).unwrap();
    let ids = status
        .lines()
        .find_map(|line| line.strip_prefix("Uid:"))
        .unwrap();
    assert!(ids.split_whitespace().all(|id| id == "65534"), "{ids}");
    ends_well(&mut run).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn schedule_lists_what_will_happen_and_what_will_not_and_why() {
    let rig = Rig::quiet().await;
    let rest = "quiet: 22:00-07:00\nbehaviours:\n- file: patrol.lua\nschedule:\n\
                - { run: patrol, at: '0 9,23 * * *', for: 2h }\n\
                - { run: patrol, at: '0 10 * * *' }\n- { run: patrl, at: '0 12 * * *' }\n";
    config(&rig, "", rest);
    let from = ["--from", "2026-05-04 08:00", "--config", "spykee.yaml"];
    let text = succeed(
        &rig,
        &[&["config", "schedule", "--next", "4"], &from[..]].concat(),
    )
    .await;
    let lines: Vec<&str> = text.lines().collect();
    assert!(
        lines[1].starts_with("Mon 2026-05-04 09:00  patrol     11:00"),
        "{text}"
    );
    assert!(
        lines[2].contains("10:00") && lines[2].contains("still runs"),
        "{text}"
    );
    assert!(
        lines[3].contains("12:00") && lines[3].contains("no such behaviour"),
        "{text}"
    );
    assert!(
        lines[4].contains("23:00") && lines[4].contains("quiet"),
        "{text}"
    );
    let json = [&["config", "schedule", "--next", "1", "--json"], &from[..]].concat();
    let (_, text) = run_spykee(&rig, &json).await;
    assert_contains(&text, &["\"2026-05-04T09:00:00+00:00\""]);
    // A service with such a timetable does not start.
    rig.file("patrol.lua", DRIVES);
    let mut run = serve(&rig);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["the timetable runs `patrl`"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_start_waits_for_the_robot_also_if_the_service_restarts_meanwhile() {
    let home = Rig::quiet().await;
    let listener = std::net::TcpListener::bind("127.0.7.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    drop(listener);
    home.file("drive.lua", DRIVES);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let minute = now.as_secs() / 60 - 1;
    let at = format!("{} {} * * *", minute % 60, minute / 60 % 24);
    let schedule = format!("schedule:\n- {{ run: drive, at: '{at}', for: 1h }}\n");
    config(
        &home,
        "",
        &format!("behaviours:\n- file: drive.lua\n{schedule}"),
    );
    let robot = address.to_string();
    let args = ["serve", "--config", "spykee.yaml", "--robot", &robot];
    let mut run = home.spykee(&args);
    let record = home.folder().join("spykee-data/schedule.json");
    let kept = async {
        while !std::fs::read_to_string(&record).is_ok_and(|text| text.contains("drive")) {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
    };
    let kept = timeout(WAIT_LIMIT, kept).await;
    kept.unwrap_or_else(|_| panic!("not recorded:\n{}", run.text()));
    run.signal(Signal::KILL);
    run.status().await;
    let options = Options {
        listen: address,
        ..Options::default()
    };
    let late = Rig::with(World::from_yaml(QUIET_WORLD, "test").unwrap(), options).await;
    let mut next = home.spykee(&args);
    next.says("starts by the timetable").await;
    late.heard_motion(0).await;
    ends_well(&mut next).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_paused_timetable_starts_nothing_also_after_a_power_cut_until_its_time() {
    let home = Rig::quiet().await;
    home.file("drive.lua", "log.info('here I am') task.wait(600)");
    home.file("world.yaml", QUIET_WORLD);
    let service = "catch_up: 3h\nbehaviours:\n- file: drive.lua\n\
                   schedule:\n- { run: drive, at: '0 9,11 * * *' }\n";
    config(&home, "", service);
    let serve_at = |date: &str| {
        let args = ["serve", "--config", "spykee.yaml", "--sim", "world.yaml"];
        home.spykee(&[&args[..], &["--date", date]].concat())
    };
    let order = async |words: &[&str]| {
        let args = [&["behaviour", "timetable"][..], words].concat();
        run_spykee(&home, &[&args[..], &["--config", "spykee.yaml"]].concat()).await
    };
    let mut run = serve_at("2026-05-04 08:00");
    run.says("connected").await;
    let (code, text) = order(&["pause", "2026-05-04 07:00"]).await;
    assert_eq!(code, Some(1), "{text}");
    assert_contains(&text, &["that is over"]);
    let (code, text) = order(&["skip"]).await;
    assert_eq!(code, Some(0), "{text}");
    assert_contains(&text, &["drive Mon 2026-05-04 09:00 (left out)"]);
    let (code, text) = order(&["pause", "2026-05-04 11:00"]).await;
    assert_eq!(code, Some(0), "{text}");
    let paused = "drive Mon 2026-05-04 11:00 (paused until Mon 2026-05-04 11:00)";
    assert_contains(&text, &[paused]);
    run.signal(Signal::KILL);
    run.status().await;
    // The start of nine o'clock would be made up for.
    let mut next = serve_at("2026-05-04 10:00");
    next.says("connected").await;
    let text = succeed(&home, &["status", "--config", "spykee.yaml"]).await;
    assert_contains(&text, &[paused]);
    let listed = [
        "config",
        "schedule",
        "--from",
        "2026-05-04 08:00",
        "--next",
        "1",
    ];
    let listed = succeed(&home, &[&listed[..], &["--config", "spykee.yaml"]].concat()).await;
    assert_contains(
        &listed,
        &["paused it until Mon 2026-05-04 11:00", "11:00  drive"],
    );
    let again: [&[&str]; 3] = [&["skip"], &["unskip"], &["pause", "2026-05-04 10:59"]];
    for words in again {
        let (code, text) = order(words).await;
        assert_eq!(code, Some(0), "{text}");
    }
    ends_well(&mut next).await;
    assert!(!next.text().contains("here I am"), "{}", next.text());
    let mut last = serve_at("2026-05-04 10:59:57");
    last.says("planned for Mon 2026-05-04 11:00").await;
    last.says("here I am").await;
    ends_well(&mut last).await;
    let history = succeed(&home, &["history", "--config", "spykee.yaml"]).await;
    assert_contains(
        &history,
        &[
            "nothing starts until Mon 2026-05-04 10:59",
            "the command line",
        ],
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_without_a_timetable_has_none_to_change() {
    let rig = Rig::quiet().await;
    let run = rig.run("task.wait(600)");
    run.says("connected").await;
    let (code, text) = run_spykee(&rig, &["behaviour", "timetable", "skip"]).await;
    assert_eq!(code, Some(1), "{text}");
    assert_contains(&text, &["only a service has a timetable"]);
    let (code, text) = run_spykee(&rig, &["behaviour", "timetable", "pause"]).await;
    assert_eq!(code, Some(2), "{text}");
}
