//! `spykee lesson check`: runs the lesson's scenarios with the learner's script. Ignores any
//! config, so that all learners have the same settings.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde_json::Value;

use super::catalogue::Lesson;
use super::feedback::{Feedback, gradescope};
use super::{Console, Exit, Failure, parse_lesson, print};
use crate::check::Diagnostic;
use crate::cli::argument;
use crate::cli::check::{has_errors, of_source};
use crate::cli::test::job_pool::{Job, JobPool, scenario_process};
use crate::config::Config;
use crate::files;
use crate::scenario::{Cause, Failure as ScenarioFailure, RunSettings, Scenario};
use crate::script::MAX_SOURCE;

#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct CheckArgs {
    /// The learner's script
    #[arg(value_name = "FILE.lua")]
    file: PathBuf,

    /// Lesson to check against [default: the one that the script's first lines name]
    #[arg(long, value_name = "LESSON", value_parser = parse_lesson)]
    lesson: Option<&'static Lesson>,

    /// Also show this hint, 1 to 3
    #[arg(long, value_name = "NUMBER", value_parser = argument::whole::<u8>(1..=3))]
    hint: Option<u8>,

    /// Draw the robot's path in the first failed try into this file
    #[arg(long, value_name = "FILE.png", value_parser = argument::png)]
    picture: Option<PathBuf>,

    /// Print a JSON object
    #[arg(long, conflicts_with = "hint")]
    json: bool,

    /// Also write the result to this file, in Gradescope's format
    #[arg(long, value_name = "FILE.json")]
    gradescope: Option<PathBuf>,

    #[command(flatten)]
    tries: TryArgs,
}

#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct TryArgs {
    /// Time limit of each try, in seconds of real time; a longer try counts as failed
    #[arg(long, value_name = "SECONDS", default_value = "60", value_parser = argument::seconds(86_400.0))]
    timeout: Duration,

    /// Number of tries to run in parallel [default: one per processor]
    #[arg(long, value_name = "COUNT", value_parser = argument::whole::<u16>(1..=256))]
    jobs: Option<u16>,
}

pub(super) fn run(args: &CheckArgs, console: &Console) -> Result<Exit, Failure> {
    let source = read(&args.file)?;
    let lesson = match args.lesson {
        Some(lesson) => lesson,
        None => lesson_of(&source)?,
    };
    let marks = marks_of(lesson, &args.file, &source, &args.tries, console)?;
    let feedback = Feedback {
        lesson,
        is_chosen: args.lesson.is_some(),
        other_lesson: lesson.other_than_named(&String::from_utf8_lossy(&source)),
        file: &args.file,
        marks: &marks,
        hint: args.hint,
    };
    report(args, &feedback)?;
    Ok(if marks.is_full() {
        Exit::Done
    } else {
        Exit::Check
    })
}

/// The result of a check for a learner's page. A class has few processors for many learners, so one
/// try runs at a time.
pub(super) fn for_class(
    lesson: &'static Lesson,
    file: &Path,
    console: &Console,
) -> Result<Value, Failure> {
    let tries = TryArgs {
        timeout: Duration::from_secs(60),
        jobs: Some(1),
    };
    let source = read(file)?;
    let marks = marks_of(lesson, file, &source, &tries, console)?;
    let feedback = Feedback {
        lesson,
        is_chosen: true,
        other_lesson: None,
        file,
        marks: &marks,
        hint: None,
    };
    let mut checked = feedback.json();
    checked["sentence"] = feedback.sentence().into();
    Ok(checked)
}

pub(super) fn marks_of(
    lesson: &'static Lesson,
    file: &Path,
    source: &[u8],
    tries: &TryArgs,
    console: &Console,
) -> Result<Marks, Failure> {
    let scenario_process = scenario_process(tries.timeout)?;
    let scenario_file = scenario_process
        .of_text(lesson.folder, lesson.check)
        .map_err(Failure::internal)?;
    let settings = RunSettings {
        subject: Some(file.to_owned()),
        ..RunSettings::default()
    };
    let options = Config::default().script("check", file.display().to_string(), 0);
    let diagnostics = of_source(source, options)?;
    let cannot_run = has_errors(&diagnostics);
    let mut marks = Marks::new(scenario_file.scenarios(), diagnostics, cannot_run);
    if cannot_run {
        return Ok(marks);
    }
    let mut jobs = Vec::new();
    for scenario in scenario_file.scenarios() {
        jobs.extend(scenario.seeds().map(|seed| Job {
            file: &scenario_file,
            scenario,
            seed,
        }));
    }
    let pool = JobPool::new(tries.jobs, settings, scenario_process);
    let completed = pool.run(&jobs, console, |done| {
        marks.take(done.job.scenario, done.job.seed, done.result.failure);
    })?;
    if completed {
        Ok(marks)
    } else {
        Err(Failure::interrupted())
    }
}

pub(super) fn read(file: &Path) -> Result<Vec<u8>, Failure> {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    // Files with these names are loaded as scenarios, which have no `robot`.
    if name == "check.lua" || name.ends_with("_test.lua") {
        let why = format!("a lesson's script cannot be called {name}");
        return Err(Failure::usage(why).help("give it another name"));
    }
    files::read_beginning_unlinked(file, MAX_SOURCE as u64 + 1).map_err(|error| {
        let shown = file.display();
        let help = if file.is_symlink() {
            "name the file itself: a lesson's script must not be a link"
        } else if file.is_dir() {
            "name the script in this folder"
        } else {
            "check its name and folder; `spykee lesson start 1` creates a folder with a script to start from"
        };
        Failure::usage(format_args!("cannot read {shown}: {error}")).help(help)
    })
}

fn lesson_of(source: &[u8]) -> Result<&'static Lesson, Failure> {
    match Lesson::of_script(&String::from_utf8_lossy(source)) {
        Some(Ok(lesson)) => Ok(lesson),
        Some(Err(number)) => {
            let last = Lesson::all().len();
            Err(Failure::usage(format_args!(
                "the script names lesson {number} at its top, but the lessons are 1 to {last}"
            ))
            .help("correct that line, or add --lesson 3; `spykee lesson list` lists the lessons"))
        }
        None => Err(
            Failure::usage("the script does not say which lesson it belongs to").help(
                "put a line such as `-- spykee lesson 3` at its top, or add --lesson 3; \
                 `spykee lesson list` lists the lessons",
            ),
        ),
    }
}

fn report(args: &CheckArgs, feedback: &Feedback<'_>) -> Result<Exit, Failure> {
    if let Some(path) = &args.gradescope {
        let text = format!("{:#}\n", gradescope(feedback));
        std::fs::write(path, text).map_err(|error| Failure::unwritable(path, error))?;
    }
    let failed = feedback.marks.marks.iter().find_map(Mark::failure);
    let snapshot = failed.and_then(|failure| failure.snapshot.as_ref());
    if let (Some(path), Some(snapshot)) = (&args.picture, snapshot) {
        std::fs::write(path, &snapshot.picture)
            .map_err(|error| Failure::unwritable(path, error))?;
    }
    print(&if args.json {
        format!("{:#}\n", feedback.json())
    } else {
        feedback.text()
    })
}

/// The points of a script: a scenario gives its points only if it passes with every seed.
pub(super) struct Marks {
    /// One for each scenario of the lesson.
    pub(super) marks: Vec<Mark>,
    pub(super) diagnostics: Vec<Diagnostic>,
    /// Whether a diagnostic is an error; then no scenario was run.
    pub(super) cannot_run: bool,
}

pub(super) struct Mark {
    pub(super) name: String,
    pub(super) max_points: u32,
    /// The failure of each seed; `None` if it passed.
    tries: BTreeMap<u64, Option<ScenarioFailure>>,
    pub(super) seeds: usize,
}

impl Marks {
    fn new(scenarios: &[Scenario], diagnostics: Vec<Diagnostic>, cannot_run: bool) -> Marks {
        let mark = |scenario: &Scenario| Mark {
            name: scenario.name.clone(),
            max_points: scenario.options.points,
            tries: BTreeMap::new(),
            seeds: scenario.seeds().count(),
        };
        Marks {
            marks: scenarios.iter().map(mark).collect(),
            diagnostics,
            cannot_run,
        }
    }

    fn take(&mut self, scenario: &Scenario, seed: u64, failure: Option<ScenarioFailure>) {
        let mark = self
            .marks
            .iter_mut()
            .find(|mark| mark.name == scenario.name);
        if let Some(mark) = mark {
            mark.tries.insert(seed, failure);
        }
    }

    pub(super) fn points(&self) -> u32 {
        self.marks.iter().map(Mark::points).sum()
    }

    pub(super) fn max_points(&self) -> u32 {
        self.marks.iter().map(|mark| mark.max_points).sum()
    }

    pub(super) fn is_full(&self) -> bool {
        !self.cannot_run && self.marks.iter().all(Mark::passed)
    }

    /// The first error of the script itself, as opposed to unmet expectations.
    pub(super) fn script_error(&self) -> Option<&str> {
        self.marks.iter().find_map(Mark::script_error)
    }
}

impl Mark {
    pub(super) fn passed(&self) -> bool {
        self.passes() == self.seeds
    }

    pub(super) fn points(&self) -> u32 {
        if self.passed() { self.max_points } else { 0 }
    }

    pub(super) fn passes(&self) -> usize {
        self.tries.values().filter(|one| one.is_none()).count()
    }

    pub(super) fn failed_seeds(&self) -> Vec<u64> {
        let failed = self.tries.iter().filter(|(_, one)| one.is_some());
        failed.map(|(seed, _)| *seed).collect()
    }

    pub(super) fn failure(&self) -> Option<&ScenarioFailure> {
        self.tries.values().flatten().next()
    }

    fn script_error(&self) -> Option<&str> {
        self.tries
            .values()
            .flatten()
            .find_map(|failure| match &failure.cause {
                Cause::Behaviour(words) => Some(words.as_str()),
                Cause::Expectation | Cause::Scenario => None,
            })
    }
}
