//! A broker with a certificate: the agent sends nothing unless a trusted authority has signed it.

use std::net::TcpListener;
use std::path::Path;
use std::process::Command as Process;

use super::broker::{Broker, Subscriber};
use super::{IDLE, robot};
use crate::rig::Rig;

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
             mqtt: {{ host: 127.0.0.1, port: {port}, tls: {{ ca_file: '{}' }}, prefix: house, discovery_prefix: ha }}\n",
            ca.display()
        ))
    };
    let subscriber = Subscriber::connect(&broker).await;
    let _believes = start(&first, "ca.pem");
    let doubts = start(&second, "stranger.pem");
    doubts.says("no encrypted connection").await;
    // The topics begin with the prefix of the config.
    subscriber
        .wait_for_text(0, "house/SPYKEE0001/connection", "ONLINE")
        .await;
    subscriber
        .wait_for(0, "ha/device/SPYKEE0001/config", |_| true)
        .await;
    assert!(!subscriber.has_message_below("house/SPYKEE0002"));
    assert!(
        !subscriber.has_message_below("spykee/") && !subscriber.has_message_below("homeassistant/")
    );
}
