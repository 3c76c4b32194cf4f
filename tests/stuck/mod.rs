//! How often a script is told that its robot is blocked by something, the rate of false alarms, and
//! how far off its pose is after a minute.

mod score;

use std::sync::{Arc, Mutex};
use std::thread::available_parallelism;
use std::time::Duration;

use spykee::script;
use spykee::sim::{Trace, TraceEventKind, World};
use spykee::simulation::{self, Event, EventKind, Recorder, Simulation};
use tokio::time::sleep;

pub use self::score::Score;
use self::score::{Looks, Said};
use super::{behaviour, in_parallel};

const WANDER: &str = include_str!("wander.lua");
/// Interval at which the state of the simulated robot is sampled.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Runs a robot in each of these worlds, with a seed each, on all processors; returns the sum.
pub fn play_all(robots: &[(World, u64)], time: Duration) -> Score {
    let threads = available_parallelism().map_or(1, usize::from);
    let play = |(world, seed): &(World, u64)| play(world.clone(), *seed, time);
    let mut sum = Score::default();
    in_parallel(robots, threads, play)
        .into_iter()
        .for_each(|score| sum.add(score));
    sum
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
    let options_of_script = script::Options {
        seed,
        ..script::Options::new("wander", "wander.lua")
    };
    let wander = behaviour(WANDER, options_of_script);
    let mut looks = Looks::default();
    simulation::run(world, options, async |simulation: &Simulation| {
        let run = simulation.start(vec![wander], None);
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
