//! `scripts/rescue`: measures how many robots the watchdog alone brings home, in a table by
//! strategy.

#![allow(clippy::unwrap_used, unreachable_pub)]

use std::process::ExitCode;
use std::thread::available_parallelism;
use std::time::Instant;

use clap::Parser;

#[path = "../rescue/mod.rs"]
mod rescue;

use rescue::{Name, Place, Row, Strategy, heading, play_all};

/// Measures how many robots with a low battery the watchdog alone brings home, beside a behaviour
/// that does nothing. Exits with 1 if the default strategy misses its goal.
#[derive(Parser)]
#[command(name = "scripts/rescue")]
struct Arguments {
    /// Robots for each world and strategy
    #[arg(long, default_value_t = 120, value_parser = clap::value_parser!(u32).range(1..))]
    starts: u32,
    /// Seed of places, headings, battery levels and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this world
    #[arg(long)]
    world: Option<Name>,
    /// Only this strategy
    #[arg(long)]
    strategy: Option<Strategy>,
    /// Robots at the same time [default: one for each processor]
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..))]
    jobs: Option<u16>,
    /// Robots leave their station and drive for one to three minutes, and then on until they are
    /// far from home
    #[arg(long)]
    driven: bool,
    /// Print every start and how it ended
    #[arg(long)]
    list: bool,
}

/// Number of robots between two progress messages.
const PROGRESS_EVERY: usize = 10;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let arguments = Arguments::parse_from(arguments);
    let rows = rows(&arguments);
    println!("\n{}", heading());
    rows.iter().for_each(|row| println!("{row}"));
    let mut missed = rows.iter().filter(|row| row.misses_its_goal()).peekable();
    let code = match missed.peek() {
        Some(_) => ExitCode::FAILURE,
        None => ExitCode::SUCCESS,
    };
    for row in missed {
        let (world, goal) = (row.world.text(), row.world.goal());
        println!(
            "{world}: {:.1} % came home; the goal is {goal} %",
            row.percent()
        );
    }
    code
}

fn rows(arguments: &Arguments) -> Vec<Row> {
    let worlds = arguments
        .world
        .map_or(Name::ALL.to_vec(), |name| vec![name]);
    let mut rows = Vec::new();
    for world in worlds {
        let place = Place::named(world);
        let all = match arguments.driven {
            true => Strategy::DRIVEN,
            false => Strategy::PUT,
        };
        let strategies = arguments.strategy.map_or(all.to_vec(), |one| vec![one]);
        rows.extend(
            strategies
                .into_iter()
                .map(|strategy| row(arguments, &place, strategy)),
        );
    }
    rows
}

fn row(arguments: &Arguments, place: &Place, strategy: Strategy) -> Row {
    let count = arguments.starts as usize;
    let starts = match arguments.driven {
        true => place.drives(count, arguments.seed),
        false => place.starts(count, arguments.seed),
    };
    let cores = || available_parallelism().map_or(1, usize::from);
    let threads = arguments.jobs.map_or_else(cores, usize::from);
    let (what, began) = (
        format!("{}, {}", place.name.text(), strategy.text()),
        Instant::now(),
    );
    let report_progress = |done: usize| {
        if done.is_multiple_of(PROGRESS_EVERY) || done == starts.len() {
            let (all, seconds) = (starts.len(), began.elapsed().as_secs_f64());
            eprintln!("{what}: {done} of {all} done, {seconds:.0} s");
        }
    };
    let played = play_all(place, strategy, &starts, threads, &report_progress);
    if arguments.list {
        println!("{what}");
        played.iter().for_each(|one| println!("  {one}"));
    }
    Row::new(place.name, strategy, &played)
}
