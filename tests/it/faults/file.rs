//! `spykee sim --faults FILE.yaml` from the command line.

use std::net::SocketAddr;

use spykee::link::{LinkError, Options, Session, Target, connect};
use spykee::wire::Login;
use tokio::time::{sleep, timeout};

use crate::rig::{Rig, Run, WAIT_LIMIT};

/// A separate simulator with faults, and its address.
async fn simulator(rig: &Rig, faults: &str) -> (Run, Target) {
    let file = rig.file("faults.yaml", faults);
    let args = [
        "sim",
        "--listen",
        "127.0.0.1:0",
        "--faults",
        file.to_str().unwrap(),
    ];
    let run = rig.spykee(&args);
    run.says("Drive it with").await;
    let text = run.text();
    let address = text
        .split("--robot ")
        .nth(1)
        .and_then(|rest| rest.split_whitespace().next());
    let address: SocketAddr = address.unwrap().parse().unwrap();
    (run, address.to_string().parse().unwrap())
}

async fn log_in(target: &Target) -> Result<Session, LinkError> {
    connect(
        target,
        &Login::new("admin", "admin"),
        vec![spykee::wire::Command::STOP],
        &Options::default(),
    )
    .await
}

#[tokio::test(flavor = "multi_thread")]
async fn a_simulator_with_a_file_of_faults_breaks_connections() {
    let rig = Rig::quiet().await;
    let (_run, target) = simulator(&rig, "faults: [{ fault: drop, after: 1, every: 1 }]").await;
    for _ in 0..2 {
        let mut session = log_in(&target).await.unwrap();
        let end = async {
            loop {
                if let Err(error) = session.reader.next().await {
                    return error;
                }
            }
        };
        let error = timeout(WAIT_LIMIT, end).await.expect("not dropped");
        assert!(matches!(error, LinkError::Closed), "{error}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_reboots_cannot_be_reached_and_comes_back_at_the_same_address() {
    let rig = Rig::quiet().await;
    let faults = "faults: [{ fault: reboot, after: 0.5, for: 1.5 }]";
    let (_run, target) = simulator(&rig, faults).await;
    let gone = async {
        while !matches!(log_in(&target).await, Err(LinkError::Unreachable { .. })) {
            sleep(std::time::Duration::from_millis(20)).await;
        }
    };
    timeout(WAIT_LIMIT, gone)
        .await
        .expect("the robot is still reachable");
    let back = async {
        while log_in(&target).await.is_err() {
            sleep(std::time::Duration::from_millis(20)).await;
        }
    };
    timeout(WAIT_LIMIT, back)
        .await
        .expect("the robot does not come back");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_wrong_file_of_faults_is_refused_with_line_and_column() {
    let rig = Rig::quiet().await;
    let file = rig.file("faults.yaml", "faults:\n  - fault: dorp\n");
    let mut run = rig.spykee(&["sim", "--faults", file.to_str().unwrap()]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    for word in ["faults.yaml:2:", "dorp", "did you mean 'drop'?", "the book"] {
        assert!(run.text().contains(word), "{word}: {}", run.text());
    }
}
