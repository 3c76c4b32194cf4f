//! `scripts/month`: thirty days of a service, and the table of kept and broken promises.

#![allow(clippy::unwrap_used, unreachable_pub)]

use std::process::ExitCode;
use std::time::Instant;

use clap::Parser;
use clap::value_parser as number;

#[path = "../month/mod.rs"]
mod days;

/// Simulates days of a service in virtual time: a timetable, outages, a robot that is unreachable
/// for a night, a clock that is set back, power cuts. Then compares the history's record with the
/// simulator's. Exits with 1 if a promise was broken.
#[derive(Parser)]
#[command(name = "scripts/month")]
struct Arguments {
    /// Virtual days
    #[arg(long, default_value_t = 30, value_parser = number!(u64).range(1..))]
    days: u64,
    /// Seed of the faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Keep the data folder here, which must be empty, for `spykee history`
    #[arg(long, value_name = "DIR")]
    data: Option<std::path::PathBuf>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let Arguments { days, seed, data } = Arguments::parse_from(arguments);
    let (began, folder) = (Instant::now(), tempfile::tempdir().unwrap());
    let data = data.as_deref().unwrap_or(folder.path());
    println!("{days} days of service, seed {seed}");
    let ledger = days::serve(days, seed, data, &mut |day, size, bytes| {
        println!(
            "{day:>4} d  {:>6} KiB  {:>3} threads  {:>3} descriptors  {:>6} KiB of data  {:>5.0} s",
            size.resident_kib,
            size.threads,
            size.descriptors,
            bytes / 1024,
            began.elapsed().as_secs_f64()
        );
    });
    print!("{ledger}");
    let untested = ledger.untested(&days::CORE);
    if !untested.is_empty() {
        println!("never put to the test: {}", untested.join("; "));
    }
    println!(
        "{}; {:.0} s",
        ledger.summary(),
        began.elapsed().as_secs_f64()
    );
    match ledger.is_kept() && untested.is_empty() {
        true => ExitCode::SUCCESS,
        false => ExitCode::FAILURE,
    }
}
