//! Agents at a real broker: mosquitto, where it is installed. Without it these tests are skipped and
//! say so.

mod access;
mod broker;
mod encrypted;
mod fleet;
mod outage;
mod topic;

use std::time::Duration;

use rustix::process::Signal;
use serde_json::Value;
use spykee::sim::{Options, World};
use spykee::wire::{Command, Sound};

pub use self::broker::Broker;
use self::broker::Ear;
use crate::rig::{QUIET_WORLD, Rig, Run, WAIT_LIMIT};

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
async fn home_assistant_hears_the_state_and_sends_the_robot_home() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let (rig, ear) = (robot(A).await, Ear::at(&broker).await);
    let mut run = start(&rig, &broker, IDLE);
    ear.hears_word(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    let config = ear
        .hears(0, "homeassistant/device/SPYKEE0001/config", |_| true)
        .await;
    let config: Value = serde_json::from_slice(&config).unwrap();
    let options = &config["components"]["behaviour"]["options"];
    assert_eq!(*options, serde_json::json!(["patrol", "other"]));
    let running = |state: &Value| state["running"].as_array().unwrap().len() == 2;
    let state = ear.hears_state(0, A, running).await;
    assert_eq!(state["problem"], false, "{state}");
    assert_eq!(state["battery"], 90, "{state}");
    let from = ear.len();
    ear.say("homeassistant/status", "online", false).await;
    ear.hears(from, "homeassistant/device/SPYKEE0001/config", |_| true)
        .await;
    ear.say("spykee/SPYKEE0001/command", "locate", false).await;
    rig.heard(0, |one| *one == Command::Play(Sound::Laser))
        .await;
    ear.say("spykee/SPYKEE0001/command", "snapshot", false)
        .await;
    let jpeg = ear.hears(from, "spykee/SPYKEE0001/picture", |_| true).await;
    assert!(jpeg.starts_with(&[0xff, 0xd8]));
    ear.say("spykee/SPYKEE0001/command", "return_to_base", false)
        .await;
    rig.heard_dock(0).await;
    ear.hears_state(from, A, |state| state["state"] == "returning")
        .await;
    let from = ear.len();
    run.signal(Signal::TERM);
    run.code().await;
    ear.hears_word(from, "spykee/SPYKEE0001/connection", "OFFLINE")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_order_that_the_broker_kept_does_nothing_and_none_runs_twice_when_it_restarts() {
    let Some(mut broker) = Broker::start() else {
        return;
    };
    let (rig, ear) = (robot(A).await, Ear::at(&broker).await);
    ear.say("spykee/SPYKEE0001/command", "return_to_base", true)
        .await;
    ear.hears_word(0, "spykee/SPYKEE0001/command", "return_to_base")
        .await;
    let run = start(&rig, &broker, IDLE);
    run.says("a retained order is ignored").await;
    ear.say("spykee/SPYKEE0001/command", "locate", false).await;
    let laser = |one: &Command| *one == Command::Play(Sound::Laser);
    rig.heard(0, laser).await;
    ear.hears_word(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    let from = ear.len();
    broker.restart();
    // What it is told anew on the new line.
    ear.hears(from, "spykee/SPYKEE0001/state", |_| true).await;
    // An agent that hears this has heard all before it.
    let ordered = async {
        loop {
            ear.say("spykee/SPYKEE0001/command", "stop", false).await;
            tokio::time::sleep(Duration::from_millis(300)).await;
            if run.text().contains("order from the broker: stop") {
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
async fn a_broker_that_is_not_there_keeps_nobody_from_driving() {
    let rig = robot(A).await;
    rig.file("patrol.lua", "robot.move(40, 40) task.wait(0.5)");
    let config = "behaviours: [{ file: patrol.lua }]\nmqtt: { host: 127.0.0.1, port: 1 }\n";
    let mut run = rig.run_config(config);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    rig.heard_motion(0).await;
    assert!(
        run.text().contains("no broker at 127.0.0.1:1"),
        "{}",
        run.text()
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn a_config_that_nobody_named_hands_the_robot_to_no_broker() {
    let rig = robot(A).await;
    rig.file("spykee.yaml", "mqtt: { host: 127.0.0.1 }\n");
    rig.file("a.lua", "print('hi')");
    let mut run = rig.spykee(&["run", "a.lua", "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert!(
        run.text().contains("would connect the robot to a broker"),
        "{}",
        run.text()
    );
}
