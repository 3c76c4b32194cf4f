//! Notifications that are published to a topic; and the command `stop`, which ends all behaviours,
//! also those that an earlier command starts or restarts.

use rustix::process::Signal;
use serde_json::{Value, json};
use spykee::wire::Command;

use super::broker::{Broker, Subscriber};
use super::{A, robot};
use crate::rig::{Rig, assert_contains, succeed};

const SENDS: &str = "local path = robot.wait_frame(20):save('seen')
    notify.send('look at this', { picture = path })";

/// A config with two targets: text as JSON, and pictures.
fn config(rig: &Rig, broker: &Broker) {
    rig.file(
        "spykee.yaml",
        &format!(
            "data: data\nbehaviours: [{{ file: one.lua }}]\n\
             notify:\n  targets:\n    \
             words: {{ topic: house/says, on: [script], json: {{ event: '{{event}}', text: '{{text}}' }} }}\n    \
             sights: {{ topic: house/sees, on: [script], picture: body }}\n{}",
            broker.config()
        ),
    );
}

fn waiting(rig: &Rig) -> usize {
    let folder = rig.folder().join("data/.notify/words");
    std::fs::read_dir(folder).map_or(0, |files| files.count())
}

#[tokio::test(flavor = "multi_thread")]
async fn notifications_are_published_with_their_pictures_and_survive_a_broker_outage() {
    let Some(mut broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    rig.file("one.lua", SENDS);
    config(&rig, &broker);
    let run = || rig.spykee(&["run", "--config", "spykee.yaml", "--robot", &rig.address]);
    let mut first = run();
    assert_eq!(first.code().await, Some(0), "{}", first.text());
    let said = subscriber.wait_for(0, "house/says", |_| true).await;
    let said: Value = serde_json::from_slice(&said).unwrap();
    assert_eq!(
        said,
        serde_json::json!({ "event": "script", "text": "look at this" })
    );
    let seen = subscriber.wait_for(0, "house/sees", |_| true).await;
    assert!(seen.starts_with(&[0xff, 0xd8]));
    assert_eq!(waiting(&rig), 0);
    broker.stop();
    let mut second = run();
    assert_eq!(second.code().await, Some(0), "{}", second.text());
    let text = second.text();
    assert_contains(&text, &["not sent yet: no connection with the broker"]);
    assert_eq!(waiting(&rig), 1);
    let from = subscriber.len();
    broker.begin();
    subscriber.wait_until_connected().await;
    rig.file("one.lua", "task.wait(600)");
    let mut third = run();
    subscriber.wait_for(from, "house/says", |_| true).await;
    third.signal(Signal::TERM);
    assert_eq!(third.code().await, Some(130), "{}", third.text());
    assert_eq!(waiting(&rig), 0);
    let mut test = rig.spykee(&["config", "test-notify", "words", "--config", "spykee.yaml"]);
    assert_eq!(test.code().await, Some(0), "{}", test.text());
    subscriber
        .wait_for(from, "house/says", |payload| {
            String::from_utf8_lossy(payload).contains("a test of")
        })
        .await;
    let mut found = rig.spykee(&["config", "test-notify", "words"]);
    assert_eq!(found.code().await, Some(2), "{}", found.text());
    let why = "uses a broker";
    assert_contains(&found.text(), &[why]);
}

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
        let released = format!("reset {round}");
        command(&subscriber, "reset_stop", &released).await;
        answer(&subscriber, &released).await;
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
