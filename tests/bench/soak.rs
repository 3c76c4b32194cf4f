//! `scripts/soak`: virtual hours alone, and the table of promises.

#![allow(clippy::unwrap_used, unreachable_pub)]

use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

use clap::Parser;
use clap::value_parser as number;

#[path = "../soak/mod.rs"]
mod weeks;

use weeks::Ledger;

/// Patrol and guard alone for hours, in virtual time, while network, station and battery fail by lot.
/// Ends with 1 if a promise was broken.
#[derive(Parser)]
#[command(name = "scripts/soak")]
struct Arguments {
    /// Virtual hours of each run
    #[arg(long, default_value_t = 24, value_parser = number!(u64).range(1..))]
    hours: u64,
    /// The first run's troubles
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Runs, each with the next seed
    #[arg(long, default_value_t = 1, value_parser = number!(u64).range(1..))]
    seeds: u64,
    /// Runs at the same time
    #[arg(long, default_value_t = 1, value_parser = number!(u64).range(1..))]
    jobs: u64,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let arguments = Arguments::parse_from(arguments);
    let (seeds, began) = (
        arguments.seed..arguments.seed + arguments.seeds,
        Instant::now(),
    );
    let (waiting, total) = (Mutex::new(seeds), Mutex::new(Ledger::default()));
    std::thread::scope(|scope| {
        for _ in 0..arguments.jobs.min(arguments.seeds) {
            scope.spawn(|| work(arguments.hours, &waiting, &total, began));
        }
    });
    let total = total.into_inner().unwrap();
    print!("{total}");
    let untested = total.untested(&weeks::CORE);
    if !untested.is_empty() {
        println!("never put to the test: {}", untested.join("; "));
    }
    if total.is_kept() && untested.is_empty() {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Runs one seed after the other until none waits.
fn work(hours: u64, waiting: &Mutex<std::ops::Range<u64>>, total: &Mutex<Ledger>, began: Instant) {
    let next = || waiting.lock().unwrap().next();
    while let Some(seed) = next() {
        println!("{hours} h alone, seed {seed}");
        let folder = tempfile::tempdir().unwrap();
        let ledger = weeks::soak(hours, seed, folder.path(), &mut |hour, size| {
            println!(
                "seed {seed:>3} {hour:>4} h  {:>6} KiB  {:>3} threads  {:>3} descriptors  {:>5.0} s",
                size.resident_kib,
                size.threads,
                size.descriptors,
                began.elapsed().as_secs_f64()
            );
        });
        println!("seed {seed:>3}: {}", ledger.summary());
        total.lock().unwrap().add(&format!("seed {seed}"), ledger);
    }
}
