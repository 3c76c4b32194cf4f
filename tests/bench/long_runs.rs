//! `scripts/soak`, `scripts/month`, `scripts/rescue`, `scripts/explore`, `scripts/stops` and
//! `scripts/score-behaviours --stuck`: long runs, each with a table of what was promised and what happened. They exit with 1 if a promise was broken.

#![allow(clippy::unwrap_used, clippy::expect_used, unreachable_pub)]

use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::thread::available_parallelism;
use std::time::{Duration, Instant};

use clap::{Args, Parser, ValueEnum, value_parser as number};
use spykee::safety::{Limits, Rescue};
use spykee::sim::{Firmware, World};

#[path = "../long_runs.rs"]
#[allow(dead_code)]
mod long_runs;
#[path = "../it/mqtt/broker.rs"]
#[allow(dead_code)]
mod mqtt;
#[path = "../it/rig.rs"]
#[allow(dead_code)]
mod rig;

use long_runs::rescue::{Case, Name, Robots, Row, Strategy, heading, play_all};
use long_runs::soak::Ledger;
use long_runs::stops::breaks::{self, End, Outage, Outcome};
use long_runs::stops::queue::{self, Driver};
use long_runs::stuck::Score;
use long_runs::{explore, flats, in_parallel, month, soak, stuck};

/// Long runs, in virtual time except for `stops breaks`.
#[derive(Parser)]
#[command(bin_name = "scripts")]
enum Arguments {
    Soak(SoakArgs),
    Month(MonthArgs),
    Rescue(RescueArgs),
    Explore(ExploreArgs),
    Stops(StopsArgs),
    Stuck(StuckArgs),
}

/// Runs patrol and guard unattended for hours of virtual time, with random failures of network,
/// station and battery. Exits with 1 if a promise was broken.
#[derive(Args)]
struct SoakArgs {
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
    #[arg(long, default_value_t = 1, value_parser = number!(u16).range(1..))]
    jobs: u16,
    /// The robot's firmware: a YAML file, or `matrix` for each of tests/firmware/ in turn
    #[arg(long, value_name = "FILE.yaml")]
    firmware: Option<PathBuf>,
}

/// Simulates days of a service in virtual time: a timetable, outages, a robot that is unreachable
/// for a night, a clock that is set back, power cuts. Then compares the history's record with the
/// simulator's. Exits with 1 if a promise was broken.
#[derive(Args)]
struct MonthArgs {
    /// Virtual days
    #[arg(long, default_value_t = 30, value_parser = number!(u64).range(1..))]
    days: u64,
    /// Seed of the faults
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Keep the data folder here, which must be empty, for `spykee history`
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
}

/// Measures how many robots with a low battery the watchdog alone brings home, beside a behaviour
/// that does nothing. Exits with 1 if the default strategy misses its goal.
#[derive(Args)]
struct RescueArgs {
    /// Robots for each world and strategy
    #[arg(long, default_value_t = 120, value_parser = number!(u32).range(1..))]
    starts: u32,
    /// Seed of places, headings, battery levels and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only this world
    #[arg(long)]
    world: Option<Name>,
    #[command(flatten)]
    robots: Robots,
    /// Only this strategy
    #[arg(long)]
    strategy: Option<Strategy>,
    /// Robots at the same time [default: one for each processor]
    #[arg(long, value_parser = number!(u16).range(1..))]
    jobs: Option<u16>,
    /// Print every start and how it ended
    #[arg(long)]
    list: bool,
}

/// Explores the states of the watchdog breadth first. Exits with 1 if a promise can be broken.
#[derive(Args)]
struct ExploreArgs {
    /// Steps after the first login
    #[arg(long, default_value_t = 7)]
    depth: usize,
    /// End after this many states
    #[arg(long, default_value_t = 3_000_000)]
    states: usize,
}

/// Measures whether and when a STOP is executed: on robots that execute commands slowly, and when the
/// link breaks around the end of a run. Exits with 1 if one is late.
#[derive(Args)]
struct StopsArgs {
    /// Only this part
    part: Option<StopsPart>,
    /// Seeds of each kind
    #[arg(long, default_value_t = 20, value_parser = number!(u64).range(1..))]
    seeds: u64,
    /// Runs at the same time [default: one for each processor; with broken links 16]
    #[arg(long, value_parser = number!(u16).range(1..))]
    jobs: Option<u16>,
    /// Only slow robots that this behaviour drives
    #[arg(long)]
    driver: Vec<Driver>,
    /// Only runs that end like this
    #[arg(long)]
    end: Vec<End>,
    /// Only links that break like this
    #[arg(long)]
    outage: Vec<Outage>,
    /// Seconds for which the robot is out of reach
    #[arg(long, default_values_t = [1, 5, 12, 30])]
    out: Vec<u64>,
    /// Print what the program and its guardian wrote where the robot was not stopped
    #[arg(long)]
    list: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum StopsPart {
    /// Robots that execute so many commands a second: the age of a STOP
    Queue,
    /// What a patrol loses on them
    Patrol,
    /// Links that break around the end of a run
    Breaks,
}

/// Measures how often a script is told that its robot is blocked by something, the rate of false
/// alarms, and how far off its pose is after a minute. Exits with 1 if the goals are missed.
#[derive(Args)]
struct StuckArgs {
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

/// Number of robots between two progress messages.
const PROGRESS_EVERY: usize = 10;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().filter(|one| one != "--bench").collect();
    if arguments.iter().any(|argument| argument == "--test") {
        return ExitCode::SUCCESS;
    }
    let is_kept = match Arguments::parse_from(arguments) {
        Arguments::Soak(args) => run_soak(&args),
        Arguments::Month(args) => Ok(run_month(&args)),
        Arguments::Rescue(args) => Ok(run_rescue(&args)),
        Arguments::Explore(args) => Ok(run_explore(&args)),
        Arguments::Stops(args) => Ok(run_stops(&args)),
        Arguments::Stuck(args) => Ok(run_stuck(&args)),
    };
    match is_kept {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Prints the table of promises; returns whether all were kept.
fn judge(mut ledger: Ledger, core: &[&'static str], began: Instant) -> bool {
    let is_kept = ledger.proves(core);
    let seconds = began.elapsed().as_secs_f64();
    println!("{ledger}{}; {seconds:.0} s", ledger.summary());
    is_kept
}

fn run_soak(args: &SoakArgs) -> Result<bool, Box<dyn Error>> {
    let began = Instant::now();
    let seeds = args.seed..args.seed + args.seeds;
    let mut jobs = Vec::new();
    for (name, firmware) in firmwares(args.firmware.as_deref())? {
        jobs.extend(
            seeds
                .clone()
                .map(|seed| (seed, name.clone(), firmware.clone())),
        );
    }
    let lasts = Duration::from_secs(args.hours * 3600);
    let ledgers = in_parallel(&jobs, args.jobs.into(), |(seed, name, firmware)| {
        println!("{} h unattended, seed {seed}, firmware {name}", args.hours);
        let folder = tempfile::tempdir().unwrap();
        let progress = &mut |hour, size: &soak::Size| {
            let seconds = began.elapsed().as_secs_f64();
            println!("seed {seed:>3} {hour:>4} h  {size}  {seconds:>5.0} s");
        };
        let ledger = soak::soak(lasts, *seed, firmware, folder.path(), progress);
        println!("seed {seed:>3}, {name}: {}", ledger.summary());
        ledger
    });
    let mut total = Ledger::default();
    for ((seed, name, _), ledger) in jobs.iter().zip(ledgers) {
        total.add(&format!("seed {seed}, firmware {name}"), ledger);
    }
    Ok(judge(total, &soak::CORE, began))
}

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
        files.retain(|file| file.extension().is_some_and(|exit| exit == "yaml"));
        files.sort_unstable();
    }
    let mut firmwares = Vec::new();
    for file in files {
        let name = file.file_stem().unwrap_or_default().display().to_string();
        firmwares.push((name, Firmware::load(&file)?));
    }
    Ok(firmwares)
}

fn run_month(args: &MonthArgs) -> bool {
    let began = Instant::now();
    let folder = tempfile::tempdir().unwrap();
    let data = args.data.as_deref().unwrap_or(folder.path());
    println!("{} days of service, seed {}", args.days, args.seed);
    let ledger = month::serve(args.days, args.seed, data, &mut |day, size, bytes| {
        let seconds = began.elapsed().as_secs_f64();
        let kib = bytes / 1024;
        println!("{day:>4} d  {size}  {kib:>6} KiB of data  {seconds:>5.0} s");
    });
    judge(ledger, &month::CORE, began)
}

fn run_rescue(args: &RescueArgs) -> bool {
    let worlds = args.world.map_or(Name::ALL.to_vec(), |name| vec![name]);
    let all: &[Strategy] = if args.robots.driven {
        &Strategy::DRIVEN
    } else {
        &Strategy::PUT
    };
    let strategies = args.strategy.map_or(all.to_vec(), |one| vec![one]);
    let mut rows = Vec::new();
    for world in worlds {
        let starts = args.starts as usize;
        let cases = Case::draw(world, &args.robots, starts, args.seed);
        let row = |strategy: &Strategy| row(args, world, &cases, *strategy);
        rows.extend(strategies.iter().map(row));
    }
    println!("\n{}", heading());
    rows.iter().for_each(|row| println!("{row}"));
    let missed: Vec<&Row> = rows.iter().filter(|row| row.misses_its_goal()).collect();
    for row in &missed {
        let world = row.world.text();
        let goal = row.world.goal();
        let percent = row.percent();
        println!("{world}: {percent:.1} % came home; the goal is {goal} %");
    }
    missed.is_empty()
}

fn row(args: &RescueArgs, world: Name, cases: &[Case], strategy: Strategy) -> Row {
    let cores = || available_parallelism().map_or(1, usize::from);
    let threads = args.jobs.map_or_else(cores, usize::from);
    let what = format!("{}, {}", world.text(), strategy.text());
    let began = Instant::now();
    let report_progress = |done: usize| {
        if done.is_multiple_of(PROGRESS_EVERY) || done == cases.len() {
            let seconds = began.elapsed().as_secs_f64();
            eprintln!("{what}: {done} of {} done, {seconds:.0} s", cases.len());
        }
    };
    let played = play_all(cases, strategy, threads, &report_progress);
    if args.list {
        println!("{what}");
        played.iter().for_each(|one| println!("  {one}"));
    }
    Row::new(world, strategy, &played)
}

fn run_explore(args: &ExploreArgs) -> bool {
    let bare = Limits {
        rescue: Rescue::Off,
        blind_moves: false,
        ..Limits::default()
    };
    let mut is_kept = true;
    for (name, limits) in [
        ("usual limits", Limits::default()),
        ("no blind moves, no rescue", bare),
    ] {
        let found = explore::explore(&limits, args.depth, args.states);
        println!(
            "{name}: {} states, all sequences of {} steps, {} broken",
            found.states,
            found.depth,
            found.broken.len()
        );
        found.broken.iter().for_each(|what| println!("  {what}"));
        is_kept &= found.broken.is_empty();
    }
    is_kept
}

fn run_stops(args: &StopsArgs) -> bool {
    let cores = available_parallelism().map_or(1, usize::from);
    let threads = args.jobs.map_or(cores, usize::from);
    let asked = |part| args.part.is_none_or(|only| only == part);
    let mut is_kept = true;
    if asked(StopsPart::Queue) {
        let drivers = match &args.driver[..] {
            [] => &Driver::ALL,
            asked => asked,
        };
        let cells = queue::play_all(&queue::SPEEDS, drivers, queue::DRIVES, args.seeds, threads);
        println!("{}", queue::heading());
        for (trial, cell) in &cells {
            println!("{}", queue::row(trial, cell));
            is_kept &= cell.is_kept(trial.speed);
        }
    }
    if asked(StopsPart::Patrol) {
        let seeds = args.seeds.min(10);
        let lines = queue::patrols(&queue::SPEEDS, seeds, threads);
        lines.iter().for_each(|line| println!("{line}"));
    }
    if asked(StopsPart::Breaks) {
        is_kept &= run_breaks(args);
    }
    is_kept
}

/// Ends runs while their links are broken; returns whether every robot was stopped in time.
fn run_breaks(args: &StopsArgs) -> bool {
    let ends = match &args.end[..] {
        [] => End::value_variants(),
        asked => asked,
    };
    let outages = match &args.outage[..] {
        [] => Outage::value_variants(),
        asked => asked,
    };
    let began = Instant::now();
    let cases = breaks::cases(ends, outages, &args.out, args.seeds);
    let threads = args.jobs.map_or(16, usize::from);
    let outcomes = breaks::play_all(&cases, threads, &|case, outcome| match outcome {
        Outcome::After(_) => {}
        Outcome::Late(after, text) if args.list => {
            println!("{case:?}: stopped after {after:.1?}\n{text}");
        }
        Outcome::Late(after, _) => println!("{case:?}: stopped after {after:.1?}"),
        Outcome::Failed(why) => println!("{case:?}: {why}"),
        Outcome::Never(text) if args.list => println!("{case:?}: never stopped\n{text}"),
        Outcome::Never(_) => println!("{case:?}: never stopped"),
        Outcome::NotHeld(text) => {
            println!("{case:?}: STOP does not hold in the next program: {text}")
        }
    });
    let table = breaks::Table::new(&cases, &outcomes);
    let (played, in_time) = table.count();
    let seconds = began.elapsed().as_secs_f64();
    println!(
        "\nin time / all, and the longest time from being in reach again to the stop\n{table}"
    );
    println!(
        "{in_time} of {played} stopped within {:?}; {seconds:.0} s",
        breaks::GOAL
    );
    table.is_kept()
}

/// Returns whether the goals are reached in flats that are generated, or, without them, in the
/// built-in worlds.
fn run_stuck(args: &StuckArgs) -> bool {
    println!("{}", Score::heading("world"));
    let has_flats = args.flats > 0 && args.world.is_none();
    let flats = 0..if has_flats { args.flats } else { 0 };
    let flats = flats.map(|number| (flats::flat(args.first_flat + number).world, number + 1));
    let unseen = score(args, "generated flats", flats.collect());
    let mut builtin = Score::default();
    for name in World::builtin_names() {
        if args.only_flats || args.world.as_deref().is_some_and(|only| only != name) {
            continue;
        }
        let seeds = args.first..args.first + args.seeds;
        let robots = seeds.map(|seed| (World::builtin(name).unwrap(), seed));
        builtin.add(score(args, name, robots.collect()));
    }
    println!("{}", builtin.line("all built-in worlds"));
    for (name, score) in [("generated flats", &unseen), ("built-in worlds", &builtin)] {
        println!("\nIn {name}: {}", score.rates());
        score.print_kinds();
    }
    let judged = if has_flats { unseen } else { builtin };
    judged.reaches_the_goals()
}

fn score(args: &StuckArgs, name: &str, robots: Vec<(World, u64)>) -> Score {
    let score = stuck::play_all(&robots, Duration::from_secs(60 * args.minutes));
    println!("{}", score.line(name));
    if args.list {
        score.notes.iter().for_each(|note| eprintln!("  {note}"));
    }
    score
}
