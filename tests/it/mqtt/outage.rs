//! A broker that is unavailable for long and then returns.

use std::io::Read as _;
use std::net::TcpListener;
use std::time::{Duration, Instant};

use spykee::wire::{Command, Led, Sound};

use super::broker::{Broker, Subscriber};
use super::{A, robot};
use crate::rig::WAIT_LIMIT;

/// The number of connection attempts to wait for while the broker is gone.
const ATTEMPTS: usize = 4;

/// How long the broker stays away after that: an hour with `SPYKEE_TEST_BROKER_GONE=3600`.
fn gone_for() -> Duration {
    let seconds = std::env::var("SPYKEE_TEST_BROKER_GONE");
    Duration::from_secs(seconds.map_or(0, |text| text.parse().unwrap()))
}

/// Listens in the broker's place and closes all connections; returns the times of the agent's
/// attempts.
fn connection_attempts(port: u16) -> Vec<Instant> {
    let door = TcpListener::bind(("127.0.0.1", port)).unwrap();
    let mut came = Vec::new();
    for stream in door.incoming() {
        let mut stream = stream.unwrap();
        stream.set_read_timeout(Some(WAIT_LIMIT)).unwrap();
        let mut said = [0; 256];
        let length = stream.read(&mut said).unwrap_or(0);
        let is_agent = String::from_utf8_lossy(&said[..length]).contains("spykee-SPYKEE0001");
        came.extend(is_agent.then(Instant::now));
        if came.len() == ATTEMPTS {
            break;
        }
    }
    came
}

#[tokio::test(flavor = "multi_thread")]
async fn after_a_long_outage_all_states_are_published_again_and_no_old_order_runs() {
    let Some(mut broker) = Broker::start() else {
        return;
    };
    let rig = robot(A).await;
    let subscriber = Subscriber::connect(&broker).await;
    let blinks = "local on = true
        while true do robot.led('left', on) on = not on task.wait(0.2) end";
    rig.file("patrol.lua", blinks);
    let run = rig.run_config(&format!(
        "behaviours: [{{ file: patrol.lua }}]\n\
         mqtt: {{ host: 127.0.0.1, port: {} }}\n",
        broker.port
    ));
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    let laser = |one: &Command| *one == Command::Play(Sound::Laser);
    subscriber
        .publish("spykee/SPYKEE0001/command", "locate", false)
        .await;
    rig.heard(0, laser).await;
    broker.stop();
    broker.forget();
    let port = broker.port;
    let came = tokio::task::spawn_blocking(move || connection_attempts(port));
    let came = tokio::time::timeout(WAIT_LIMIT * 2, came)
        .await
        .unwrap()
        .unwrap();
    // Each pause is random, within the upper half of a step; the steps double from half a second.
    let last = came[ATTEMPTS - 1] - came[0];
    let least = Duration::from_millis(250 + 500 + 1000);
    assert!(
        last + Duration::from_millis(100) > least,
        "{last:?}: they do not grow"
    );
    tokio::time::sleep(gone_for()).await;
    // The robot keeps working: its light still blinks.
    let gone = rig.sim.heard_count();
    for on in [true, false, true] {
        let light = move |one: &Command| *one == Command::Led { led: Led::Left, on };
        rig.heard(gone, light).await;
    }
    let from = subscriber.len();
    broker.begin();
    subscriber
        .wait_for_text(from, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    subscriber
        .wait_for(from, "homeassistant/device/SPYKEE0001/config", |_| true)
        .await;
    subscriber
        .wait_for_state(from, A, |state| state["problem"] == false)
        .await;
    assert!(
        !rig.commands(gone).iter().any(laser),
        "the old command ran again"
    );
    let back = rig.sim.heard_count();
    subscriber
        .publish("spykee/SPYKEE0001/command", "locate", false)
        .await;
    rig.heard(back, laser).await;
    let told = "no broker at 127.0.0.1";
    assert_eq!(run.text().matches(told).count(), 1, "{}", run.text());
}
