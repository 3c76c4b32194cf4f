//! Runs in virtual time: the same seed gives the same run, safety rules hold as with a real robot,
//! and many runs work in parallel.

use std::path::Path;
use std::time::Duration;

use rustix::process::Signal;
use spykee::agent::Behaviour;
use spykee::robot::{EndReason, Priority};
use spykee::script;
use spykee::sim::World;
use spykee::simulation::{self, Event, EventKind, Recorder, Simulation};
use spykee::wire::Command;
use tokio::time::timeout;

use crate::long_runs;
use crate::rig::{QUIET_WORLD, Rig, Stopwatch, assert_contains, exact};

const FOLLOWS: &str = "
robot.on('frame', function(frame)
    local ball = frame:find_blobs('red')[1]
    if ball then log.info('ball', { x = math.round(ball.cx) }) end
    robot.move(20 + math.random(0, 20), 30)
end)
";

const WANDERS: &str = "
while true do
    robot.forward(0.2 + math.random() / 5)
    robot.turn(math.random() * 3)
    robot.play('laser')
    task.wait(math.random())
end
";

pub fn behaviour(name: &str, source: &str, priority: i16, seed: u64) -> Behaviour {
    let mut options = script::Options {
        seed,
        ..script::Options::new(name.to_owned(), format!("{name}.lua"))
    };
    options.limits.callback_budget_ms = 5_000; // on a busy machine a look at a picture takes long
    Behaviour {
        priority: Priority(priority),
        ..long_runs::behaviour(source, options)
    }
}

pub fn quiet_world() -> World {
    World::from_yaml(QUIET_WORLD, "test world").unwrap()
}

fn options(seed: u64) -> (simulation::Options, impl FnOnce() -> Vec<Event>) {
    let (recorder, events) = Recorder::keeping();
    let options = simulation::Options {
        seed,
        events: Some(recorder),
        ..simulation::Options::default()
    };
    (options, move || events.lock().clone())
}

/// The event log of half a virtual minute with two behaviours that compete for the tracks and use
/// the camera.
fn log(seed: u64) -> Vec<String> {
    let (options, events) = options(seed);
    let limit = Some(Duration::from_secs(30));
    let behaviours = vec![
        behaviour("follows", FOLLOWS, 0, seed),
        behaviour("follows too", FOLLOWS, 0, seed + 1),
        behaviour("wanders", WANDERS, 0, seed + 2),
    ];
    simulation::run(
        exact("living_room"),
        options,
        async |simulation: &Simulation| {
            simulation.start(behaviours, limit).outcome().await.unwrap();
        },
    )
    .unwrap();
    let lines = events().into_iter();
    lines
        .map(|event| serde_json::to_string(&event).unwrap())
        .collect()
}

#[test]
fn the_same_seed_gives_the_same_run_even_beside_another_and_another_seed_differs() {
    let (first, second, other) = std::thread::scope(|scope| {
        let first = scope.spawn(|| log(5));
        let other = scope.spawn(|| log(6));
        let first = first.join().unwrap();
        (first, log(5), other.join().unwrap())
    });
    assert!(first.len() > 50, "hardly anything happened: {first:#?}");
    let differs = first.iter().zip(&second).find(|(one, two)| one != two);
    assert_eq!(differs, None);
    assert_eq!(first.len(), second.len());
    assert_ne!(first, other);
}

/// Compares debug and release builds with the same file. After a change that is meant to change
/// runs, write the file again with `SPYKEE_TEST_WRITE_EVENTS=1 cargo test every_build_writes`, and
/// review the difference.
#[test]
fn every_build_writes_the_same_events_for_the_same_seed() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/run-7.jsonl");
    let log = log(7).join("\n") + "\n";
    if std::env::var_os("SPYKEE_TEST_WRITE_EVENTS").is_some() {
        std::fs::write(&file, &log).unwrap();
    }
    let kept = std::fs::read_to_string(&file).unwrap();
    let differs = kept.lines().zip(log.lines()).find(|(one, two)| one != two);
    assert_eq!(differs, None);
    assert_eq!(kept.len(), log.len());
}

#[test]
fn a_stuck_script_is_ended_with_reason_cpu_and_the_tracks_stop() {
    let (options, events) = options(1);
    let stuck = "robot.move(50, 50) task.wait(1) while true do end";
    let (outcome, state) =
        simulation::run(quiet_world(), options, async |simulation: &Simulation| {
            let run = simulation.start(vec![behaviour("stuck", stuck, 0, 1)], None);
            let outcome = run.outcome().await.unwrap();
            let rests = simulation.sim().wait_state(|state| !state.moving());
            (outcome, timeout(Duration::from_secs(5), rests).await)
        })
        .unwrap();
    assert_eq!(outcome.exits[0].1.reason, EndReason::Cpu);
    assert_eq!(state.unwrap().speeds.left, 0.0);
    let events = events();
    let ended = events
        .iter()
        .find(|event| event.kind == EventKind::Ended)
        .unwrap();
    assert_eq!(ended.field("reason"), Some("cpu"));
    assert!(ended.text.contains("stuck.lua:1"), "{ended:?}");
    assert!(
        ended.at < Duration::from_secs(2),
        "virtual time passed meanwhile: {ended:?}"
    );
}

#[test]
fn a_robot_with_a_low_battery_goes_home_in_virtual_time() {
    let (options, _) = options(2);
    let began = Stopwatch::start();
    let (home, now) = simulation::run(quiet_world(), options, async |simulation: &Simulation| {
        let drives = "while true do robot.forward(0.5) robot.turn(math.pi) end";
        let run = simulation.start(vec![behaviour("drives", drives, 0, 2)], None);
        tokio::time::sleep(Duration::from_secs(600)).await;
        simulation.sim().set_battery(15.0);
        let home = simulation
            .sim()
            .wait_state(|state| state.docked && state.charging);
        let home = timeout(Duration::from_secs(300), home).await;
        run.stop();
        run.outcome().await.unwrap();
        (home, simulation.now())
    })
    .unwrap();
    assert!(home.is_ok(), "it did not dock");
    assert!(now > Duration::from_secs(600) && now < Duration::from_secs(1000));
    assert!(began.elapsed() < now / 5, "{:?}", began.elapsed());
}

#[test]
fn one_robot_serves_several_runs_in_turn() {
    let (options, _) = options(3);
    simulation::run(quiet_world(), options, async |simulation: &Simulation| {
        for expected in [0.5, 1.0] {
            let drives = "robot.forward(0.5)";
            let run = simulation.start(vec![behaviour("drives", drives, 0, 3)], None);
            let outcome = run.outcome().await.unwrap();
            assert_eq!(outcome.exits[0].1.reason, EndReason::Done);
            let driven = simulation.sim().state().pose.y - 4.0;
            assert!((driven - expected).abs() < 0.15, "{driven}");
        }
    })
    .unwrap();
}

/// How many short moves.
const SHORT_MOVES: usize = 24;
/// Metres that a track covers in a second of a short move.
const SHORT_MOVE_SPEED: f64 = 0.225;

/// Twelve times a short move and a turn: what the robot does.
fn driven_in_short_moves(commands_per_second: Option<f64>) -> Driven {
    let (mut options, _) = options(4);
    options.sim.firmware.commands_per_second = commands_per_second;
    let drives = "for _ = 1, 12 do robot.forward(0.1) robot.turn(math.pi / 6) end";
    simulation::run(quiet_world(), options, async |simulation: &Simulation| {
        let run = simulation.start(vec![behaviour("drives", drives, 0, 4)], None);
        let outcome = run.outcome().await.unwrap();
        assert_eq!(outcome.exits[0].1.reason, EndReason::Done);
        let heard = simulation.sim().heard_since(0);
        let setpoints = heard.iter().filter_map(|heard| match heard.command {
            Command::Move { left, right } => Some((left, right)),
            _ => None,
        });
        let mut setpoints: Vec<(i8, i8)> = setpoints.collect();
        setpoints.dedup();
        Driven {
            metres: simulation.sim().state().distance,
            moves: setpoints
                .iter()
                .filter(|setpoint| **setpoint != (0, 0))
                .count(),
        }
    })
    .unwrap()
}

#[test]
fn a_square_with_and_without_pauses_closes() {
    for pause in ["", "task.wait(1)"] {
        let (options, _) = options(4);
        let drives = format!(
            "for _ = 1, 4 do robot.forward(0.5) {pause} robot.turn(math.pi / 2) {pause} end"
        );
        let pose = simulation::run(quiet_world(), options, async |simulation: &Simulation| {
            let run = simulation.start(vec![behaviour("drives", &drives, 0, 4)], None);
            run.outcome().await.unwrap();
            simulation.sim().state().pose
        })
        .unwrap();
        let off = (pose.x - 4.0).hypot(pose.y - 4.0);
        let turned = (pose.heading.to_degrees() - 90.0).abs();
        assert!(off < 0.1 && turned < 5.0, "{pose:?} with '{pause}'");
    }
}

struct Driven {
    metres: f64,
    moves: usize,
}

#[test]
fn a_robot_that_executes_slowly_executes_each_short_move_for_its_time() {
    let usual = driven_in_short_moves(None);
    for rate in [3.0, 5.0, 10.0] {
        let slow = driven_in_short_moves(Some(rate));
        assert!(
            slow.moves >= SHORT_MOVES,
            "{} moves at {rate} a second",
            slow.moves
        );
        // A stop is executed at most one message later.
        let most = usual.metres + SHORT_MOVES as f64 * SHORT_MOVE_SPEED / rate;
        assert!(
            (0.8 * usual.metres..most).contains(&slow.metres),
            "{} instead of {} m at {rate} a second",
            slow.metres,
            usual.metres
        );
    }
}

async fn recorded(rig: &Rig, script: &Path, name: &str) -> String {
    rig.file("world.yaml", QUIET_WORLD);
    let file = rig.folder().join(name);
    let script = script.to_str().unwrap();
    let events = file.to_str().unwrap();
    let mut run = rig.spykee(&[
        "run",
        script,
        "--sim",
        "world.yaml",
        "--fast",
        "--for",
        "120",
        "--seed",
        "4",
        "--events",
        events,
    ]);
    assert_eq!(run.code().await, Some(0), "{}", run.text());
    assert_contains(&run.text(), &["0:02:00 simulated in"]);
    std::fs::read_to_string(file).unwrap()
}

#[tokio::test]
async fn the_command_writes_the_same_events_for_the_same_seed() {
    let rig = Rig::quiet().await;
    // Also print values whose only text form is an address: it must not appear in the events.
    let script = rig.file("wanders.lua", &format!("print({{}}, print)\n{WANDERS}"));
    let first = recorded(&rig, &script, "first.jsonl").await;
    assert!(first.lines().count() > 100, "{first}");
    assert_eq!(first, recorded(&rig, &script, "second.jsonl").await);
    let last: serde_json::Value = serde_json::from_str(first.lines().last().unwrap()).unwrap();
    assert_eq!(last["kind"], "end");
    assert!(
        last["x"].is_number() && last["battery"].is_number(),
        "{last}"
    );
}

#[tokio::test]
async fn an_interruption_ends_a_fast_run_promptly() {
    let rig = Rig::quiet().await;
    let script = rig.file(
        "drives.lua",
        "log.info('driving') robot.move(20, 30) while true do task.wait(1) end",
    );
    // Its battery lasts, however much virtual time passes before the signal.
    rig.file("world.yaml", QUIET_WORLD);
    let script = script.to_str().unwrap();
    let mut run = rig.spykee(&["run", script, "--sim", "world.yaml", "--fast"]);
    run.says("driving").await;
    let began = Stopwatch::start();
    run.signal(Signal::INT);
    assert_eq!(run.code().await, Some(130), "{}", run.text());
    assert!(began.elapsed() < Duration::from_secs(10));
}

#[tokio::test]
async fn fast_is_refused_with_a_real_robot() {
    let rig = Rig::quiet().await;
    let script = rig.file("idle.lua", "task.wait(1)");
    let args = [
        "run",
        script.to_str().unwrap(),
        "--robot",
        &rig.address,
        "--fast",
    ];
    let mut run = rig.spykee(&args);
    assert_eq!(run.code().await, Some(2), "{}", run.text());
    assert_contains(&run.text(), &["--fast needs --sim"]);
}
