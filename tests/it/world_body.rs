//! What worlds can set of the robot's body, of its station and of its radio, as genuine robots show
//! it: each setting from the outside of the robot.

use std::time::Duration;

use tokio::time::{Instant, timeout};

use spykee::script;
use spykee::sim::{Firmware, Pose, Robot, World};
use spykee::simulation::{self, Simulation};
use spykee::wire::{Command, Engage, EngineReport, Report};

use super::sim::{POWER_QUERY, connect, detached};
use crate::long_runs::behaviour;

const STEP: Duration = Duration::from_millis(20);

fn world(more: &str) -> World {
    let text = format!(
        "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0}}\n{more}\n"
    );
    World::from_yaml(&text, "test").unwrap()
}

fn robot(more: &str) -> Robot {
    let firmware = Firmware {
        power_period: Duration::from_millis(500),
        ..Firmware::default()
    };
    let mut robot = Robot::new(world(more), firmware, 1);
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
    robot.execute(&Command::Engine(Engage::Dock));
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

/// A room of 6 x 4 m whose station, at the left wall, has these settings.
fn docking_world(station: &str, more: &str) -> World {
    let text = format!(
        "room: {{width: 6, depth: 4}}\nstation: {{at: [0, 2], heading_degrees: 0, {station}}}\n{more}\n"
    );
    World::from_yaml(&text, "test").unwrap()
}

struct Docked {
    /// Whether it is on its station when the search ends; if not, it has said NOT FOUND.
    charges: bool,
    seconds: f64,
    collisions: u64,
}

/// Sends a robot home and waits until its search ends.
fn dock_from(world: &World, from: Pose, seed: u64) -> Docked {
    let mut robot = Robot::new(world.clone(), Firmware::default(), seed);
    robot.begin_session();
    robot.place(from);
    robot.execute(&Command::Engine(Engage::Dock));
    let mut reports = Vec::new();
    while robot.state().searching {
        robot.step(STEP);
        reports.extend(robot.take_reports());
    }
    let state = robot.state();
    let says = |report| reports.contains(&Report::Engine(report));
    assert_eq!(says(EngineReport::BaseNotFound), !state.docked);
    assert_eq!(says(EngineReport::Docked), state.docked);
    assert_eq!(state.charging, state.docked);
    Docked {
        charges: state.docked,
        seconds: state.time.as_secs_f64(),
        collisions: state.collisions,
    }
}

#[test]
fn beyond_its_receivers_range_a_robot_does_not_find_its_station() {
    let near = docking_world("docking: {range: 2}", "start: {at: [4, 2]}");
    assert!(!dock_from(&near, Pose::new(3.0, 2.0, 0.0), 1).charges);
    assert!(dock_from(&near, Pose::new(1.9, 2.0, 0.0), 1).charges);
}

#[test]
fn an_entry_may_fail_and_then_it_tries_again_until_it_gives_up() {
    let from = Pose::new(2.0, 1.5, 0.0);
    let start = "start: {at: [4, 2]}";
    let never = docking_world("docking: {success: 0}", start);
    let gave_up = dock_from(&never, from, 1);
    assert!(!gave_up.charges && (149.0..152.0).contains(&gave_up.seconds));
    let sometimes = docking_world("docking: {success: 0.4}", start);
    let usual = dock_from(&docking_world("", start), from, 1).seconds;
    let tries = (0..40).map(|seed| dock_from(&sometimes, from, seed));
    let seconds: Vec<f64> = tries
        .filter(|end| end.charges)
        .map(|end| end.seconds)
        .collect();
    let at_once = seconds.iter().filter(|s| **s < usual + 1.0).count();
    assert!(
        (8..=24).contains(&at_once) && seconds.len() >= 36,
        "{at_once} {seconds:?}"
    );
}

#[test]
fn a_robot_that_sees_no_obstacles_pushes_against_them_and_from_aside_needs_several_tries() {
    let start = "start: {at: [4, 2]}";
    let blind = docking_world("docking: {sees_obstacles: false}", start);
    let ahead = dock_from(&blind, Pose::new(2.5, 2.0, 2.0), 1);
    assert!(ahead.charges && ahead.seconds < 40.0, "{}", ahead.seconds);
    // A low stool beside the straight way holds the body, but does not hide the beacon.
    let stool = "furniture: [{at: [1.5, 2.2], length: 0.2, width: 0.2, height: 0.3, colour: red}]";
    let world = docking_world(
        "docking: {sees_obstacles: false}",
        &format!("{start}\n{stool}"),
    );
    let stuck = dock_from(&world, Pose::new(3.0, 2.0, 0.0), 1);
    assert!(!stuck.charges && stuck.collisions > 0 && stuck.seconds > 149.0);
    let world = docking_world("", &format!("{start}\n{stool}"));
    let around = dock_from(&world, Pose::new(3.0, 2.0, 0.0), 1);
    assert!(around.charges && around.collisions == 0);
    // From aside it comes to the station at an angle, and tries again from nearer to the axis.
    let from_aside = |world: &World| -> Vec<f64> {
        let starts = (0..24).map(|i| {
            let angle = (f64::from(i % 12) - 5.5) * 0.18;
            let distance = 1.2 + f64::from(i / 12);
            Pose::new(
                0.2 + distance * angle.cos(),
                2.0 + distance * angle.sin(),
                f64::from(i),
            )
        });
        let ends = starts.map(|from| dock_from(world, from, 1));
        let mut seconds: Vec<f64> = ends
            .filter(|end| end.charges)
            .map(|end| end.seconds)
            .collect();
        seconds.sort_by(f64::total_cmp);
        seconds
    };
    let sighted = from_aside(&docking_world("", start));
    let home = from_aside(&blind);
    assert_eq!((sighted.len(), home.len()), (24, 24));
    assert!(
        home[12] > sighted[12] + 10.0 && home[23] < 100.0,
        "{home:?}"
    );
}

#[test]
fn a_robot_that_a_low_battery_makes_slow_comes_to_its_contacts_in_time() {
    let tired = "start: {at: [4, 2]}\nbattery: {level: 15}\n\
                 tracks: {response: {empty: 0.7, floor: 0.95}}";
    let world = docking_world("docking: {sees_obstacles: false}", tired);
    let home = dock_from(&world, Pose::new(2.0, 2.0, 3.1), 1);
    assert!(home.charges && home.seconds < 40.0, "{}", home.seconds);
}

#[test]
fn sunlight_dazzles_the_receivers() {
    let world = |share: &str| {
        docking_world(
            &format!("docking: {{dazzled: {share}}}"),
            "start: {at: [4, 2]}",
        )
    };
    let from = Pose::new(3.0, 1.5, 0.0);
    assert!(!dock_from(&world("1"), from, 1).charges);
    let seconds = |share: &str| {
        let ends = (0..20).map(|seed| dock_from(&world(share), from, seed));
        let all = ends.map(|end| end.seconds).sum::<f64>();
        all / 20.0
    };
    assert!(
        seconds("0.7") > seconds("0") + 2.0,
        "{} {}",
        seconds("0.7"),
        seconds("0")
    );
}

#[test]
fn a_robot_that_leaves_forward_docks_with_its_back() {
    for docking in ["", "docking: {sees_obstacles: false}, "] {
        let world = docking_world(&format!("{docking}leaves: forward"), "");
        let mut robot = Robot::new(world.clone(), Firmware::default(), 1);
        robot.begin_session();
        assert!(robot.docked());
        assert!(robot.state().pose.heading.abs() < 1e-9);
        robot.execute(&Command::Engine(Engage::Undock));
        robot.step(STEP);
        while robot.state().leaving {
            robot.step(STEP);
            let speeds = robot.state().speeds;
            assert!(speeds.left >= 0.0 && speeds.left == speeds.right);
        }
        run(&mut robot, 1.0);
        let state = robot.state();
        assert!(!state.docked && state.pose.x > 0.6 && state.pose.heading.abs() < 1e-9);
        let from = Pose::new(3.0, 2.05, 2.0);
        assert!(dock_from(&world, from, 1).charges, "{docking}");
        robot.place(from);
        robot.execute(&Command::Engine(Engage::Dock));
        while robot.state().searching {
            robot.step(STEP);
        }
        let end = robot.state();
        assert!(
            end.docked && end.pose.heading.abs() < 0.25,
            "{:?}",
            end.pose
        );
    }
}

/// The last level that the robot has reported.
fn reported(robot: &mut Robot) -> u8 {
    let levels = robot
        .take_reports()
        .into_iter()
        .filter_map(|report| match report {
            Report::Power(power) => Some(power.percent),
            _ => None,
        });
    levels.last().expect("no POWER")
}

#[test]
fn a_voltage_sags_under_the_tracks_and_jumps_up_on_the_station() {
    let mut robot = robot("start: {at: [1, 1]}\nbattery: {level: 50, power: voltage}");
    run(&mut robot, 1.0);
    assert_eq!(reported(&mut robot), 60);
    robot.execute(&Command::Move {
        left: 90,
        right: 90,
    });
    run(&mut robot, 2.0);
    assert!(robot.state().battery > 49.9);
    assert_eq!(reported(&mut robot), 46);
    robot.execute(&Command::Move { left: 0, right: 0 });
    run(&mut robot, 2.0);
    assert_eq!(reported(&mut robot), 60);
    robot.place(world("").start_pose());
    run(&mut robot, 2.0);
    assert!(robot.state().charging);
    assert_eq!(reported(&mut robot), 80);
}

#[test]
fn a_voltage_is_flat_in_the_middle_and_falls_at_the_end_while_the_energy_drains_evenly() {
    let yaml =
        "start: {at: [1, 1]}\nbattery: {level: 100, idle_drain_per_minute: 60, power: voltage}";
    let mut robot = robot(yaml);
    let mut levels = vec![100];
    for second in 1..=99 {
        run(&mut robot, 1.0);
        levels.push(reported(&mut robot));
        let energy = robot.state().battery;
        assert!(
            (energy - (100.0 - f64::from(second))).abs() < 0.1,
            "{energy}"
        );
    }
    assert!(levels.is_sorted_by(|before, after| before >= after));
    let lost = |from: usize, to: usize| levels[from] - levels[to];
    assert!(
        lost(0, 15) > 30 && lost(20, 80) < 15 && lost(90, 99) > 30,
        "{levels:?}"
    );
}

/// How far east the robot gets in ten seconds at this power, from x = 1 over the edge of a thing at
/// x = 2, and whether it is blocked there.
fn gets(thing: &str, power: i8) -> (f64, bool) {
    let mut robot = robot(&format!("start: {{at: [1, 1]}}\n{thing}"));
    robot.execute(&Command::Move {
        left: power,
        right: power,
    });
    run(&mut robot, 10.0);
    (robot.state().pose.x, robot.state().blocked)
}

#[test]
fn edges_of_rugs_and_sills_slow_the_robot_or_block_it_at_low_power() {
    let rug = |height: f64| {
        format!("rugs: [{{at: [2.5, 1], width: 1, depth: 1, colour: red, height: {height}}}]")
    };
    let sill = |height: f64| format!("sills: [{{from: [2, 0], to: [2, 2], height: {height}}}]");
    let flat = gets(&rug(0.0), 36);
    assert!(flat.0 > 2.7 && !flat.1);
    assert_eq!(gets("", 36), flat);
    for thing in [rug(0.01), sill(0.01)] {
        // It needs a quarter of the power: 23 of 90.
        let (x, blocked) = gets(&thing, 20);
        assert!(blocked && (1.84..1.86).contains(&x), "{thing} {x}");
        let (x, blocked) = gets(&thing, 36);
        assert!(!blocked && x > 2.2 && x < flat.0 - 0.05, "{thing} {x}");
    }
    // It can leave backwards.
    let mut robot = robot(&format!("start: {{at: [1, 1]}}\n{}", sill(0.03)));
    robot.execute(&Command::Move {
        left: 50,
        right: 50,
    });
    run(&mut robot, 6.0);
    assert!(robot.state().blocked);
    robot.execute(&Command::Move {
        left: -50,
        right: -50,
    });
    run(&mut robot, 2.0);
    assert!(!robot.state().blocked && robot.state().pose.x < 1.6);
}

/// How long the robot takes to answer a question at a place; `None` if it does not within 20 s.
async fn answers_after(more: &str, x: f64) -> Option<Duration> {
    let yaml = format!("start: {{at: [1, 1]}}\nwifi: {{at: [1, 1], range: 4}}\n{more}");
    // So that no POWER comes by itself.
    let firmware = Firmware {
        power_period: Duration::from_secs(3600),
        ..Firmware::default()
    };
    let handle = detached(world(&yaml), firmware);
    let mut client = connect(&handle).log_in().await;
    handle.place(Pose::new(x, 1.0, 0.0));
    let there = handle.wait_state(|state| state.pose.x == x);
    timeout(Duration::from_secs(1), there).await.unwrap();
    tokio::time::sleep(Duration::from_millis(100)).await;
    let asked = Instant::now();
    client.send(POWER_QUERY).await;
    let answer = client.next_of_kind(3);
    timeout(Duration::from_secs(20), answer).await.ok()?;
    Some(asked.elapsed())
}

#[tokio::test(start_paused = true)]
async fn out_of_the_range_of_its_wifi_a_robot_hears_and_says_nothing() {
    let near = answers_after("", 4.0).await.unwrap();
    assert!(near < Duration::from_millis(50), "{near:?}");
    assert_eq!(answers_after("", 5.2).await, None);
    // A wall costs three metres.
    let wall = "walls: [{from: [2, 0], to: [2, 3]}]";
    assert_eq!(answers_after(wall, 3.2).await, None);
    assert!(answers_after("", 3.2).await.is_some());
}

#[tokio::test(start_paused = true)]
async fn near_the_edge_of_its_wifi_a_robot_is_late() {
    let late = answers_after("", 4.95).await.unwrap();
    assert!(late > Duration::from_millis(100), "{late:?}");
}

#[tokio::test(start_paused = true)]
async fn a_robot_that_comes_back_into_range_takes_a_new_connection() {
    let yaml = "start: {at: [1, 1]}\nwifi: {at: [1, 1], range: 2}";
    let handle = detached(world(yaml), Firmware::default());
    handle.place(Pose::new(5.0, 1.0, 0.0));
    tokio::time::sleep(Duration::from_secs(1)).await;
    let mut lost = connect(&handle);
    lost.send(super::sim::LOGIN).await;
    assert!(timeout(Duration::from_secs(20), lost.next()).await.is_err());
    handle.place(Pose::new(1.5, 1.0, 0.0));
    tokio::time::sleep(Duration::from_secs(1)).await;
    connect(&handle).log_in().await;
}

/// What the robot hears of a script's first motion, and how it moves: metres driven, and radians
/// turned within 1.5 seconds.
async fn first_motion(simulation: &Simulation, source: &str, least: f64) -> ([i8; 2], f64, f64) {
    let mut options = script::Options::new("slow", "slow.lua");
    options.calibration.least_power = least;
    let run = simulation.start(vec![behaviour(source, options)], None);
    let sim = simulation.sim();
    let heard = sim.wait_state(|state| state.commanded != Default::default());
    let heard = timeout(Duration::from_secs(5), heard)
        .await
        .expect("a MOVE");
    let later = sim.wait_state(|state| state.time >= heard.time + Duration::from_millis(1500));
    let later = later.await;
    run.stop();
    let _ = run.outcome().await;
    let commanded = [heard.commanded.left, heard.commanded.right];
    let turned = later.pose.heading - heard.pose.heading;
    (commanded, later.distance - heard.distance, turned)
}

#[test]
fn a_speed_that_is_too_slow_for_the_tracks_moves_the_robot_all_the_same() {
    // Also a robot whose least power is what `doctor --first` has measured.
    for (zone, least, power) in [(20, 20.0, 18), (28, 29.0, 26)] {
        for (script, heard) in [
            ("robot.drive(0, 0.4)", Some([-power, power])),
            ("robot.drive(0, -0.4, 5)", Some([power, -power])),
            ("robot.drive(0.05, 0)", Some([power, power])),
            ("robot.turn(3, 0.1)", Some([-power, power])),
            ("robot.forward(-1, 0.01)", Some([-power, -power])),
            ("robot.drive(0.07, 0.1)", None),
            // A power is sent as it is told.
            ("robot.move(-9, 9)", Some([-8, 8])),
        ] {
            let world = world(&format!(
                "start: {{at: [2, 2]}}\ntracks: {{dead_zone: {zone}}}"
            ));
            let source = format!("{script} task.wait(9)");
            let options = simulation::Options::default();
            let motion = simulation::run(world, options, async |simulation| {
                first_motion(simulation, &source, least).await
            });
            let (commanded, metres, turned) = motion.unwrap();
            let told = format!("{script}, {least} %: {commanded:?}, {metres} m, {turned}");
            assert!(heard.is_none_or(|heard| commanded == heard), "{told}");
            let stands = script.contains("move");
            let turns = (commanded[1] - commanded[0]).signum();
            let is_right = match turns {
                _ if stands => metres == 0.0 && turned == 0.0,
                0 => metres > 0.1 && turned.abs() < 0.01,
                left => turned * f64::from(left) > 0.1,
            };
            assert!(is_right, "{told}");
        }
    }
}

#[test]
fn a_turn_that_is_too_slow_for_the_tracks_ends_where_it_should() {
    let world = world("start: {at: [2, 2]}\ntracks: {dead_zone: 20}");
    let options = simulation::Options::default();
    let script = behaviour(
        "print(robot.turn(1, 0.1), robot.forward(0.5, 0.02), robot.drive(0, 0.1, 1))",
        script::Options::new("slow", "slow.lua"),
    );
    let state = simulation::run(world, options, async |simulation: &Simulation| {
        let run = simulation.start(vec![script], None);
        let _ = run.outcome().await;
        simulation.sim().state()
    });
    let state = state.unwrap();
    // Less than a third of what it can do is no motion.
    assert!((state.pose.heading - 1.0).abs() < 0.1, "{:?}", state.pose);
    assert!((state.distance - 0.5).abs() < 0.05, "{}", state.distance);
}

/// What a script does in 40 seconds that begin on the station.
#[derive(Debug)]
struct Leaving {
    metres: f64,
    comes_back: bool,
    hits_station: bool,
}

fn leaves_station(leaves: &str, source: &str) -> Leaving {
    let station = format!("leaves: {leaves}");
    let line = "{through: [[1.5, 1], [4.5, 1], [4.5, 3], [1.5, 3]], closed: true, colour: black}";
    let world = docking_world(
        &station,
        &format!("camera: {{latency: 0.2, fps: 5}}\nlines: [{line}]"),
    );
    let script = behaviour(source, script::Options::new("leaves", "leaves.lua"));
    let options = simulation::Options::default();
    let left = simulation::run(world, options, async |simulation: &Simulation| {
        let run = simulation.start(vec![script], None);
        let sim = simulation.sim();
        let off = sim.wait_state(|state| !state.docked);
        timeout(Duration::from_secs(20), off)
            .await
            .expect("it stays");
        let home = sim.wait_state(|state| state.docked);
        let comes_back = timeout(Duration::from_secs(40), home).await.is_ok();
        run.stop();
        let _ = run.outcome().await;
        Leaving {
            metres: sim.state().distance,
            comes_back,
            hits_station: sim.trace().collisions().any(|name| name == "station"),
        }
    });
    left.unwrap()
}

#[test]
fn no_ready_behaviour_drives_back_onto_its_station_however_it_leaves_it() {
    let easy = |call: &str| format!("require('@spykee/easy').{call}");
    let scripts = [
        include_str!("../../behaviours/patrol.lua").to_owned(),
        include_str!("../../behaviours/explore.lua").to_owned(),
        include_str!("../../src/cli/new/patrol.lua").to_owned(),
        easy("drive(100)"),
        easy("drive(-100)"),
        easy("forward(3)"),
        easy("back(3)"),
        "require('@spykee/floor').leave_station() robot.forward(1)".to_owned(),
        // These stay near their station when they see nothing.
        include_str!("../../behaviours/follow_colour.lua").to_owned(),
        include_str!("../../behaviours/follow_line.lua").to_owned(),
        include_str!("../../behaviours/find_and_return.lua").to_owned(),
        include_str!("../../src/cli/new/follow.lua").to_owned(),
    ];
    let mut wrong = Vec::new();
    for (number, script) in scripts.iter().enumerate() {
        for leaves in ["forward", "backward"] {
            let left = leaves_station(leaves, script);
            let drives = number >= 8 || left.metres > 0.9;
            if left.comes_back || left.hits_station || !drives {
                wrong.push(format!("{leaves}, script {number}: {left:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
