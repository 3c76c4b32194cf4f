//! `spykee test`: runs the scenarios of `*_test.lua` files in parallel.

pub(super) mod job_pool;
mod report;

use std::fmt::Write as _;
use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::check::scripts;
use super::settings::CommandSettings;
use super::sim::FirmwareArgs;
use super::{Console, Exit, Failure, argument, print};
use crate::sanitize;
use crate::scenario::{RunSettings, Scenario, ScenarioFile, ScenarioFileError, ScenarioProcess};
use job_pool::{Job, JobPool, JobResult};
use report::Report;

/// Run scenarios: *_test.lua files that state what behaviours must achieve
#[derive(Debug, Clone, clap::Args)]
pub(super) struct TestArgs {
    /// Scenario files, or folders to search for *_test.lua
    #[arg(value_name = "PATH", default_value = ".")]
    paths: Vec<PathBuf>,

    /// Run only scenarios that contain this text in their name or in FILE: NAME
    #[arg(long, value_name = "TEXT")]
    filter: Option<String>,

    /// Run each scenario with the seeds 1 to COUNT [default: as many as the scenario sets]
    #[arg(long, value_name = "COUNT", value_parser = argument::whole::<u64>(1..=10_000))]
    seeds: Option<u64>,

    /// Run each scenario with this seed only, for example one that failed
    #[arg(long, value_name = "NUMBER", conflicts_with = "seeds")]
    seed: Option<u64>,

    /// Number of scenarios to run in parallel [default: one per processor]
    #[arg(long, value_name = "COUNT", value_parser = argument::whole::<u16>(1..=256))]
    jobs: Option<u16>,

    /// Time limit of each run, in seconds of real time; a longer run counts as failed
    #[arg(long, value_name = "SECONDS", default_value = "300", value_parser = argument::seconds(86_400.0))]
    timeout: Duration,

    /// List the scenarios without running them
    #[arg(long)]
    list: bool,

    /// Print a JSON object
    #[arg(long)]
    json: bool,

    /// Also write the results to this file, as JUnit XML
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,

    /// Folder for pictures of the robot's path in failed runs [default: scenarios/ in the data
    /// folder]
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,

    #[command(flatten)]
    firmware: FirmwareArgs,
}

struct TestFile {
    file: PathBuf,
    scenario_file: Result<ScenarioFile, ScenarioFileError>,
}

impl TestFile {
    fn has(&self, job: &Job<'_>) -> bool {
        let file = self.scenario_file.as_ref();
        file.is_ok_and(|file| std::ptr::eq(file, job.file))
    }
}

pub(super) fn run(
    args: &TestArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let config = settings.config()?.clone();
    let scenario_process = job_pool::scenario_process(args.timeout)?;
    let test_files = test_files(&args.paths, &scenario_process)?;
    let jobs = jobs(args, &test_files);
    if args.list {
        return list(&test_files, &jobs);
    }
    if jobs.is_empty() && test_files.iter().all(|file| file.scenario_file.is_ok()) {
        let failure = Failure::usage("no scenario matches --filter");
        return Err(failure.help("`spykee test --list` lists all scenarios"));
    }
    let own = || config.data_folder().join("scenarios");
    let pictures = args.pictures.clone().unwrap_or_else(own);
    let settings = RunSettings {
        config,
        firmware: args.firmware.load()?,
        ..RunSettings::default()
    };
    let pool = JobPool::new(args.jobs, settings, scenario_process);
    // Whether the status line shares the terminal with stdout.
    let shared = console.has_status_line() && std::io::stdout().is_terminal();
    let live = !args.json && !shared;
    let mut report = Report::new(&test_files, &jobs, pictures);
    let mut trouble = Ok(Exit::Done);
    let completed = pool.run(&jobs, console, |done: JobResult| {
        report.take(done);
        if live && trouble.is_ok() {
            trouble = print(&report.completed_files());
        }
    })?;
    trouble?;
    write_report(args, &mut report)?;
    Ok(match (completed, report.has_failed()) {
        (false, _) => Exit::Interrupted,
        (true, true) => Exit::Check,
        (true, false) => Exit::Done,
    })
}

fn write_report(args: &TestArgs, report: &mut Report<'_>) -> Result<Exit, Failure> {
    if let Some(path) = &args.junit {
        let written = std::fs::write(path, report::junit(report)?);
        written.map_err(|error| Failure::unwritable(path, error))?;
    }
    if args.json {
        print(&format!("{:#}\n", report.json()))
    } else {
        print(&format!("{}{}", report.completed_files(), report.summary()))
    }
}

fn test_files(
    paths: &[PathBuf],
    scenario_process: &ScenarioProcess,
) -> Result<Vec<TestFile>, Failure> {
    let mut files = Vec::new();
    for path in paths {
        files.extend(scripts(path, "_test.lua")?);
    }
    files.dedup();
    if files.is_empty() {
        let places: Vec<_> = paths
            .iter()
            .map(|path| path.display().to_string())
            .collect();
        let failure = Failure::usage(format_args!("no *_test.lua file in {}", places.join(", ")));
        return Err(failure.help("`spykee new NAME` creates a behaviour with scenarios"));
    }
    let read = |file: PathBuf| {
        let scenario_file = scenario_process.read(&file);
        match scenario_file {
            Err(error @ ScenarioFileError::Read { .. }) => Err(Failure::usage(error)),
            scenario_file => Ok(TestFile {
                file,
                scenario_file,
            }),
        }
    };
    files.into_iter().map(read).collect()
}

fn jobs<'a>(args: &TestArgs, test_files: &'a [TestFile]) -> Vec<Job<'a>> {
    let wanted = |file: &Path, scenario: &Scenario| {
        let text = args.filter.as_deref().unwrap_or_default();
        format!("{}: {}", file.display(), scenario.name).contains(text)
    };
    let mut jobs = Vec::new();
    for file in test_files.iter().flat_map(|one| &one.scenario_file) {
        let scenarios = file.scenarios().iter();
        for scenario in scenarios.filter(|one| wanted(file.file(), one)) {
            let seeds = match (args.seed, args.seeds) {
                (Some(seed), _) => seed..=seed,
                (None, Some(count)) => 1..=count,
                (None, None) => scenario.seeds(),
            };
            jobs.extend(seeds.map(|seed| Job {
                file,
                scenario,
                seed,
            }));
        }
    }
    jobs
}

fn list(test_files: &[TestFile], jobs: &[Job<'_>]) -> Result<Exit, Failure> {
    let mut text = String::new();
    for file in test_files {
        if let Err(error) = &file.scenario_file {
            return Err(Failure::new(Exit::Check, error));
        }
        let own = jobs.iter().filter(|job| file.has(job));
        let mut names: Vec<&str> = own.map(|job| job.scenario.name.as_str()).collect();
        names.dedup();
        for name in names {
            // Writing into a string does not fail.
            let file = file.file.display().to_string();
            let _ = writeln!(text, "{}: {}", sanitize::line(&file), sanitize::line(name));
        }
    }
    print(&text)
}
