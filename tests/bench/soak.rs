//! `scripts/soak`: virtual hours of unattended operation, and the table of kept and broken
//! promises.

#![allow(clippy::unwrap_used, unreachable_pub)]

use std::collections::VecDeque;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::time::Instant;

use clap::Parser;
use clap::value_parser as number;
use spykee::sim::Firmware;

#[path = "../soak/mod.rs"]
mod weeks;

use weeks::Ledger;

/// Runs patrol and guard unattended for hours of virtual time, with random failures of network,
/// station and battery. Exits with 1 if a promise was broken.
#[derive(Parser)]
#[command(name = "scripts/soak")]
struct Arguments {
    /// Virtual hours of each run
    #[arg(long, default_value_t = 24, value_parser = number!(u64).range(1..))]
    hours: u64,
    /// Seed of the first run's faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Runs, each with the next seed
    #[arg(long, default_value_t = 1, value_parser = number!(u64).range(1..))]
    seeds: u64,
    /// Runs at the same time
    #[arg(long, default_value_t = 1, value_parser = number!(u64).range(1..))]
    jobs: u64,
    /// The robot's firmware: a YAML file, or `matrix` for each of tests/firmware/ in turn
    #[arg(long, value_name = "FILE.yaml")]
    firmware: Option<PathBuf>,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let arguments = Arguments::parse_from(arguments);
    let firmwares = match firmwares(arguments.firmware.as_deref()) {
        Ok(firmwares) => firmwares,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(2);
        }
    };
    let seeds = arguments.seed..arguments.seed + arguments.seeds;
    let jobs: VecDeque<Job> = firmwares
        .into_iter()
        .flat_map(|(name, firmware)| {
            seeds
                .clone()
                .map(move |seed| (seed, name.clone(), firmware.clone()))
        })
        .collect();
    let began = Instant::now();
    let workers = arguments.jobs.min(jobs.len() as u64);
    let (waiting, total) = (Mutex::new(jobs), Mutex::new(Ledger::default()));
    std::thread::scope(|scope| {
        for _ in 0..workers {
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

/// A seed, and a firmware with its name.
type Job = (u64, String, Firmware);

/// Returns the requested firmwares, each with its name.
fn firmwares(asked: Option<&Path>) -> Result<Vec<(String, Firmware)>, Box<dyn Error>> {
    let Some(asked) = asked else {
        return Ok(vec![("usual".to_owned(), Firmware::default())]);
    };
    let mut files = vec![asked.to_owned()];
    if asked == Path::new("matrix") {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/firmware");
        let entries = std::fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
        files = entries.iter().map(|entry| entry.path()).collect();
        files.retain(|file| {
            file.extension()
                .is_some_and(|extension| extension == "yaml")
        });
        files.sort_unstable();
    }
    let name = |file: &Path| {
        file.file_stem()
            .map_or_else(String::new, |stem| stem.display().to_string())
    };
    let load = |file: &PathBuf| Ok((name(file), Firmware::load(file)?));
    files.iter().map(load).collect()
}

/// Runs jobs one after the other until the queue is empty.
fn work(hours: u64, waiting: &Mutex<VecDeque<Job>>, total: &Mutex<Ledger>, began: Instant) {
    let next = || waiting.lock().unwrap().pop_front();
    while let Some((seed, name, firmware)) = next() {
        println!("{hours} h unattended, seed {seed}, firmware {name}");
        let folder = tempfile::tempdir().unwrap();
        let ledger = weeks::soak(hours, seed, &firmware, folder.path(), &mut |hour, size| {
            println!(
                "seed {seed:>3} {hour:>4} h  {:>6} KiB  {:>3} threads  {:>3} descriptors  {:>5.0} s",
                size.resident_kib,
                size.threads,
                size.descriptors,
                began.elapsed().as_secs_f64()
            );
        });
        println!("seed {seed:>3}, {name}: {}", ledger.summary());
        let run = format!("seed {seed}, firmware {name}");
        total.lock().unwrap().add(&run, ledger);
    }
}
