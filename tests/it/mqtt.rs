//! Agents at a real broker: mosquitto, if it is installed. Without it these tests are skipped with
//! a message.

mod access;
mod broker;
mod fleet;
mod outage;
mod topic;

use std::time::Duration;

use rustix::process::Signal;
use serde_json::{Value, json};
use spykee::sim::{Options, World};
use spykee::wire::{Command, Sound};

pub use self::broker::{Broker, Subscriber};
use crate::rig::{QUIET_WORLD, Rig, Run, WAIT_LIMIT, assert_contains, moves, run_spykee};

async fn robot(uid: &str) -> Rig {
    let options = Options {
        uid: uid.to_owned(),
        ..Options::default()
    };
    Rig::with(
        World::from_yaml(QUIET_WORLD, "test world").unwrap(),
        options,
    )
    .await
}

const IDLE: &str = "while true do task.wait(1) end";

fn start(rig: &Rig, broker: &Broker, script: &str) -> Run {
    rig.file("patrol.lua", script);
    rig.file("other.lua", IDLE);
    let behaviours = "behaviours: [{ file: patrol.lua }, { file: other.lua }]\n";
    rig.run_config(&format!("data: data\n{behaviours}{}", broker.config()))
}

const A: &str = "SPYKEE0001";

#[tokio::test(flavor = "multi_thread")]
async fn home_assistant_receives_the_state_and_sends_the_robot_home() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    let mut run = start(&rig, &broker, IDLE);
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    let config = subscriber
        .wait_for(0, "homeassistant/device/SPYKEE0001/config", |_| true)
        .await;
    let config: Value = serde_json::from_slice(&config).unwrap();
    let options = &config["components"]["behaviour"]["options"];
    assert_eq!(*options, serde_json::json!(["patrol", "other"]));
    let running = |state: &Value| state["running"].as_array().unwrap().len() == 2;
    let state = subscriber.wait_for_state(0, A, running).await;
    assert_eq!(state["problem"], false, "{state}");
    assert_eq!(state["battery"], 90, "{state}");
    let from = subscriber.len();
    subscriber
        .publish("homeassistant/status", "online", false)
        .await;
    subscriber
        .wait_for(from, "homeassistant/device/SPYKEE0001/config", |_| true)
        .await;
    subscriber
        .publish("spykee/SPYKEE0001/command", "locate", false)
        .await;
    rig.heard(0, |one| *one == Command::Play(Sound::Laser))
        .await;
    subscriber
        .publish("spykee/SPYKEE0001/command", "snapshot", false)
        .await;
    let jpeg = subscriber
        .wait_for(from, "spykee/SPYKEE0001/picture", |_| true)
        .await;
    assert!(jpeg.starts_with(&[0xff, 0xd8]));
    subscriber
        .publish("spykee/SPYKEE0001/command", "return_to_base", false)
        .await;
    rig.heard_dock(0).await;
    subscriber
        .wait_for_state(from, A, |state| state["state"] == "returning")
        .await;
    let from = subscriber.len();
    run.signal(Signal::TERM);
    run.code().await;
    subscriber
        .wait_for_text(from, "spykee/SPYKEE0001/connection", "OFFLINE")
        .await;
}

/// The way home that a person orders at the broker: the robot charges, what has driven has ended and stays
/// so, what only watches runs on, and broker and history say who it was.
#[tokio::test(flavor = "multi_thread")]
async fn a_dock_order_from_the_broker_ends_what_drives_and_says_who_gave_it() {
    let Some(broker) = Broker::start() else {
        return;
    };
    for order in ["return_to_base", "dock"] {
        let rig = Rig::near_home().await;
        let subscriber = Subscriber::connect(&broker).await;
        rig.file("guard.lua", IDLE);
        let patrol = "while true do robot.undock() robot.move(20, -20, 0.5) end";
        rig.file("patrol.lua", patrol);
        let config = format!(
            "service: {{ user: root }}\njournal: {{ record: on }}\n\
             behaviours: [{{ file: guard.lua }}, {{ file: patrol.lua }}]\n{}",
            broker.config()
        );
        rig.file("spykee.yaml", &config);
        let mut run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
        rig.heard_motion(0).await;
        let cleans = |state: &Value| state["state"] == "cleaning";
        subscriber.wait_for_state(0, A, cleans).await;
        let from = subscriber.len();
        let command = "spykee/SPYKEE0001/command";
        subscriber.publish(command, order, false).await;
        let charges = rig.sim.wait_state(|state| state.charging);
        tokio::time::timeout(WAIT_LIMIT, charges).await.unwrap();
        let home = rig.sim.heard_count();
        let watches =
            |state: &Value| state["state"] == "docked" && state["running"] == json!(["guard"]);
        subscriber.wait_for_state(from, A, watches).await;
        let by = "docking, ordered by the MQTT broker";
        let ended = |payload: &[u8]| {
            let event: Value = serde_json::from_slice(payload).unwrap();
            event["event_type"] == "ended" && event["behaviour"] == "patrol" && event["by"] == by
        };
        let event = "spykee/SPYKEE0001/event";
        subscriber.wait_for(from, event, ended).await;
        run.signal(Signal::TERM);
        run.code().await;
        let drives = |command: &Command| moves(command) || is_undock(command);
        assert!(!rig.commands(home).iter().any(drives), "it leaves again");
        let (_, text) = run_spykee(&rig, &["history", "--config", "spykee.yaml"]).await;
        assert_contains(
            &text,
            &["patrol cancelled: docking, ordered by the MQTT broker"],
        );
    }
}

fn is_undock(command: &Command) -> bool {
    *command == Command::Engine(spykee::wire::Engage::Undock)
}

/// With a guard that is always on, Start starts what is asked for; a choice survives the run; an alarm
/// comes as an event and as an image; pictures are no events; what is no command is answered.
#[tokio::test(flavor = "multi_thread")]
async fn home_assistant_starts_the_patrol_remembers_a_choice_and_gets_alarms_with_their_picture() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    let alarm = "local frame = robot.wait_frame(20)\nframe:save('other.jpg')\n\
                 notify.send('look', { picture = frame:save('alarm.jpg') })\n";
    rig.file("guard.lua", &format!("{alarm}{IDLE}"));
    rig.file("patrol.lua", "while true do robot.move(20, -20, 0.5) end");
    rig.file("other.lua", IDLE);
    rig.file(
        "spykee.yaml",
        &format!(
            "service: {{ user: root }}\ndata: data\nbehaviours: [{{ file: guard.lua }}, \
             {{ file: patrol.lua, start: asked }}, {{ file: other.lua, start: asked }}]\n{}",
            broker.config()
        ),
    );
    let serve = || rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    let mut run = serve();
    let guarded = |state: &Value| state["running"] == json!(["guard"]);
    let state = subscriber.wait_for_state(0, A, guarded).await;
    assert_eq!(
        (&state["state"], &state["behaviour"]),
        (&json!("idle"), &json!("patrol"))
    );
    let jpeg = subscriber
        .wait_for(0, "spykee/SPYKEE0001/alarm", |_| true)
        .await;
    assert!(jpeg.starts_with(&[0xff, 0xd8]));
    let is = |kind: &'static str| {
        move |payload: &[u8]| {
            serde_json::from_slice::<Value>(payload).unwrap()["event_type"] == kind
        }
    };
    let event = subscriber
        .wait_for(0, "spykee/SPYKEE0001/event", |payload| {
            assert!(!is("picture")(payload), "a patrol saves two thousand a day");
            is("notify")(payload)
        })
        .await;
    assert_contains(&String::from_utf8_lossy(&event), &["look"]);
    let command = "spykee/SPYKEE0001/command";
    subscriber.publish(command, "fly", false).await;
    let answer = subscriber
        .wait_for(0, "spykee/SPYKEE0001/answer", |_| true)
        .await;
    let answer: Value = serde_json::from_slice(&answer).unwrap();
    assert_eq!(
        (&answer["command"], &answer["done"]),
        (&json!("fly"), &json!(false))
    );
    assert_contains(answer["text"].as_str().unwrap(), &["return_to_base"]);
    subscriber.publish(command, "start", false).await;
    let cleans = |state: &Value| state["state"] == "cleaning";
    let state = subscriber.wait_for_state(0, A, cleans).await;
    assert_eq!(state["running"], json!(["guard", "patrol"]));
    let choice = "spykee/SPYKEE0001/behaviour/set";
    subscriber.publish(choice, "other", true).await;
    let chosen = |state: &Value| state["behaviour"] == "other";
    subscriber.wait_for_state(0, A, chosen).await;
    run.signal(Signal::TERM);
    run.code().await;
    let from = subscriber.len();
    let mut run = serve();
    subscriber.wait_for_state(from, A, chosen).await;
    run.signal(Signal::TERM);
    run.code().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_from_the_broker_holds_a_low_robot_until_a_person_releases_it() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    rig.sim.hide_station(true);
    let subscriber = Subscriber::connect(&broker).await;
    let command = "spykee/SPYKEE0001/command";
    let answer = "spykee/SPYKEE0001/answer";
    let answered = async |from: usize, word: &str| {
        let read = |payload: &[u8]| serde_json::from_slice::<Value>(payload).unwrap();
        let answer = subscriber.wait_for(from, answer, |payload| read(payload)["command"] == word);
        read(&answer.await)
    };
    rig.file("patrol.lua", IDLE);
    rig.file("asked.lua", IDLE);
    rig.file(
        "spykee.yaml",
        &format!(
            "service: {{ user: root }}\njournal: {{ record: on }}\n\
             behaviours: [{{ file: patrol.lua }}, {{ file: asked.lua, start: asked }}]\n{}",
            broker.config()
        ),
    );
    let mut run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    let running = |state: &Value| state["running"][0] == "patrol";
    subscriber.wait_for_state(0, A, running).await;
    rig.sim.set_battery(12.0);
    let searches = rig.heard_dock(0).await;
    subscriber.publish(command, "stop", false).await;
    let done = answered(0, "stop").await;
    assert_eq!(done["done"], true, "{done}");
    let stopped = rig.heard_cancel(searches).await;
    let from = subscriber.len();
    let held = |state: &Value| state["emergency_stop"] == true && state["running"] == json!([]);
    let state = subscriber.wait_for_state(0, A, held).await;
    assert_eq!(state["problem"], true, "{state}");
    assert_contains(
        state["reason"].as_str().unwrap(),
        &["the MQTT broker", "releases"],
    );
    for refused in ["run asked", "undock"] {
        subscriber.publish(command, refused, false).await;
        let answer = answered(from, refused).await;
        assert_eq!(answer["done"], false, "{answer}");
        assert_contains(answer["text"].as_str().unwrap(), &["STOP holds"]);
    }
    let dock = Command::Engine(spykee::wire::Engage::Dock);
    assert!(!rig.commands(stopped).contains(&dock), "a low robot drives");
    subscriber.publish(command, "reset_stop", false).await;
    assert_eq!(answered(from, "reset_stop").await["done"], true);
    rig.heard_dock(stopped).await;
    // What STOP has ended runs again; it is not lost until the service restarts.
    let free = |state: &Value| state["emergency_stop"] == false && running(state);
    subscriber.wait_for_state(from, A, free).await;
    run.signal(Signal::TERM);
    run.code().await;
    let (_, text) = run_spykee(&rig, &["history", "alarms", "--config", "spykee.yaml"]).await;
    let told = [
        "stopped the robot: the MQTT broker",
        "released the robot: the MQTT broker",
    ];
    assert_contains(&text, &told);
}

#[tokio::test(flavor = "multi_thread")]
async fn the_timetable_is_changed_from_the_broker_and_the_state_shows_it() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    let order = async |order: &str| {
        let from = subscriber.len();
        let command = "spykee/SPYKEE0001/command";
        subscriber.publish(command, order, false).await;
        let read = |payload: &[u8]| serde_json::from_slice::<Value>(payload).unwrap();
        let answer = "spykee/SPYKEE0001/answer";
        let answer = subscriber.wait_for(from, answer, |payload| read(payload)["command"] == order);
        read(&answer.await)
    };
    rig.file("patrol.lua", IDLE);
    // Not soon.
    let rule = "{ run: patrol, at: '0 9 1 1 *', for: 1m }";
    let config = format!(
        "service: {{ user: root }}\nschedule: [{rule}]\nbehaviours: [{{ file: patrol.lua }}]\n{}",
        broker.config()
    );
    rig.file("spykee.yaml", &config);
    let mut run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    let planned = |state: &Value| state["next_skipped"] == false && state["paused"].is_null();
    subscriber.wait_for_state(0, A, planned).await;
    for (words, shown) in [
        ("skip", "next_skipped"),
        ("pause 2099-01-01 08:00", "paused"),
    ] {
        let from = subscriber.len();
        assert_eq!(order(words).await["done"], true);
        let held = |state: &Value| ![Value::Null, false.into()].contains(&state[shown]);
        subscriber.wait_for_state(from, A, held).await;
    }
    let from = subscriber.len();
    for words in ["resume", "unskip"] {
        assert_eq!(order(words).await["done"], true);
    }
    subscriber.wait_for_state(from, A, planned).await;
    for (words, why) in [
        ("pause 2020-01-01", "is over"),
        ("pause soon", "is no time"),
    ] {
        let refused = order(words).await;
        assert_eq!(refused["done"], false, "{refused}");
        assert_contains(refused["text"].as_str().unwrap(), &[why]);
    }
    run.signal(Signal::TERM);
    run.code().await;
    let (_, text) = run_spykee(&rig, &["history", "--config", "spykee.yaml"]).await;
    assert_contains(&text, &["is left out: the MQTT broker"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn retained_orders_are_ignored_and_no_order_runs_twice_when_the_broker_restarts() {
    let Some(mut broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    subscriber
        .publish("spykee/SPYKEE0001/command", "return_to_base", true)
        .await;
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/command", "return_to_base")
        .await;
    let run = start(&rig, &broker, IDLE);
    run.says("a retained command is ignored").await;
    subscriber
        .publish("spykee/SPYKEE0001/command", "locate", false)
        .await;
    let laser = |one: &Command| *one == Command::Play(Sound::Laser);
    rig.heard(0, laser).await;
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    let from = subscriber.len();
    broker.restart();
    // The state that is published again after the reconnect.
    subscriber
        .wait_for(from, "spykee/SPYKEE0001/state", |_| true)
        .await;
    // When the agent receives this command, it has processed all messages before it.
    let ordered = async {
        loop {
            subscriber
                .publish("spykee/SPYKEE0001/command", "stop", false)
                .await;
            tokio::time::sleep(Duration::from_millis(300)).await;
            if run.text().contains("command from the broker: stop") {
                return;
            }
        }
    };
    tokio::time::timeout(WAIT_LIMIT, ordered).await.unwrap();
    let commands = rig.commands(0);
    assert_eq!(commands.iter().filter(|one| laser(one)).count(), 1);
    let docks = |one: &&Command| matches!(one, Command::Engine(spykee::wire::Engage::Dock));
    assert_eq!(commands.iter().find(docks), None, "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unreachable_broker_does_not_affect_driving() {
    let rig = robot(A).await;
    rig.file("patrol.lua", "robot.move(40, 40) task.wait(0.5)");
    let config = "behaviours: [{ file: patrol.lua }]\nmqtt: { host: 127.0.0.1, port: 1 }\n";
    let mut run = rig.run_config(config);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    rig.heard_motion(0).await;
    assert_contains(&run.text(), &["no broker at 127.0.0.1:1"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_config_found_in_the_current_folder_connects_the_robot_to_no_broker() {
    let rig = robot(A).await;
    rig.file("spykee.yaml", "mqtt: { host: 127.0.0.1 }\n");
    rig.file("a.lua", "print('hi')");
    let mut run = rig.spykee(&["run", "a.lua", "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["would connect the robot to a broker"]);
}
