//! What worlds can set of the robot's body, of its station and of its radio, as genuine robots show
//! it: each setting from the outside of the robot.

use std::time::Duration;

use spykee::sim::{Firmware, Robot, World};
use spykee::wire::Command;

const STEP: Duration = Duration::from_millis(20);

fn world(more: &str) -> World {
    let text = format!(
        "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0}}\n{more}\n"
    );
    World::from_yaml(&text, "test").unwrap()
}

fn robot(more: &str) -> Robot {
    let mut robot = Robot::new(world(more), Firmware::default(), 1);
    robot.begin_session();
    robot
}

fn run(robot: &mut Robot, seconds: f64) {
    (0..(seconds * 50.0) as u32).for_each(|_| robot.step(STEP));
}

/// Metres that a robot drives in two seconds at these powers.
fn driven(more: &str, left: i8, right: i8) -> f64 {
    let mut robot = robot(more);
    robot.execute(&Command::Move { left, right });
    run(&mut robot, 2.0);
    robot.state().distance
}

#[test]
fn below_its_least_power_a_robot_stands() {
    let zone = "start: {at: [1, 1]}\ntracks: {dead_zone: 20}";
    assert_eq!(driven(zone, 17, 17), 0.0);
    assert!(driven(zone, 18, 18) > 0.1);
    // One track that stands turns the robot.
    let mut turning = robot(zone);
    turning.execute(&Command::Move {
        left: 17,
        right: 18,
    });
    run(&mut turning, 2.0);
    assert!(turning.state().pose.heading > 0.3);
    let usual = "start: {at: [1, 1]}";
    assert_eq!(driven(usual, 4, 4), 0.0);
    assert!(driven(usual, 5, 5) > 0.02);
}

#[test]
fn a_robot_that_searches_is_not_held_by_its_least_power() {
    let mut robot = robot("start: {at: [2, 1], heading_degrees: 90}\ntracks: {dead_zone: 60}");
    robot.execute(&Command::Engine(spykee::wire::Engage::Dock));
    run(&mut robot, 40.0);
    assert!(robot.docked());
}

#[test]
fn a_robot_is_slower_with_a_low_battery_and_on_rugs() {
    let driven = |level: u32, more: &str| {
        let tracks = "tracks: {response: {empty: 0.6, floor: 0.9, rug: 0.5}}";
        let start = "start: {at: [2, 1]}";
        let battery = format!("battery: {{level: {level}}}");
        self::driven(&format!("{start}\n{tracks}\n{battery}\n{more}"), 90, 90)
    };
    let full = driven(100, "");
    let share = |metres: f64| metres / full;
    assert!((share(driven(2, "")) - 0.6).abs() < 0.05);
    assert!((share(driven(50, "")) - 0.8).abs() < 0.03);
    let rug = "rugs: [{at: [3, 1], width: 3, depth: 1, colour: red}]";
    assert!((share(driven(100, rug)) - 0.5 / 0.9).abs() < 0.05);
    let perfect = self::driven("start: {at: [2, 1]}", 90, 90);
    assert!((full / perfect - 0.9).abs() < 0.03);
}
