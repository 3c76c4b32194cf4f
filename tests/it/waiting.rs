//! `run --wait`: waits for a robot that is not there yet.

use std::net::{SocketAddr, TcpListener};

use rustix::process::Signal;
use spykee::sim::{Options, World};

use crate::rig::{QUIET_WORLD, Rig, Run, assert_contains};

const DRIVE: &str = "robot.move(40, 40) task.wait(600)";

/// An address at which no server listens.
fn free_address() -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    listener.local_addr().unwrap()
}

/// A run with a robot at this address, in the folder of `home`.
fn run(home: &Rig, address: SocketAddr, flags: &[&str]) -> Run {
    home.file("script.lua", DRIVE);
    let address = address.to_string();
    home.spykee(&[&["run", "script.lua", "--robot", &address], flags].concat())
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_that_waits_starts_when_the_robot_answers() {
    let home = Rig::quiet().await;
    let address = free_address();
    let mut run = run(&home, address, &["--wait"]);
    run.says("trying until it answers").await;
    let options = Options {
        listen: address,
        ..Options::default()
    };
    let world = World::from_yaml(QUIET_WORLD, "test world").unwrap();
    let late = Rig::with(world, options).await;
    let moving = late.heard_motion(0).await;
    run.signal(Signal::INT);
    late.heard_stop(moving).await;
    assert_eq!(run.code().await, Some(130), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn ctrl_c_ends_the_wait() {
    let home = Rig::quiet().await;
    let address = free_address();
    let mut run = run(&home, address, &["--wait"]);
    run.says("trying until it answers").await;
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    let said = run.text().matches("trying until it answers").count();
    assert_eq!(said, 1, "each reason must be logged once: {}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn without_wait_an_unreachable_robot_ends_the_run_and_the_help_names_the_flag() {
    let home = Rig::quiet().await;
    let address = free_address();
    let mut run = run(&home, address, &[]);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    assert_contains(&run.text(), &["`spykee run --wait`"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refused_password_is_not_tried_again() {
    let home = Rig::quiet().await;
    let address = home.address.parse().unwrap();
    let mut run = run(&home, address, &["--wait", "--user", "nobody"]);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    assert_contains(&run.text(), &["refuses user `nobody`"]);
}
