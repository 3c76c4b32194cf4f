//! The command `stop` ends all behaviours, also those that an earlier command starts or restarts.

use serde_json::{Value, json};
use spykee::wire::Command;

use super::broker::{Broker, Subscriber};
use super::{A, robot};
use crate::rig::{Rig, succeed};

/// Says with a volume that it ends, and takes its time for that.
const DRIVES: &str = "script.on_stop(function() robot.volume(41) task.wait(0.4) end)
    while true do robot.move(30, 30, 0.5) end";
/// How often a command to start is followed by a stop: each time one of two threads is faster.
const ROUNDS: usize = 12;

async fn command(subscriber: &Subscriber, command: &str, id: &str) {
    let command = json!({ "command": command, "id": id }).to_string();
    let topic = format!("spykee/{A}/command");
    subscriber.publish(&topic, &command, false).await;
}

/// Waits for the answer to the command with this id.
async fn answer(subscriber: &Subscriber, id: &str) -> Value {
    let read = |payload: &[u8]| serde_json::from_slice::<Value>(payload).unwrap();
    let topic = format!("spykee/{A}/answer");
    let answer = subscriber
        .wait_for(0, &topic, |payload| read(payload)["id"] == id)
        .await;
    read(&answer)
}

/// The state of the only behaviour.
async fn state(rig: &Rig) -> String {
    let text = succeed(rig, &["behaviour", "list", "--json"]).await;
    let list: Value = serde_json::from_str(&text).unwrap();
    list[0]["state"].as_str().unwrap().to_owned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stop_reaches_behaviours_that_restart_or_were_just_ordered() {
    let Some(broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    rig.file("drive.lua", DRIVES);
    rig.file(
        "spykee.yaml",
        &format!(
            "service: {{ user: root, dock: false }}\n\
             behaviours: [{{ file: drive.lua, start: asked }}]\n{}",
            broker.config()
        ),
    );
    let run = rig.spykee(&["serve", "--config", "spykee.yaml", "--robot", &rig.address]);
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    command(&subscriber, "run drive", "first").await;
    rig.heard_motion(0).await;
    let mut restart = rig.spykee(&["behaviour", "restart", "drive"]);
    rig.heard(0, |command| *command == Command::Volume(41))
        .await;
    command(&subscriber, "stop", "restarting").await;
    let answered = answer(&subscriber, "restarting").await;
    restart.code().await;
    assert_eq!(answered["done"], true, "{answered}");
    assert_eq!(state(&rig).await, "idle", "{}", run.text());
    for round in 0..ROUNDS {
        let started = format!("run {round}");
        let stopped = format!("stop {round}");
        command(&subscriber, "run drive", &started).await;
        command(&subscriber, "stop", &stopped).await;
        answer(&subscriber, &started).await;
        let answered = answer(&subscriber, &stopped).await;
        assert_eq!(answered["done"], true, "{answered}");
        assert_eq!(state(&rig).await, "idle", "{}", run.text());
    }
}
