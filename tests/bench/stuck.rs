//! `scripts/score-behaviours --stuck`: measures how often a script is told that its robot is
//! blocked, and the rate of false alarms.

#![allow(clippy::unwrap_used, unreachable_pub)]

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
use spykee::lab::{self, Event, EventKind, Lab, Recorder};
use spykee::robot::Priority;
use spykee::script;
use spykee::sim::{Trace, TraceEventKind, World};
use tokio::time::sleep;

use self::score::{Looks, Said, Score};

const WANDER: &str = include_str!("../stuck/wander.lua");
/// Interval at which the state of the simulated robot is sampled.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Measures in every built-in world how often a script is told that its robot is blocked by
/// something, and the rate of false alarms. Exits with 1 if the goals are missed.
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
    /// Only this world
    #[arg(long)]
    world: Option<String>,
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
    let names = World::builtin_names();
    let names: Vec<&str> = names
        .into_iter()
        .filter(|name| arguments.world.as_deref().is_none_or(|only| only == *name))
        .collect();
    let mut all = Score::default();
    println!("{}", Score::heading("world"));
    for name in names {
        let score = score(name, &arguments);
        println!("{}", score.line(name));
        if arguments.list {
            score.notes.iter().for_each(|note| eprintln!("  {note}"));
        }
        all.add(score);
    }
    println!("{}", all.line("all"));
    all.print_kinds();
    ExitCode::from(u8::from(!all.reaches_the_goals()))
}

/// Plays all seeds of a world, on all processors.
fn score(name: &str, arguments: &Arguments) -> Score {
    let (next, sum) = (AtomicUsize::new(0), Mutex::new(Score::default()));
    let work = || loop {
        let number = next.fetch_add(1, Ordering::Relaxed) as u64;
        if number >= arguments.seeds {
            return;
        }
        let time = Duration::from_secs(60 * arguments.minutes);
        let played = play(name, arguments.first + number, time);
        sum.lock().unwrap().add(played);
    };
    std::thread::scope(|scope| {
        for _ in 0..available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    sum.into_inner().unwrap()
}

fn play(name: &str, seed: u64, time: Duration) -> Score {
    let logged = Arc::new(Mutex::new(Vec::new()));
    let recorded = logged.clone();
    let options = lab::Options {
        seed,
        events: Some(Recorder::new(move |event: Event| {
            if let (EventKind::Log, Some(said)) = (event.kind, Said::parse(&event.text)) {
                recorded.lock().unwrap().push((event.at, said));
            }
        })),
        ..lab::Options::default()
    };
    let world = World::builtin(name).unwrap();
    let people: Vec<String> = world.walkers.iter().map(|one| one.name.clone()).collect();
    let mut looks = Looks::default();
    lab::run(world, options, async |lab: &Lab| {
        let run = lab.start(vec![behaviour(seed)], None);
        while lab.now() < time {
            sleep(LOOK_EVERY).await;
            let state = lab.sim().state();
            looks.take(lab.now(), &state, || {
                lab.sim().look_back(|trace| obstacle(trace, &people))
            });
            if state.battery < 60.0 {
                lab.sim().set_battery(90.0);
            }
        }
        run.stop();
        drop(run.outcome().await);
    })
    .unwrap();
    let logged = logged.lock().unwrap().clone();
    looks.score(&logged, time, &format!("{name}, seed {seed}"))
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
