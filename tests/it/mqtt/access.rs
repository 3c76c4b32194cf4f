//! The broker decides who may command which robot, with the access list of the book;
//! and an agent sends nothing to a broker whose certificate no trusted authority has signed.

use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::process::Command as Process;

use spykee::wire::{Command, Engage, Sound};

use super::broker::{Broker, Subscriber};
use super::{A, IDLE, robot};
use crate::rig::{Rig, Run, assert_contains};

/// The book's list for `rover1`, an agent, and `anna`, who may command its robot, and the same
/// for a second robot, with `rover2` and `bruno`.
fn access() -> String {
    let chapter = include_str!("../../../behaviours/guide/operate/home-assistant.md");
    let list = chapter
        .split("```")
        .find(|block| block.starts_with("\nuser rover1\n"));
    let (first, _) = list.unwrap().split_once("user homeassistant\n").unwrap();
    let second = [
        ("SPYKEE0001", "SPYKEE0002"),
        ("rover1", "rover2"),
        ("anna", "bruno"),
    ];
    let replace = |text: String, (from, to): (&str, &str)| text.replace(from, to);
    second.into_iter().fold(first.to_owned(), replace) + first
}

const USERS: &[(&str, &str)] = &[
    ("rover1", "r1"),
    ("rover2", "r2"),
    ("anna", "a"),
    ("bruno", "b"),
];

/// The config of a user of this broker.
fn config(rig: &Rig, broker: &Broker, name: &str, user: usize) -> String {
    let (user, password) = USERS[user];
    let secret = rig.file(&format!("{name}.password"), password);
    std::fs::set_permissions(secret, std::fs::Permissions::from_mode(0o600)).unwrap();
    let port = broker.port;
    format!(
        "mqtt: {{ host: 127.0.0.1, port: {port}, user: {user}, password_file: {name}.password }}\n"
    )
}

fn agent(rig: &Rig, broker: &Broker, user: usize) -> Run {
    rig.file("patrol.lua", IDLE);
    let broker = config(rig, broker, "agent", user);
    rig.run_config(&format!("behaviours: [{{ file: patrol.lua }}]\n{broker}"))
}

#[tokio::test(flavor = "multi_thread")]
async fn a_user_of_one_robot_can_neither_drive_nor_see_nor_impersonate_another() {
    let lines = "password_file @/users\nacl_file @/access\n";
    let Some(mut broker) = Broker::start_with(lines, USERS) else {
        return;
    };
    broker.file("access", &access());
    broker.restart();
    let first = robot(A).await;
    let second = robot("SPYKEE0002").await;
    let anna = Subscriber::connect_as(&broker, Some(USERS[2])).await;
    let bruno = Subscriber::connect_as(&broker, Some(USERS[3])).await;
    let _first = agent(&first, &broker, 0);
    let _second = agent(&second, &broker, 1);
    anna.wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    bruno
        .wait_for_text(0, "spykee/SPYKEE0002/connection", "ONLINE")
        .await;
    for command in ["return_to_base", "stop"] {
        bruno
            .publish("spykee/SPYKEE0001/command", command, false)
            .await;
    }
    bruno
        .publish("spykee/SPYKEE0002/command", "locate", false)
        .await;
    let laser = |one: &Command| *one == Command::Play(Sound::Laser);
    second.heard(0, laser).await;
    // The broker received bruno's commands before this one.
    anna.publish("spykee/SPYKEE0001/command", "locate", false)
        .await;
    first.heard(0, laser).await;
    let dock = |one: &&Command| **one == Command::Engine(Engage::Dock);
    assert_eq!(first.commands(0).iter().find(dock), None);
    assert!(
        !bruno.has_message_below("spykee/SPYKEE0001")
            && !anna.has_message_below("spykee/SPYKEE0002")
    );
    first.file("fleet.yaml", &config(&first, &broker, "bruno", 3));
    let fleet = ["fleet", "stop", A, "--config", "fleet.yaml"];
    let mut stop = first.spykee(&fleet);
    assert_eq!(stop.code().await, Some(2), "{}", stop.text());
    let unknown = "no robot SPYKEE0001 at this broker";
    assert_contains(&stop.text(), &[unknown]);
}

/// Runs `openssl` in this folder; returns whether it succeeded.
fn openssl(folder: &Path, arguments: &str) -> bool {
    let mut process = Process::new("openssl");
    process.args(arguments.split(' ')).current_dir(folder);
    process.output().is_ok_and(|output| output.status.success())
}

/// Creates two authorities and a broker certificate signed by the first; `false` if there is no
/// openssl.
fn certify(folder: &Path) -> bool {
    let key = "-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes";
    let vouch = |name: &str| {
        openssl(
            folder,
            &format!("req -x509 {key} -days 2 -subj /CN={name} -keyout {name}.key -out {name}.pem"),
        )
    };
    vouch("ca")
        && vouch("stranger")
        && openssl(
            folder,
            &format!(
                "req {key} -subj /CN=broker -addext subjectAltName=IP:127.0.0.1 -keyout broker.key -out broker.csr"
            ),
        )
        && openssl(
            folder,
            "x509 -req -in broker.csr -CA ca.pem -CAkey ca.key -CAcreateserial -days 2 -copy_extensions copy \
             -out broker.pem",
        )
}

#[tokio::test(flavor = "multi_thread")]
async fn over_tls_a_broker_is_trusted_only_with_a_certificate_of_the_authority() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = free.local_addr().unwrap().port();
    drop(free);
    let lines = format!(
        "allow_anonymous true\nlistener {port} 127.0.0.1\n\
         cafile @/ca.pem\ncertfile @/broker.pem\nkeyfile @/broker.key\n"
    );
    let Some(mut broker) = Broker::start_with(&lines, &[]) else {
        return;
    };
    if !certify(broker.folder()) {
        return println!("skipped: there is no openssl 3 for a certificate");
    }
    broker.restart();
    let first = robot("SPYKEE0001").await;
    let second = robot("SPYKEE0002").await;
    let start = |rig: &Rig, ca: &str| {
        rig.file("patrol.lua", IDLE);
        let ca = broker.folder().join(ca);
        rig.run_config(&format!(
            "behaviours: [{{ file: patrol.lua }}]\n\
             mqtt: {{ host: 127.0.0.1, port: {port}, ca_file: '{}' }}\n",
            ca.display()
        ))
    };
    let subscriber = Subscriber::connect(&broker).await;
    let _believes = start(&first, "ca.pem");
    let doubts = start(&second, "stranger.pem");
    doubts.says("no encrypted connection").await;
    subscriber
        .wait_for_text(0, "spykee/SPYKEE0001/connection", "ONLINE")
        .await;
    assert!(!subscriber.has_message_below("spykee/SPYKEE0002"));
}
