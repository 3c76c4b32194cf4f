//! Notifications that are published to a topic.

use rustix::process::Signal;
use serde_json::Value;

use super::broker::{Broker, Subscriber};
use super::{A, robot};
use crate::rig::{Rig, assert_contains};

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
    let mut test = rig.spykee(&["notify", "test", "words", "--config", "spykee.yaml"]);
    assert_eq!(test.code().await, Some(0), "{}", test.text());
    subscriber
        .wait_for(from, "house/says", |payload| {
            String::from_utf8_lossy(payload).contains("a test of")
        })
        .await;
    let mut found = rig.spykee(&["notify", "test", "words"]);
    assert_eq!(found.code().await, Some(2), "{}", found.text());
    let why = "uses a broker";
    assert_contains(&found.text(), &[why]);
}
