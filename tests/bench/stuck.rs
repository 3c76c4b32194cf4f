//! `scripts/score-behaviours --stuck`: measures how often a script is told that its robot is
//! blocked, the rate of false alarms, and how far off its pose is, in flats that are generated and
//! in the built-in worlds.

#![allow(clippy::unwrap_used, unreachable_pub)]

#[path = "../worlds/mod.rs"]
#[allow(dead_code)] // the tests look at more of a flat
mod flats;
#[path = "../stuck/score.rs"]
mod score;

use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::available_parallelism;
use std::time::Duration;

use clap::Parser;
use spykee::agent::Behaviour;
use spykee::behaviour::{Launch, Library};
use spykee::robot::Priority;
use spykee::script;
use spykee::sim::{Trace, TraceEventKind, World};
use spykee::simulation::{self, Event, EventKind, Recorder, Simulation};
use tokio::time::sleep;

use self::score::{Looks, Said, Score};

const WANDER: &str = include_str!("../stuck/wander.lua");
/// Interval at which the state of the simulated robot is sampled.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Measures how often a script is told that its robot is blocked by something, the rate of false
/// alarms, and how far off its pose is after a minute. Exits with 1 if the goals are missed.
#[derive(Parser)]
#[command(name = "scripts/score-behaviours --stuck")]
struct Arguments {
    /// Robots in each world
    #[arg(long, default_value_t = 4)]
    seeds: u64,
    /// The seed of the first of them
    #[arg(long, default_value_t = 1)]
    first: u64,
    /// Virtual minutes for which each robot drives
    #[arg(long, default_value_t = 8)]
    minutes: u64,
    /// Only this built-in world
    #[arg(long)]
    world: Option<String>,
    /// Number of generated flats, each with one robot
    #[arg(long, default_value_t = 12)]
    flats: u64,
    /// The seed of the first flat
    #[arg(long, default_value_t = 1001)]
    first_flat: u64,
    /// No built-in worlds
    #[arg(long)]
    only_flats: bool,
    /// Print every missed blockage and every false alarm
    #[arg(long)]
    list: bool,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let arguments = Arguments::parse_from(arguments);
    println!("{}", Score::heading("world"));
    let flats = 0..if arguments.world.is_none() {
        arguments.flats
    } else {
        0
    };
    let flats = flats.map(|number| (flats::flat(arguments.first_flat + number).world, number + 1));
    let unseen = score("generated flats", flats.collect(), &arguments);
    let mut builtin = Score::default();
    for name in World::builtin_names() {
        if arguments.only_flats || arguments.world.as_deref().is_some_and(|only| only != name) {
            continue;
        }
        let seeds = arguments.first..arguments.first + arguments.seeds;
        let robots = seeds.map(|seed| (World::builtin(name).unwrap(), seed));
        builtin.add(score(name, robots.collect(), &arguments));
    }
    println!("{}", builtin.line("all built-in worlds"));
    for (name, score) in [("generated flats", &unseen), ("built-in worlds", &builtin)] {
        println!("\nIn {name}: {}", score.rates());
        score.print_kinds();
    }
    let judged = if arguments.flats > 0 && arguments.world.is_none() {
        unseen
    } else {
        builtin
    };
    ExitCode::from(u8::from(!judged.reaches_the_goals()))
}

/// Runs a robot in each of these worlds, with a seed each, on all processors; prints the sum.
fn score(name: &str, robots: Vec<(World, u64)>, arguments: &Arguments) -> Score {
    let time = Duration::from_secs(60 * arguments.minutes);
    let next = AtomicUsize::new(0);
    let sum = Mutex::new(Score::default());
    let work = || {
        while let Some((world, seed)) = robots.get(next.fetch_add(1, Ordering::Relaxed)) {
            let played = play(world.clone(), *seed, time);
            sum.lock().unwrap().add(played);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    let score = sum.into_inner().unwrap();
    println!("{}", score.line(name));
    if arguments.list {
        score.notes.iter().for_each(|note| eprintln!("  {note}"));
    }
    score
}

fn play(world: World, seed: u64, time: Duration) -> Score {
    let logged = Arc::new(Mutex::new(Vec::new()));
    let recorded = logged.clone();
    let options = simulation::Options {
        seed,
        events: Some(Recorder::new(move |event: Event| {
            if let (EventKind::Log, Some(said)) = (event.kind, Said::parse(&event.text)) {
                recorded.lock().unwrap().push((event.at, said));
            }
        })),
        ..simulation::Options::default()
    };
    let people: Vec<String> = world.walkers.iter().map(|one| one.name.clone()).collect();
    let who = format!("{}, seed {seed}", world.name);
    let mut looks = Looks::default();
    simulation::run(world, options, async |simulation: &Simulation| {
        let run = simulation.start(vec![behaviour(seed)], None);
        while simulation.now() < time {
            sleep(LOOK_EVERY).await;
            let state = simulation.sim().state();
            looks.take(simulation.now(), &state, || {
                simulation.sim().look_back(|trace| obstacle(trace, &people))
            });
            if state.battery < 60.0 {
                simulation.sim().set_battery(90.0);
            }
        }
        run.stop();
        drop(run.outcome().await);
    })
    .unwrap();
    let logged = logged.lock().unwrap().clone();
    looks.score(&logged, time, &who)
}

/// Returns the kind of thing that the robot ran into last.
fn obstacle(trace: &Trace, people: &[String]) -> &'static str {
    let collision = trace
        .events()
        .iter()
        .rev()
        .find_map(|event| match &event.kind {
            TraceEventKind::Collision(name) => Some(name.as_str()),
            _ => None,
        });
    match collision {
        Some("wall") => "wall",
        Some("post") => "post",
        Some("ball") => "ball",
        Some("station") => "station",
        Some("walker") => "person",
        Some(name) if people.iter().any(|one| one == name) => "person",
        _ => "furniture",
    }
}

fn behaviour(seed: u64) -> Behaviour {
    Behaviour {
        priority: Priority(0),
        launch: Launch {
            source: WANDER.into(),
            options: script::Options {
                seed,
                ..script::Options::new("wander", "wander.lua")
            },
            library: Library::default(),
        },
        checked: false,
        restart: "never".parse().unwrap(),
        reloads: None,
    }
}
