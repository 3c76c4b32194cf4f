//! Parameters, the store, modules and the built-in library from a person's view: the real program
//! and a simulated robot.

use std::os::unix::fs::{PermissionsExt as _, symlink};
use std::path::PathBuf;
use std::time::Duration;

use rustix::process::Signal;
use spykee::wire::{Command, Led};
use tokio::time::{Instant, sleep};

use crate::rig::{Rig, Run, WAIT_LIMIT, assert_contains, moves, run_in};

const DECLARES: &str = "local p = params.declare{ speed = {default = 40, min = 10, max = 60, unit = '%'} }\n\
                        print('speed is', p.speed) robot.move(p.speed, p.speed, 0.2)";

fn run_with(rig: &Rig, script: &str, options: &[&str]) -> Run {
    let path = rig.file("script.lua", script);
    let start = ["run", path.to_str().unwrap(), "--robot", &rig.address];
    rig.spykee(&[&start[..], options].concat())
}

fn store_file(rig: &Rig) -> PathBuf {
    rig.folder().join("spykee-data/script/store.json")
}

#[tokio::test(flavor = "multi_thread")]
async fn a_parameter_comes_from_the_command_line() {
    let rig = Rig::quiet().await;
    let mut run = run_with(&rig, DECLARES, &["--param", "speed=50"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["speed is 50"]);
    let wire = Command::Move {
        left: 45,
        right: 45,
    };
    assert!(rig.commands(0).contains(&wire), "{:?}", rig.commands(0));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_bad_parameter_is_refused_before_the_robot_moves() {
    for (param, script, words) in [
        (
            "speed=500",
            DECLARES,
            "--param speed=500: speed must be a number from 10 to 60",
        ),
        ("spede=50", DECLARES, "did you mean 'speed'?"),
        (
            "speed=50",
            "robot.move(50, 50, 0.2)",
            "declares no parameters",
        ),
    ] {
        let rig = Rig::quiet().await;
        // Refused by the check before the run if it can know, and otherwise by the script itself.
        let checked = if script == DECLARES { 4 } else { 1 };
        for (options, code) in [(&["--no-check"][..], 1), (&[], checked)] {
            let mut run = run_with(&rig, script, &[&["--param", param], options].concat());
            assert_eq!(run.code().await, Some(code), "{}", run.text());
            assert_contains(&run.text(), &[words]);
        }
        assert!(!rig.commands(0).iter().any(moves), "{:?}", rig.commands(0));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_parameter_can_name_one_of_several_behaviours() {
    let rig = Rig::quiet().await;
    let one = rig.file("one.lua", DECLARES);
    let two = rig.file("two.lua", "print('two')");
    let files = [one.to_str().unwrap(), two.to_str().unwrap()];
    let start = ["run", files[0], files[1], "--robot", &rig.address];
    for (param, code, words) in [
        ("one.speed=30", 0, "speed is 30"),
        ("speed=30", 2, "for which behaviour?"),
        ("oen.speed=30", 2, "did you mean 'one'?"),
    ] {
        let mut run = rig.spykee(&[&start[..], &["--param", param]].concat());
        assert_eq!(run.code().await, Some(code), "{}", run.text());
        assert_contains(&run.text(), &[words]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_store_survives_the_end_and_is_private() {
    let rig = Rig::quiet().await;
    let script = "store.set('runs', store.get('runs', 0) + 1) print('run', store.get('runs'))";
    for number in 1..=3 {
        let mut run = run_with(&rig, script, &[]);
        assert_eq!(run.code().await, Some(0), "{}", run.text());
        assert_contains(&run.text(), &[&format!("run {number}")]);
    }
    let mode = std::fs::metadata(store_file(&rig))
        .unwrap()
        .permissions()
        .mode();
    assert_eq!(mode & 0o777, 0o600);
}

/// The number that is stored in the file.
fn kept(rig: &Rig) -> f64 {
    let file = std::fs::read(store_file(rig)).unwrap();
    let values: serde_json::Value = serde_json::from_slice(&file).unwrap();
    values["count"].as_f64().unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn the_store_survives_kill_9_of_the_host_and_of_the_agent() {
    const COUNTS: &str = "print('begins with', store.get('count', 0))
        local count = store.get('count', 0)
        while true do
            count += 1
            store.set('count', count) store.set('ballast', ('x'):rep(100000 + count % 7))
            robot.led('left', count % 20 == 0)
            task.wait(0.01)
        end";
    let rig = Rig::quiet().await;
    let mut before = 0.0;
    for round in 0..4 {
        let mut run = run_with(&rig, COUNTS, &[]);
        run.says(&format!("begins with {before}")).await;
        let begun = Instant::now();
        while !store_file(&rig).exists() || kept(&rig) < before + 20.0 {
            assert!(begun.elapsed() < WAIT_LIMIT, "{}", run.text());
            sleep(Duration::from_millis(20)).await;
        }
        match round % 2 {
            0 => run.signal(Signal::KILL),
            _ => rustix::process::kill_process(run.hosts()[0], Signal::KILL).unwrap(),
        }
        assert_ne!(run.status().await.code(), Some(0));
        // The host of a killed agent dies with it; until then it may still write.
        sleep(Duration::from_millis(200)).await;
        let after = kept(&rig);
        assert!(after > before, "{after} after {before}");
        before = after;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_truncated_store_is_renamed_and_reported() {
    let rig = Rig::quiet().await;
    let file = store_file(&rig);
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::write(&file, "{\n\"runs\": 7").unwrap();
    let mut run = run_with(&rig, "print('has', #store.keys()) store.set('a', 1)", &[]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    for words in ["has 0", "is damaged", "store.json.bad"] {
        assert!(run.text().contains(words), "{words}: {}", run.text());
    }
    let bad = std::fs::read(file.with_extension("json.bad")).unwrap();
    assert_eq!(bad, b"{\n\"runs\": 7");
    assert!(std::fs::read_to_string(file).unwrap().contains("\"a\""));
}

#[tokio::test(flavor = "multi_thread")]
async fn modules_come_from_the_scripts_folder_only() {
    let rig = Rig::quiet().await;
    let folder = rig.folder().join("behaviours");
    std::fs::create_dir_all(folder.join("lib")).unwrap();
    rig.file("secret.lua", "return 'secret'");
    symlink(rig.folder(), folder.join("up")).unwrap();
    symlink(rig.folder().join("secret.lua"), folder.join("link.lua")).unwrap();
    std::fs::write(
        folder.join("lib/half.lua"),
        "return function(x) return x / 2 end",
    )
    .unwrap();
    std::fs::write(folder.join("code.lua"), b"\x1bLua\x00").unwrap();
    let script = "print('half', require('./lib/half')(42))
        for _, path in { '../secret', './up/secret', './link', '/etc/passwd', './Lib/half', './lib/HALF', './code' } do
            print(path, pcall(require, path))
        end
        ";
    let script = {
        let path = folder.join("main.lua");
        std::fs::write(&path, script).unwrap();
        path
    };
    let mut run = rig.spykee(&["run", script.to_str().unwrap(), "--robot", &rig.address]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    assert_contains(&text, &["half 21"]);
    for words in [
        "../secret false",
        "leaves the behaviour's folder",
        "./up/secret false",
        "up is a symbolic link",
        "./link false",
        "link.lua is a symbolic link",
        "/etc/passwd false",
        "./Lib/half false",
        "./lib/HALF false",
        "did you mean 'half'?",
        "./code false",
        "control character",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_program_of_a_beginner_drives() {
    let rig = Rig::quiet().await;
    let script = "local easy = require('@spykee/easy')
        easy.light('left', 'on') print('forward', easy.forward(0.4)) print('left', easy.left(30)) easy.light('left', 'off')";
    let mut run = run_with(&rig, script, &[]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    assert_contains(&text, &["forward true", "left true"]);
    assert!(rig.commands(0).iter().any(moves));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_first_program_of_a_beginner_leaves_the_station() {
    let rig = Rig::quiet().await;
    rig.file("first.lua", "require('@spykee/easy').forward(2)");
    rig.file(
        "first_test.lua",
        "scenario('off', { world = 'playpen', battery = 80 }, function(sim)
            expect(sim:docked())
            sim:run()
            expect(sim:wait_until(function() return sim:ended() end, 60))
            expect(not sim:docked(), 'it is on its station again')
        end)",
    );
    let mut run = rig.spykee(&["test"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
}

#[tokio::test(flavor = "multi_thread")]
async fn a_state_machine_exits_its_state_in_order_when_it_is_interrupted() {
    let rig = Rig::quiet().await;
    let script = "local fsm = require('@spykee/fsm')
        fsm.new{ initial = 'wait', states = {
            wait = { task = function() task.wait(0.1) return 'drive' end },
            drive = { task = function() robot.move(40, 40) task.wait(60) end,
                      exit = function() print('leaves drive') robot.led('flash', true) end },
        } }:run()";
    let mut run = run_with(&rig, script, &[]);
    rig.heard_motion(0).await;
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    assert_contains(&run.text(), &["leaves drive"]);
    let flash = Command::Led {
        led: Led::Flash,
        on: true,
    };
    rig.heard(0, |command| *command == flash).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_controller_turns_the_robot_to_the_ball() {
    const WORLD: &str = "
name: test
room: { width: 8, depth: 8 }
station: { at: [0, 4], heading_degrees: 0 }
start: { at: [4, 4], heading_degrees: 90 }
battery: { level: 90, idle_drain_per_minute: 0.01, driving_drain_per_minute: 0.01 }
balls:
  - { at: [4.35, 5.2], colour: red }
";
    let rig = Rig::new(WORLD, spykee::sim::Firmware::default()).await;
    // The tracks of the simulated robot start at 5.5 %: it can turn slowly.
    rig.file("spykee.yaml", "calibration: { least_power: 6 }\n");
    let script = "local pid = require('@spykee/pid')
        local steer = pid.new{ kp = 1.5, ki = 0.3, kd = 0.1, min = -1, max = 1 }
        local good = 0
        while good < 5 do
            local frame = robot.wait_frame(5)
            local ball = frame and frame:find_blobs('red', { pixels_threshold = 25 })[1]
            if ball then
                robot.drive(0, -steer:update(ball.bearing))
                good = if math.abs(ball.bearing) < 0.03 then good + 1 else 0
            end
        end
        print('ahead')";
    let mut run = run_with(&rig, script, &["--for", "40"]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["ahead"]);
}

/// The free distance that `floor.look` tells 4.4 m before a wall, with these things in the world.
async fn free_ahead(pitch: i32, things: &str) -> f64 {
    free_ahead_in(&format!(
        "room: {{width: 6, depth: 4, floor: concrete}}
station: {{at: [0, 3.5], heading_degrees: 0}}
start: {{at: [1.5, 2], heading_degrees: 0}}
camera: {{pitch: {pitch}}}
{things}
"
    ))
    .await
}

/// The free distance that `floor.look` tells at the start of a world.
async fn free_ahead_in(world: &str) -> f64 {
    seen_at_the_start("free.ahead", world).await
}

/// What an expression of `free`, the result of `floor.look`, is at the start of a world.
async fn seen_at_the_start(expression: &str, world: &str) -> f64 {
    let rig = Rig::quiet().await;
    rig.file("world.yaml", world);
    let config = "limits: { callback_budget_ms: 5000 }\n"; // on a busy machine a look takes long
    rig.file("spykee.yaml", config);
    let script = format!(
        "local free = require('@spykee/floor').look(robot.wait_frame(5))
         print('seen', {expression})"
    );
    rig.file("look.lua", &script);
    let mut run = rig.spykee(&[
        "run",
        "look.lua",
        "--sim",
        "world.yaml",
        "--fast",
        "--seed",
        "1",
        "--no-check", // `columns` are the library's own
    ]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    let text = run.text();
    let told = text.split_once("seen ").unwrap().1;
    told.split_whitespace().next().unwrap().parse().unwrap()
}

/// The dark edges of a genuine picture looked like the end of a floor, 1.3 to 1.8 m away.
#[tokio::test(flavor = "multi_thread")]
async fn a_wall_that_hides_the_floor_is_not_taken_for_floor() {
    for away in [0.3, 0.6] {
        let x = 5.9 - away; // the lens is 0.1 m in front of the robot's middle
        let room = format!(
            "preset: genuine
room: {{width: 6, depth: 4, floor: wood, walls: \"#d8cfbb\"}}
station: {{at: [0, 3.5], heading_degrees: 0}}
start: {{at: [{x}, 2], heading_degrees: 0}}
light: 1
"
        );
        let first = seen_at_the_start("if free.columns[1].known then 1 else 0", &room).await;
        let last = seen_at_the_start("if free.columns[24].known then 1 else 0", &room).await;
        assert_eq!((first, last), (0.0, 0.0), "{away} m");
    }
}

/// The floor seemed to end at the upper edge of the board, 1.45 times as far away.
#[tokio::test(flavor = "multi_thread")]
async fn the_floor_ends_at_the_foot_of_a_wall_and_not_at_the_edge_of_its_skirting_board() {
    for floor in ["concrete", "tiles", "wood"] {
        for (light, paint) in [(0.5, "#8f9d90"), (1.0, "#d8cfbb")] {
            for away in [1.2, 1.6] {
                let x = 5.9 - away; // the lens is 0.1 m in front of the robot's middle
                let room = format!(
                    "room: {{width: 6, depth: 4, floor: {floor}, walls: \"{paint}\"}}
station: {{at: [0, 3.5], heading_degrees: 0}}
start: {{at: [{x}, 2], heading_degrees: 0}}
light: {light}
"
                );
                let share = free_ahead_in(&room).await / away;
                assert!(
                    (0.75..1.15).contains(&share),
                    "{floor}, {light}, {away} m: {share}"
                );
            }
        }
    }
}

/// The edge of a rug and of the light that falls through a doorway counted as a wall.
#[tokio::test(flavor = "multi_thread")]
async fn a_rug_and_light_on_the_floor_are_no_wall() {
    let rug = "rugs: [{at: [3.9, 2], width: 1.2, depth: 2, colour: \"#c6cbca\"}]";
    let lamp = "walls: [{from: [0.5, 2.6], to: [3, 2.6]}, {from: [3.7, 2.6], to: [6, 2.6]}]
light: 0.55
lamps: [{at: [3.2, 3.3], brightness: 0.63}]";
    for things in [rug, lamp] {
        let room = format!(
            "room: {{width: 6, depth: 4, floor: concrete, walls: \"#8f9d90\"}}
station: {{at: [0, 3.5], heading_degrees: 0}}
start: {{at: [1.3, 1.7], heading_degrees: 0}}
{things}
"
        );
        let end = seen_at_the_start("free.columns[12].away", &room).await;
        assert!(
            end < 2.5,
            "nothing seems to end the floor: {end} m, {things}"
        );
        let ray = "require('@spykee/map').rays(free.columns)[12].distance";
        let wall = seen_at_the_start(ray, &room).await;
        assert!((3.3..4.5).contains(&wall), "{wall} m, {things}");
    }
}

/// A wall that fills the picture at one side counted as the floor there, since there was more of it farther away;
/// then nothing else was floor.
#[tokio::test(flavor = "multi_thread")]
async fn the_floor_is_visible_between_walls_of_the_same_colour() {
    for light in [0.5, 0.8] {
        let doorway = format!(
            "room: {{width: 6, depth: 4, floor: wood, walls: \"#808080\"}}
station: {{at: [0, 3.5], heading_degrees: 0}}
start: {{at: [2, 2], heading_degrees: 0}}
walls: [{{from: [2.6, 0], to: [2.6, 1.85]}}, {{from: [3.2, 2.15], to: [3.2, 4]}}]
light: {light}
"
        );
        for (column, least, most) in [(4, 0.9, 1.3), (14, 3.0, 4.1)] {
            let end = format!("free.columns[{column}].away");
            let end = seen_at_the_start(&end, &doorway).await;
            assert!((least..most).contains(&end), "column {column}: {end} m");
        }
    }
}

/// With its head bent so far down, the camera shows the floor up to 1.6 m.
#[tokio::test(flavor = "multi_thread")]
async fn what_is_above_the_picture_is_not_free_floor() {
    let free = free_ahead(-30, "").await;
    assert!((1.0..2.0).contains(&free), "{free} m");
}

/// With a wall in the floor's colour the floor seemed to reach 4 m.
#[tokio::test(flavor = "multi_thread")]
async fn the_floor_ends_at_a_wall_in_its_colour() {
    let room = "room: {width: 6, depth: 4, floor: concrete, walls: \"#727b7c\"}
station: {at: [0, 3.5], heading_degrees: 0}
start: {at: [3.2, 2], heading_degrees: 0}
light: 0.45
";
    let end = seen_at_the_start("free.columns[20].away", room).await;
    assert!((2.0..3.5).contains(&end), "{end} m instead of 2.7");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_stands_right_in_front_of_the_robot_is_no_floor() {
    for pitch in [-10, 0, 5] {
        let empty = free_ahead(pitch, "").await;
        assert!(empty > 3.0, "pitch {pitch}: {empty}");
        // The least floor that a level camera shows is 0.9 m away.
        for (away, radius, colour) in [
            (0.6, 0.11, "red"),
            (0.95, 0.11, "red"),
            (0.95, 0.08, "blue"),
            (0.8, 0.12, "green"),
        ] {
            let x = 1.6 + away + radius;
            let ball = format!("balls: [{{at: [{x}, 2], colour: {colour}, radius: {radius}}}]");
            let free = free_ahead(pitch, &ball).await;
            assert!(free < 1.3 * away, "pitch {pitch}, {ball}: {free}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_sheet_of_paper_is_free_floor_and_what_stands_is_not() {
    for (pitch, x) in [(-10, 2.5), (-10, 2.8), (0, 2.9)] {
        let sheet = format!("rugs: [{{at: [{x}, 2], width: 0.21, depth: 0.297, colour: white}}]");
        let free = free_ahead(pitch, &sheet).await;
        assert!(free > 3.0, "pitch {pitch}, sheet at {x}: {free}");
        let standing = [
            format!("{sheet}\nposts: [{{at: [{x}, 2], radius: 0.03, height: 0.6, colour: black}}]"),
            format!("{sheet}\nballs: [{{at: [{x}, 2], radius: 0.08, colour: red}}]"),
            format!("balls: [{{at: [{x}, 2], radius: 0.05, colour: yellow}}]"),
            format!("balls: [{{at: [{x}, 2], radius: 0.12, colour: red}}]"),
            format!("rugs: [{{at: [{x}, 2], width: 0.21, depth: 0.5, colour: white}}]"),
        ];
        for things in standing {
            let free = free_ahead(pitch, &things).await;
            assert!(free < x - 1.5, "pitch {pitch}, {things}: {free}");
        }
    }
}

/// A cupboard ahead on the left whose foot the camera does not show: the robot must not turn to it, and not pass it
/// too closely, although it is out of sight after a small turn to the right.
#[test]
fn what_filled_a_part_of_the_picture_is_remembered_beside_the_robot() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file(
        "room.yaml",
        "name: room
room: { width: 5, depth: 4 }
furniture:
  - { name: cupboard, at: [2.05, 2.45], length: 1, width: 1, height: 1.2, colour: \"#804020\" }
station: { at: [0, 3], heading_degrees: 0 }
start: { at: [1, 2], heading_degrees: 0 }
",
    );
    file(
        "look.lua",
        "local near = require('@spykee/floor').memory()
         for _, turn in { 0, 30, 20 } do
             robot.turn(-math.rad(turn))
             robot.wait_frame(2)
             local free = near:look(robot.wait_frame(2))
             print('free', free.ahead > 1, free.beside.left, free.beside.right)
         end",
    );
    let run = "run look.lua --sim room.yaml --fast --seed 1";
    let ended = run_in(folder.path(), &run.split(' ').collect::<Vec<_>>());
    assert_eq!(ended.code, Some(0), "{}", ended.text());
    assert_contains(
        &ended.text(),
        &[
            "free false false false",
            "free false true false",
            "free true true false",
        ],
    );
}

/// The rescue measures its ways with it: they end where they should also on a robot that is slower than its commands.
#[tokio::test(flavor = "multi_thread")]
async fn whereabouts_tell_the_metres_ahead_since_the_last_call() {
    let rig = Rig::quiet().await;
    let mut run = rig.run(
        "local whereabouts = require('@spykee/whereabouts')
         whereabouts.follow()
         robot.turn(math.rad(90))
         for _, way in { 0.5, -0.3 } do
             robot.forward(way)
             print('off', math.abs(whereabouts.follow() - way) < 0.05)
         end
         print('end', whereabouts.follow() == 0)",
    );
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["off true", "end true"]);
    assert!(!run.text().contains("off false"), "{}", run.text());
}

/// A room behind a wall, which only a robot that has driven there sees.
const TWO_ROOMS: &str = "
name: two rooms
room: { width: 5.4, depth: 3.6 }
walls: [{ from: [2.6, 0], to: [2.6, 2.2] }]
balls: [{ at: [4.6, 0.6], colour: red }]
station: { at: [0, 3], heading_degrees: 0 }
start: { at: [1.2, 1.2], heading_degrees: 90 }
camera: { fps: 5 }
";

/// It returns what is behind the wall, facing it; what is nowhere is looked for until all is seen, and
/// the robot has hit nothing.
#[test]
fn a_search_of_the_floor_finds_what_is_behind_a_wall_and_ends_when_all_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file("rooms.yaml", TWO_ROOMS);
    let playpen = spykee::sim::World::builtin_yaml("playpen").unwrap();
    file("pen.yaml", &format!("{playpen}\ncamera: {{ fps: 5 }}\n"));
    let search = "local looked = 0
        local thing, code = require('@spykee/floor').search(function(frame)
            looked += 1
            return frame:find_blobs('red', { pixels_threshold = 60 })[1]
        end, { seconds = 600 })
        print(code, thing and math.abs(thing.bearing) < 0.6, looked > 20)";
    file("red.lua", search);
    file("cyan.lua", &search.replace("red", "cyan"));
    for (script, world, said) in [
        ("red.lua", "rooms.yaml", "found true true"),
        ("cyan.lua", "pen.yaml", "all_seen nil true"),
    ] {
        let fast = "--fast --for 700 --seed 1 --events events.jsonl";
        let run = ["run", script, "--sim", world].into_iter();
        let run = run.chain(fast.split(' ')).collect::<Vec<_>>();
        let ended = run_in(folder.path(), &run);
        assert_eq!(ended.code, Some(0), "{}", ended.text());
        assert_contains(&ended.text(), &[said]);
        let events = std::fs::read_to_string(folder.path().join("events.jsonl")).unwrap();
        let end: serde_json::Value = serde_json::from_str(events.lines().last().unwrap()).unwrap();
        assert_eq!(end["collisions"], 0, "{end}");
        let driven = end["distance"].as_f64().unwrap();
        assert!(driven > 1.0, "{end}");
    }
}

/// A module that is loaded may be required by one that it requires later.
#[tokio::test(flavor = "multi_thread")]
async fn modules_that_are_loaded_may_require_each_other_in_functions() {
    let rig = Rig::quiet().await;
    rig.file(
        "one.lua",
        "return { go = function() return require('./two').word end, word = 'done' }",
    );
    rig.file(
        "two.lua",
        "local one = require('./one') return { word = one.word }",
    );
    let mut run = rig.run("print(require('./one').go())");
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["done"]);
}
