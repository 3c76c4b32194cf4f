//! `scripts/score-behaviours --stuck`: how often a script is told that its robot is held, and how often for
//! nothing.

#![allow(clippy::unwrap_used, unreachable_pub)]

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
use spykee::sim::{Pose, State, World};
use tokio::time::sleep;

const WANDER: &str = include_str!("../stuck/wander.lua");
/// How often the simulated robot is asked whether it is held.
const LOOK_EVERY: Duration = Duration::from_millis(20);
/// It must be told so soon.
const IN_TIME: Duration = Duration::from_secs(1);
/// What is told so long after the robot was held is not for nothing.
const LATELY: Duration = Duration::from_millis(700);
/// Percent of the blockings, and calls for nothing an hour.
const GOAL: (f64, f64) = (90.0, 1.0);

/// How often a script is told that its robot is held by something, and how often for nothing, in every world
/// that is part of the program. Ends with 1 if the goals are missed.
#[derive(Parser)]
#[command(name = "scripts/score-behaviours --stuck")]
struct Arguments {
    /// Robots in each world
    #[arg(long, default_value_t = 4)]
    seeds: u64,
    /// Virtual minutes that each drives about
    #[arg(long, default_value_t = 8)]
    minutes: u64,
    /// Only this world
    #[arg(long)]
    world: Option<String>,
    /// Print every blocking that was missed, and every call for nothing
    #[arg(long)]
    list: bool,
}

/// What became of a world's robots.
#[derive(Debug, Default, Clone)]
struct Score {
    blockings: usize,
    told: usize,
    /// Those that were told at all.
    late: usize,
    for_nothing: usize,
    driven: Duration,
    notes: Vec<String>,
}

impl Score {
    fn add(&mut self, other: Score) {
        self.blockings += other.blockings;
        self.told += other.told;
        self.late += other.late;
        self.for_nothing += other.for_nothing;
        self.driven += other.driven;
        self.notes.extend(other.notes);
    }

    fn line(&self, name: &str) -> String {
        format!(
            "| {name} | {} | {} ({:.0} %) | {} | {} in {:.1} h |",
            self.blockings,
            self.told,
            percent(self.told, self.blockings),
            self.late,
            self.for_nothing,
            hours(self.driven),
        )
    }

    fn reaches_the_goals(&self) -> bool {
        let an_hour = self.for_nothing as f64 / hours(self.driven).max(1.0);
        percent(self.told, self.blockings) >= GOAL.0 && an_hour <= GOAL.1
    }
}

fn percent(part: usize, whole: usize) -> f64 {
    100.0 * part as f64 / whole.max(1) as f64
}

fn hours(time: Duration) -> f64 {
    time.as_secs_f64() / 3600.0
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let arguments = Arguments::parse_from(arguments);
    println!("| world | blockings | told within a second | told later | told for nothing |");
    println!("| --- | --- | --- | --- | --- |");
    let mut all = Score::default();
    for name in World::ready_names() {
        if arguments.world.as_deref().is_some_and(|only| only != name) {
            continue;
        }
        let score = score(name, &arguments);
        println!("{}", score.line(name));
        if arguments.list {
            score.notes.iter().for_each(|note| eprintln!("  {note}"));
        }
        all.add(score);
    }
    println!("{}", all.line("all"));
    ExitCode::from(u8::from(!all.reaches_the_goals()))
}

/// All seeds of a world, on all processors.
fn score(name: &str, arguments: &Arguments) -> Score {
    let (next, sum) = (AtomicUsize::new(0), Mutex::new(Score::default()));
    let work = || loop {
        let seed = next.fetch_add(1, Ordering::Relaxed) as u64 + 1;
        if seed > arguments.seeds {
            return;
        }
        let time = Duration::from_secs(60 * arguments.minutes);
        sum.lock().unwrap().add(play(name, seed, time));
    };
    std::thread::scope(|scope| {
        for _ in 0..available_parallelism().map_or(1, usize::from) {
            scope.spawn(work);
        }
    });
    sum.into_inner().unwrap()
}

fn play(name: &str, seed: u64, time: Duration) -> Score {
    let told = Arc::new(Mutex::new(Vec::new()));
    let tell = told.clone();
    let options = lab::Options {
        seed,
        events: Some(Recorder::new(move |event: Event| {
            if event.kind == EventKind::Log && event.text.contains("blocked") {
                tell.lock().unwrap().push(event.at);
            }
        })),
        ..lab::Options::default()
    };
    let world = World::ready(name).unwrap();
    let mut looks = Looks::default();
    lab::run(world, options, async |lab: &Lab| {
        let run = lab.start(vec![behaviour(seed)], None);
        while lab.now() < time {
            sleep(LOOK_EVERY).await;
            looks.take(lab.now(), &lab.sim().state());
            if lab.sim().state().battery < 60.0 {
                lab.sim().set_battery(90.0);
            }
        }
        run.stop();
        drop(run.outcome().await);
    })
    .unwrap();
    let told = told.lock().unwrap().clone();
    looks.score(&told, time, &format!("{name}, seed {seed}"))
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

/// When the robot was held although its tracks should have moved it on.
#[derive(Default)]
struct Looks {
    held: Vec<Held>,
    /// The last look found it held.
    holds: bool,
}

struct Held {
    from: Duration,
    to: Duration,
    pose: Pose,
}

impl Looks {
    fn take(&mut self, now: Duration, state: &State) {
        let pushes = i16::from(state.commanded.left) + i16::from(state.commanded.right) != 0;
        let holds = state.blocked && pushes && !state.docked && !state.leaving;
        if holds && !self.holds {
            let pose = state.pose;
            self.held.push(Held {
                from: now,
                to: now,
                pose,
            });
        }
        if let (true, Some(last)) = (holds, self.held.last_mut()) {
            last.to = now;
        }
        self.holds = holds;
    }

    /// A blocking that ended by itself within the time for telling it is none.
    fn score(&self, told: &[Duration], driven: Duration, who: &str) -> Score {
        let mut score = Score {
            driven,
            ..Score::default()
        };
        for held in &self.held {
            let answer = told
                .iter()
                .find(|at| **at >= held.from && **at <= held.to + LATELY);
            match answer {
                Some(at) if *at <= held.from + IN_TIME => {
                    (score.blockings, score.told) = (score.blockings + 1, score.told + 1);
                }
                None if held.to < held.from + IN_TIME => {}
                answer => {
                    score.blockings += 1;
                    score.late += usize::from(answer.is_some());
                    let Pose { x, y, heading } = held.pose;
                    let degrees = heading.to_degrees();
                    let after = answer.map(|at| (*at - held.from).as_secs_f64());
                    score.notes.push(format!(
                        "{who}: held at {:.1} s for {:.1} s at {x:.2} {y:.2} m, {degrees:.0} degrees; told after {after:?}",
                        held.from.as_secs_f64(), (held.to - held.from).as_secs_f64(),
                    ));
                }
            }
        }
        for at in told {
            let really = |held: &Held| held.from <= *at && *at <= held.to + LATELY;
            if !self.held.iter().any(really) {
                score.for_nothing += 1;
                score.notes.push(format!(
                    "{who}: told for nothing at {:.1} s",
                    at.as_secs_f64()
                ));
            }
        }
        score
    }
}
