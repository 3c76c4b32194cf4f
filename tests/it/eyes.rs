//! `spykee blobs` and `spykee learn` as people and scripts call them, on pictures of the simulator.

use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output, Stdio};
use std::time::Duration;

use spykee::sim::{Firmware, Pose, Robot, World};
use spykee::wire::{Command, Report, Stream};

/// A red ball a bit left, a blue post right, a green ball behind the robot.
const WORLD: &str = "
name: test
room: { width: 6, depth: 6 }
balls: [{ at: [4, 3.25], colour: red }, { at: [1.6, 3], colour: green }]
posts: [{ at: [4.2, 2.5], colour: blue }]
station: { at: [0, 1], heading_degrees: 0 }
start: { at: [2.9, 3], heading_degrees: 0 }
";

/// A camera frame of the simulator.
fn shot(world: &str, pose: Pose) -> Vec<u8> {
    let world = World::from_yaml(world, "test world").unwrap();
    let mut robot = Robot::new(world, Firmware::default(), 1);
    robot.begin_session();
    robot.place(pose);
    robot.obey(&Command::Stream {
        stream: Stream::Video,
        on: true,
    });
    robot.step(Duration::from_millis(20));
    let video = robot
        .take_reports()
        .into_iter()
        .find_map(|report| match report {
            Report::Video(jpeg) => Some(jpeg.to_vec()),
            _ => None,
        });
    video.unwrap()
}

#[test]
fn keep() {
    let folder = PathBuf::from(std::env::var("KEEP").unwrap());
    std::fs::write(
        folder.join("ahead.jpg"),
        shot(WORLD, Pose::new(2.9, 3.0, 0.0)),
    )
    .unwrap();
    std::fs::write(
        folder.join("back.jpg"),
        shot(WORLD, Pose::new(2.9, 3.0, 3.14)),
    )
    .unwrap();
    let room = std::fs::read_to_string("behaviours/worlds/living_room.yaml").unwrap();
    for i in 0..8 {
        std::fs::write(
            folder.join(format!("room{i}.jpg")),
            shot(&room, Pose::new(3.0, 2.4, i as f64 * 0.785)),
        )
        .unwrap();
    }
}
