//! `spykee calibrate`: measures the simulator's true values, prints the line for the config, and
//! refuses when it must.

use std::f64::consts::{PI, TAU};
use std::fmt::Write as _;
use std::io::{Read, Write};

use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use spykee::sim::{CameraSettings, FULL_SPEED, Firmware, TRACK_WIDTH, World};
use spykee::vision::{Camera, Decoder, Paper, SheetPose, pose_from_sheets};

use crate::camera_truth::simulated;
use crate::rig::{QUIET_WORLD, Rig, Run, Stopwatch, assert_contains, near_home};
use crate::terminal::Terminal;

fn number(text: &str, key: &str) -> f64 {
    let json = text.lines().find(|line| line.starts_with('{'));
    let json: serde_json::Value =
        serde_json::from_str(json.unwrap_or_else(|| panic!("{text}"))).unwrap();
    json[key].as_f64().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn calibration_finds_the_true_values_within_3_percent() {
    let rig = Rig::quiet().await;
    rig.file("world.yaml", QUIET_WORLD);
    let mut runs: Vec<Run> = ["1", "2", "3"]
        .map(|seed| rig.spykee(&["calibrate", "--sim", "world.yaml", "--seed", seed, "--json"]))
        .into();
    for run in &mut runs {
        let code = run.code().await;
        let text = run.text();
        if text.contains("the machine stalled") {
            // Nothing can be measured on such a machine; it may say so itself.
            let overloaded = text.contains("is this computer overloaded?");
            assert!(code == Some(0) || overloaded, "{text}");
            continue;
        }
        assert_eq!(code, Some(0), "{text}");
        let width = number(&run.text(), "track_width");
        let speed = number(&run.text(), "full_speed");
        assert!((width / TRACK_WIDTH - 1.0).abs() < 0.03, "{width}");
        assert!((speed / FULL_SPEED - 1.0).abs() < 0.03, "{speed}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_is_measured_on_the_station_or_with_a_low_battery() {
    let start = "start: { at: [4, 4], heading_degrees: 90 }";
    for (world, code, why) in [
        (QUIET_WORLD.replace(start, ""), 1, "on its station"),
        (
            near_home().replace("level: 90", "level: 15"),
            5,
            "battery is low",
        ),
    ] {
        let rig = Rig::new(&world, Firmware::default()).await;
        let mut run = rig.spykee(&["calibrate", "--robot", &rig.address]);
        assert_eq!(run.code().await, Some(code), "{}", run.text());
        assert_contains(&run.text(), &[why]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_peer_that_is_not_a_robot_is_reported_as_such() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let mut login = [0; 64];
            let _ = (&stream).read(&mut login);
            let _ = (&stream).write_all(b"<!DOCTYPE HTML>\n");
        }
    });
    let rig = Rig::quiet().await;
    let mut run = rig.spykee(&["calibrate", "--robot", &address]);
    assert_eq!(run.code().await, Some(3), "{}", run.text());
    let text = run.text();
    assert!(
        text.contains("error: the robot sends something that is not a Spykee message")
            && !text.contains("internal"),
        "{text}"
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn nothing_moves_without_a_person_at_the_terminal() {
    let rig = Rig::quiet().await;
    let mut run = rig.spykee(&["calibrate", "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert!(rig.sim.state().commanded.left == 0 && !rig.sim.state().moving());
}

/// The true length and angle of the next move, in metres and radians, as a person would measure
/// them.
async fn measured(rig: &Rig) -> (f64, f64) {
    let mut last = rig.sim.wait_state(|state| state.moving()).await;
    let mut way = 0.0;
    let mut angle = 0.0;
    while last.moving() {
        let next = rig.sim.wait_state(|state| state.time > last.time).await;
        way += next.pose.point().distance(last.pose.point());
        angle += (next.pose.heading - last.pose.heading + PI).rem_euclid(TAU) - PI;
        last = next;
    }
    (way, angle)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_is_guided_and_gets_the_line_for_the_config() {
    let rig = Rig::quiet().await;
    let mut terminal = Terminal::start(&["calibrate", "--robot", &rig.address], &rig);
    let mark = rig.sim.state().pose;
    // As a person does, it repeats a measurement: the first one, and each that a stall has spoilt.
    let mut repeats = true;
    for (step, question) in [
        ("1/3", "in centimetres?"),
        ("2/3", "in centimetres?"),
        ("3/3", "How many degrees"),
    ] {
        let (way, angle) = loop {
            rig.sim.place(mark);
            terminal.shows(&format!("{step}  ")).await;
            terminal.shows("Enter starts it").await;
            assert!(!rig.sim.state().moving(), "nothing moves before Enter");
            let watch = Stopwatch::start();
            terminal.types("");
            let measured = measured(&rig).await;
            terminal.shows(question).await;
            rig.stands_still().await;
            if !std::mem::take(&mut repeats) && watch.stalled().is_zero() {
                break measured;
            }
            terminal.types("r");
        };
        if step == "3/3" {
            terminal.types(&format!("{:.0}", angle.to_degrees()));
        } else {
            terminal.types("far");
            terminal.shows("Type a number, such as").await;
            terminal.types(&format!("{:.1}", way * 100.0).replace('.', ","));
        }
    }
    terminal.shows("Paste this line into your config").await;
    assert_eq!(terminal.code().await, Some(0), "{}", terminal.text());
    let text = terminal.text();
    let line = text.lines().find(|line| line.starts_with("calibration:"));
    let line = line.unwrap_or_else(|| panic!("{text}"));
    let config = spykee::config::Config::parse(line, "spykee.yaml").unwrap();
    let width = config.calibration.track_width;
    let speed = config.calibration.full_speed;
    assert!((width / TRACK_WIDTH - 1.0).abs() < 0.2, "{width}");
    assert!((speed / FULL_SPEED - 1.0).abs() < 0.2, "{speed}");
}

/// A room with a sheet of A4 paper, seen by a camera in this pose. Simulated floors are painted in
/// squares of 1 cm: the sheet is as wide as A4 only if its middle is 5 mm beside their grid.
pub(crate) fn paper_world(pose: &str, sheet: &str) -> String {
    format!(
        "room: {{ width: 5, depth: 4, floor: tiles }}\n\
         station: {{ at: [0, 3.5], heading_degrees: 0 }}\n\
         start: {{ at: [2, 2], heading_degrees: 0 }}\n\
         rugs: [{{ at: {sheet}, width: 0.297, depth: 0.21, colour: '#ffffff' }}]\n\
         light: 0.6\ncamera: {pose}\n"
    )
}

#[tokio::test(flavor = "multi_thread")]
async fn one_picture_of_a_sheet_of_paper_tells_where_the_camera_is() {
    let rig = Rig::quiet().await;
    for (pose, wanted, sheet) in [
        (
            "{ pitch: -10, roll: -4 }",
            [0.29, -10.0, -4.0],
            "[2.9, 2.055]",
        ),
        (
            "{ height: 0.31, pitch: -18 }",
            [0.31, -18.0, 0.0],
            "[2.8, 2.005]",
        ),
    ] {
        // The same picture each time: the error depends on its noise.
        let world = World::from_yaml(&paper_world(pose, sheet), "paper").unwrap();
        std::fs::write(rig.folder().join("sheet.jpg"), &simulated(world)[0]).unwrap();
        let mut run = rig.spykee(&["calibrate", "camera", "sheet.jpg", "--json"]);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        let text = run.text();
        let found = ["height", "pitch", "roll"].map(|key| number(&text, key));
        assert!((found[0] - wanted[0]).abs() < 0.015, "{pose}: {text}");
        assert!((found[1] - wanted[1]).abs() < 1.0, "{pose}: {text}");
        assert!((found[2] - wanted[2]).abs() < 1.0, "{pose}: {text}");
    }
    // What it prints for people is a line of a config.
    let mut run = rig.spykee(&["calibrate", "camera", "sheet.jpg"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let line = text.lines().find(|line| line.starts_with("camera:"));
    let config = spykee::config::Config::parse(line.unwrap(), "pasted").unwrap();
    assert!((config.camera.pitch + 18.0).abs() < 1.0, "{text}");
    assert_contains(&text, &["m ahead of the camera", "does not fit"]);
    // The robot serves as well as a file.
    rig.file(
        "paper.yaml",
        &paper_world("{ pitch: -10, roll: -4 }", "[2.9, 2.055]"),
    );
    let mut run = rig.spykee(&["calibrate", "camera", "--sim", "paper.yaml"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["camera: {", "m ahead of the camera"]);
}

/// A genuine robot in the middle of twelve sheets, one ahead of it after each turn by 30 degrees. They
/// lie on the grid in which floors are painted, so they are 3 mm too long.
fn ring_of_paper(floor: &str, random: &mut StdRng) -> World {
    let mut sheets = String::new();
    for look in 0..12 {
        let (sin, cos) = (TAU * f64::from(look) / 12.0).sin_cos();
        let ahead = 0.1 + random.random_range(0.7..1.1);
        let left = random.random_range(-0.06..0.06);
        let x = (100.0 * (3.0 + ahead * cos - left * sin)).round() / 100.0;
        let y = (100.0 * (2.5 + ahead * sin + left * cos)).floor() / 100.0 + 0.005;
        let size = "width: 0.297, depth: 0.21, colour: '#ffffff'";
        let _ = writeln!(sheets, "  - {{ at: [{x:.3}, {y:.3}], {size} }}");
    }
    let height = random.random_range(0.27..0.31);
    let pitch = random.random_range(-18.0..-8.0);
    let roll = random.random_range(-5.0..5.0);
    let light = random.random_range(0.3..1.0);
    let text = format!(
        "preset: genuine\nroom: {{ width: 6, depth: 5, floor: {floor} }}\n\
         station: {{ at: [0, 4.5], heading_degrees: 0 }}\n\
         start: {{ at: [3, 2.5], heading_degrees: 0 }}\nrugs:\n{sheets}light: {light}\n\
         camera: {{ height: {height}, pitch: {pitch}, roll: {roll} }}\n"
    );
    World::from_yaml(&text, "ring").unwrap()
}

/// By how much measurements are off: height in millimetres, pitch and roll in degrees.
#[derive(Default)]
struct Errors {
    all: [Vec<f64>; 3],
    /// Those within the stated uncertainty.
    inside: [usize; 3],
}

impl Errors {
    fn add(&mut self, found: &SheetPose, truth: &CameraSettings) {
        let camera = &found.camera;
        let off = [
            camera.height - truth.height,
            camera.pitch - truth.pitch,
            camera.roll - truth.roll,
        ];
        for (index, off) in off.into_iter().enumerate() {
            self.inside[index] += usize::from(off.abs() <= found.uncertainty[index]);
            self.all[index].push(if index == 0 { 1000.0 * off } else { off });
        }
    }

    fn medians(&mut self) -> [f64; 3] {
        self.all.each_mut().map(|errors| {
            errors.sort_by(f64::total_cmp);
            errors[errors.len() / 2]
        })
    }
}

#[test]
fn the_camera_pose_is_not_biased_and_as_certain_as_stated() {
    let mut errors = Errors::default();
    for (seed, floor) in (1..).zip(["tiles", "concrete", "wood", "glossy_tiles", "concrete"]) {
        let world = ring_of_paper(floor, &mut StdRng::seed_from_u64(seed));
        let truth = world.camera;
        for jpeg in simulated(world) {
            let mut decoder = Decoder::default();
            let image = decoder.decode(&jpeg).unwrap();
            if let Ok(found) = pose_from_sheets(image, Camera::default(), Paper::A4) {
                errors.add(&found, &truth);
            }
        }
    }
    let count = errors.all[0].len();
    let medians = errors.medians();
    let counted = format!("{medians:?}, {:?} of {count}", errors.inside);
    println!("{counted}");
    assert!(count >= 50, "{counted}");
    // Half of this is the sheets' own: they are too long.
    assert!(medians[0].abs() < 4.0, "{counted}");
    assert!(medians[1..].iter().all(|off| off.abs() < 0.1), "{counted}");
    let enough = errors
        .inside
        .iter()
        .all(|inside| 100 * inside >= 95 * count);
    assert!(enough, "{counted}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_picture_without_a_sheet_of_paper_is_refused_with_what_to_do() {
    let rig = Rig::quiet().await;
    rig.file("empty.yaml", QUIET_WORLD);
    let mut run = rig.spykee(&["calibrate", "camera", "--sim", "empty.yaml"]);
    assert_eq!(run.code().await, Some(1), "{}", run.text());
    let text = run.text();
    assert_contains(&text, &["no whole sheet of white paper", "darker floor"]);
    let mut run = rig.spykee(&["calibrate", "camera", "none.jpg"]);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["cannot read the picture none.jpg"]);
}
