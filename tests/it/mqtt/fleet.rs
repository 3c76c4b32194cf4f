//! Several agents at one broker; `SPYKEE_TEST_FLEET=30` sets the number for the largest test
//! (`scripts/fleet`).

use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;

use super::broker::{Broker, Subscriber};
use super::{A, IDLE, robot, start};
use crate::rig::{Rig, Run, assert_contains};

#[tokio::test(flavor = "multi_thread")]
async fn the_broker_reports_a_killed_agent() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    let run = start(&rig, &broker, IDLE);
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    run.signal(Signal::KILL);
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "CONNECTIONBROKEN")
        .await;
    rig.file("fleet.yaml", &broker.config());
    let mut list = rig.spykee(&["fleet", "list", "--config", "fleet.yaml"]);
    assert_eq!(list.code().await, Some(0), "{}", list.text());
    let text = list.text();
    assert_contains(&text, &["SPYKEE0001  CONNECTIONBROKEN"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_fleet_starts_and_stops_together_and_every_robot_follows() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let subscriber = Subscriber::connect(&broker).await;
    let names = ["SPYKEE0001", "SPYKEE0002", "SPYKEE0003"];
    let mut rigs = Vec::new();
    for name in names {
        rigs.push(robot(name).await);
    }
    let drive = "robot.move(40, 40) while true do task.wait(1) end";
    let mut runs: Vec<Run> = rigs.iter().map(|rig| start(rig, &broker, drive)).collect();
    for (name, rig) in names.iter().zip(&rigs) {
        subscriber
            .wait_for_text(0, &format!("spykee/{name}/connection"), "ONLINE")
            .await;
        rig.heard_motion(0).await;
        let two = |state: &Value| state["running"].as_array().unwrap().len() == 2;
        subscriber.wait_for_state(0, name, two).await;
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
    let places: Vec<usize> = rigs.iter().map(|rig| rig.sim.heard_count()).collect();
    let mut stop = fleet(&["stop", "all"]);
    assert_eq!(stop.code().await, Some(0), "{}", stop.text());
    assert_eq!(stop.text().matches(": done").count(), 3, "{}", stop.text());
    for (rig, place) in rigs.iter().zip(places) {
        rig.heard_stop(place).await;
    }
    // No behaviour is left that could run.
    for run in &mut runs {
        assert_eq!(run.code().await, Some(0), "{}", run.text());
    }
}

/// The keep-alive in seconds; a broker disconnects a client that is silent for 1.5 times this.
const KEEP_ALIVE: u64 = 20;
/// Mosquitto checks only every six seconds, and machines are slow.
const SLACK: Duration = Duration::from_secs(20);

#[tokio::test(flavor = "multi_thread")]
async fn among_many_agents_dead_and_hung_ones_are_reported_and_all_others_stop() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let count = std::env::var("SPYKEE_TEST_FLEET").map_or(4, |text| text.parse().unwrap());
    let subscriber = Subscriber::connect(&broker).await;
    let names: Vec<String> = (1..=count)
        .map(|number| format!("SPYKEE{number:04}"))
        .collect();
    let mut rigs: Vec<Rig> = Vec::new();
    let mut runs: Vec<Run> = Vec::new();
    for name in &names {
        let rig = robot(name).await;
        rig.file("drive.lua", "while true do robot.move(40, 40, 0.5) end");
        let port = broker.port;
        runs.push(rig.run_config(&format!(
            "behaviours: [{{ file: drive.lua }}]\n\
             mqtt: {{ host: 127.0.0.1, port: {port} }}\n"
        )));
        rigs.push(rig);
    }
    for (name, rig) in names.iter().zip(&rigs) {
        rig.heard_motion(0).await;
        subscriber
            .wait_for_text(0, &format!("spykee/{name}/connection"), "ONLINE")
            .await;
    }
    let places: Vec<usize> = rigs.iter().map(|rig| rig.sim.heard_count()).collect();
    let gone = async |name: &str, since: Instant| {
        let topic = format!("spykee/{name}/connection");
        subscriber
            .wait_for_text(0, &topic, "CONNECTIONBROKEN")
            .await;
        since.elapsed()
    };
    let since = Instant::now();
    runs[0].signal(Signal::STOP);
    runs[1].signal(Signal::KILL);
    let killed = gone(&names[1], since).await;
    let hung = gone(&names[0], since).await;
    eprintln!("{count} agents; reported after {killed:?} (killed) and {hung:?} (hung)");
    // A hung agent is disconnected after 1.5 keep-alives; everything reported before it was
    // reported within that time.
    let place = |name: &str| {
        let topic = format!("spykee/{name}/connection");
        subscriber.index_of(&topic, "CONNECTIONBROKEN").unwrap()
    };
    assert!(place(&names[1]) < place(&names[0]), "the killed one first");
    let patience = Duration::from_secs(KEEP_ALIVE) * 3 / 2;
    assert!(
        patience < hung + Duration::from_secs(KEEP_ALIVE) && hung < patience + SLACK,
        "{killed:?}, {hung:?}"
    );
    let since = Instant::now();
    rigs[0].file("fleet.yaml", &broker.config());
    let mut stop = rigs[0].spykee(&["fleet", "stop", "all", "--config", "fleet.yaml"]);
    assert_eq!(stop.code().await, Some(4), "{}", stop.text());
    eprintln!("stop all: {:?}", since.elapsed());
    let text = stop.text();
    let said = |what| text.matches(what).count();
    let broken = ": not asked, it is CONNECTIONBROKEN";
    assert_eq!((said(": done"), said(broken)), (count - 2, 2), "{text}");
    // Agents that could not receive the command: their guardians have stopped the robots.
    for (rig, place) in rigs.iter().zip(places) {
        rig.heard_stop(place).await;
    }
    for run in &mut runs[2..] {
        assert_eq!(run.code().await, Some(0), "{}", run.text());
    }
}
