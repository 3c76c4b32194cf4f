//! Agents at a real broker: mosquitto, where it is installed. Without it these tests are skipped and
//! say so.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command as Process, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use rumqttc::{AsyncClient, Event, MqttOptions, Packet, QoS};
use rustix::process::Signal;
use serde_json::Value;
use spykee::sim::{Options, World};
use spykee::wire::{Command, Sound};

use crate::rig::{PATIENCE, QUIET_WORLD, Rig, Run};

/// A broker of the test's own.
struct Broker {
    child: Child,
    port: u16,
    folder: tempfile::TempDir,
}

impl Drop for Broker {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Where Debian puts it, which not every search path has.
fn mosquitto() -> Option<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = std::env::split_paths(&path).chain([PathBuf::from("/usr/sbin")]);
    let found = folders
        .map(|one| one.join("mosquitto"))
        .find(|one| one.is_file());
    if found.is_none() {
        eprintln!("skipped: mosquitto is not installed (scripts/check installs it)");
    }
    found
}

impl Broker {
    fn start() -> Option<Broker> {
        let executable = mosquitto()?;
        let folder = tempfile::tempdir().unwrap();
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = free.local_addr().unwrap().port();
        drop(free);
        // Started by root it would become another user, who cannot write here.
        let config = format!(
            "listener {port} 127.0.0.1\nallow_anonymous true\npersistence true\n\
             persistence_location {}/\nuser root\n",
            folder.path().display()
        );
        std::fs::write(folder.path().join("mosquitto.conf"), config).unwrap();
        let child = Broker::spawn(&executable, folder.path());
        Some(Broker {
            child,
            port,
            folder,
        })
    }

    fn spawn(executable: &Path, folder: &Path) -> Child {
        let mut process = Process::new(executable);
        process.arg("-c").arg(folder.join("mosquitto.conf"));
        process.stdout(Stdio::null()).stderr(Stdio::null());
        process.spawn().unwrap()
    }

    /// It ends as a broker ends that is restarted, and begins with what it has kept.
    fn restart(&mut self) {
        let pid = rustix::process::Pid::from_child(&self.child);
        rustix::process::kill_process(pid, Signal::TERM).unwrap();
        self.child.wait().unwrap();
        self.child = Broker::spawn(&mosquitto().unwrap(), self.folder.path());
    }

    fn config(&self) -> String {
        format!("mqtt: {{ host: 127.0.0.1, port: {} }}\n", self.port)
    }
}

/// A topic and what was published there.
type Published = (String, Vec<u8>);

/// Somebody who hears all that is said at the broker.
struct Ear {
    client: AsyncClient,
    heard: Arc<Mutex<Vec<Published>>>,
    task: tokio::task::JoinHandle<()>,
}

impl Drop for Ear {
    fn drop(&mut self) {
        self.task.abort();
    }
}

impl Ear {
    async fn at(broker: &Broker) -> Ear {
        let id = format!("ear-{}", rand::random::<u32>());
        let mut options = MqttOptions::new(id, "127.0.0.1", broker.port);
        options.set_max_packet_size(1 << 20, 1 << 20);
        let (client, mut events) = AsyncClient::new(options, 100);
        let heard = Arc::new(Mutex::new(Vec::new()));
        let (kept, subscriber) = (heard.clone(), client.clone());
        let task = tokio::spawn(async move {
            loop {
                match events.poll().await {
                    Ok(Event::Incoming(Packet::ConnAck(_))) => {
                        subscriber.try_subscribe("#", QoS::AtLeastOnce).unwrap();
                    }
                    Ok(Event::Incoming(Packet::Publish(one))) => {
                        let mut heard: std::sync::MutexGuard<'_, Vec<(String, Vec<u8>)>> =
                            kept.lock().unwrap();
                        heard.push((one.topic, one.payload.to_vec()));
                    }
                    Ok(_) => {}
                    Err(_) => tokio::time::sleep(Duration::from_millis(50)).await,
                }
            }
        });
        Ear {
            client,
            heard,
            task,
        }
    }

    async fn say(&self, topic: &str, payload: &str, retain: bool) {
        let said = self
            .client
            .publish(topic, QoS::AtLeastOnce, retain, payload);
        said.await.unwrap();
    }

    fn len(&self) -> usize {
        self.heard.lock().unwrap().len()
    }

    /// Waits for a message from a place on, and gives it.
    async fn hears(&self, from: usize, topic: &str, wanted: impl Fn(&[u8]) -> bool) -> Vec<u8> {
        let until = std::time::Instant::now() + PATIENCE;
        loop {
            let heard = self.heard.lock().unwrap()[from..].to_vec();
            let found = heard
                .iter()
                .find(|(of, payload)| of == topic && wanted(payload));
            if let Some((_, payload)) = found {
                return payload.clone();
            }
            let topics: Vec<_> = heard
                .iter()
                .map(|(topic, payload)| (topic, String::from_utf8_lossy(payload)))
                .collect();
            assert!(
                std::time::Instant::now() < until,
                "not {topic}, but {topics:?}"
            );
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    async fn hears_word(&self, from: usize, topic: &str, word: &str) {
        self.hears(from, topic, |payload| payload == word.as_bytes())
            .await;
    }

    async fn hears_state(
        &self,
        from: usize,
        robot: &str,
        wanted: impl Fn(&Value) -> bool,
    ) -> Value {
        let read = |payload: &[u8]| serde_json::from_slice::<Value>(payload).unwrap();
        let topic = format!("spykee/{robot}/state");
        let state = self
            .hears(from, &topic, |payload| wanted(&read(payload)))
            .await;
        read(&state)
    }
}

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
    run.says("an order that the broker has kept is ignored")
        .await;
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
            if run.text().contains("asks by the broker: stop") {
                return;
            }
        }
    };
    tokio::time::timeout(PATIENCE, ordered).await.unwrap();
    let commands = rig.commands(0);
    assert_eq!(commands.iter().filter(|one| laser(one)).count(), 1);
    let docks = |one: &&Command| matches!(one, Command::Engine(spykee::wire::Engage::Dock));
    assert_eq!(commands.iter().find(docks), None, "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_killed_agent_is_told_by_its_broker() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let (rig, ear) = (robot(A).await, Ear::at(&broker).await);
    let run = start(&rig, &broker, IDLE);
    ear.hears_word(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    run.signal(Signal::KILL);
    ear.hears_word(0, "spykee/SPYKEE0001/connection", "CONNECTIONBROKEN")
        .await;
    rig.file("fleet.yaml", &broker.config());
    let mut list = rig.spykee(&["fleet", "list", "--config", "fleet.yaml"]);
    assert_eq!(list.code().await, Some(0), "{}", list.text());
    let text = list.text();
    assert!(text.contains("SPYKEE0001  CONNECTIONBROKEN"), "{text}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_fleet_runs_and_stops_together_and_every_robot_hears_it() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let ear = Ear::at(&broker).await;
    let names = ["SPYKEE0001", "SPYKEE0002", "SPYKEE0003"];
    let mut rigs = Vec::new();
    for name in names {
        rigs.push(robot(name).await);
    }
    let drive = "robot.move(40, 40) while true do task.wait(1) end";
    let mut runs: Vec<Run> = rigs.iter().map(|rig| start(rig, &broker, drive)).collect();
    for (name, rig) in names.iter().zip(&rigs) {
        ear.hears_word(0, &format!("spykee/{name}/connection"), "ONLINE")
            .await;
        rig.heard_motion(0).await;
        let two = |state: &Value| state["running"].as_array().unwrap().len() == 2;
        ear.hears_state(0, name, two).await;
    }
    rigs[0].file("fleet.yaml", &broker.config());
    let fleet = |args: &[&str]| {
        rigs[0].spykee(&[&["fleet"][..], args, &["--config", "fleet.yaml"]].concat())
    };
    let mut again = fleet(&["run", "patrol", "--on", "all"]);
    assert_eq!(again.code().await, Some(4), "{}", again.text());
    let refused = again
        .text()
        .matches("not done: `patrol` runs already")
        .count();
    assert_eq!(refused, 3, "{}", again.text());
    let places: Vec<usize> = rigs.iter().map(|rig| rig.commands(0).len()).collect();
    let mut stop = fleet(&["stop", "all"]);
    assert_eq!(stop.code().await, Some(0), "{}", stop.text());
    assert_eq!(stop.text().matches(": done").count(), 3, "{}", stop.text());
    for (rig, place) in rigs.iter().zip(places) {
        rig.heard_stop(place).await;
    }
    // Nothing is left to run.
    for run in &mut runs {
        assert_eq!(run.code().await, Some(0), "{}", run.text());
    }
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
        run.text().contains("lets a broker ask for the robot"),
        "{}",
        run.text()
    );
}
