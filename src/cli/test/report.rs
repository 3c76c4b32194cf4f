//! Reports the results as text, as JSON, as JUnit XML and as pictures.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use quick_xml::Writer;
use quick_xml::events::{BytesDecl, BytesText, Event};
use serde_json::{Value, json};

use super::TestFile;
use super::job_pool::{Job, JobResult};
use crate::cli::{self, plural};
use crate::clock::hours;
use crate::files::Folder;
use crate::sanitize;
use crate::scenario::{Failure, ScenarioFileError, Snapshot};

pub(super) struct Report<'a> {
    files: &'a [TestFile],
    runs: Vec<Run<'a>>,
    /// How many files are in the text so far.
    printed: usize,
    pictures: PathBuf,
}

struct Run<'a> {
    job: Job<'a>,
    outcome: Option<JobResult<'a>>,
    /// The picture of the robot's path in a failed run, or why there is none.
    picture: Option<Result<PathBuf, String>>,
}

impl<'a> Report<'a> {
    pub(super) fn new(files: &'a [TestFile], jobs: &[Job<'a>], pictures: PathBuf) -> Report<'a> {
        let run = |job: &Job<'a>| Run {
            job: *job,
            outcome: None,
            picture: None,
        };
        Report {
            files,
            runs: jobs.iter().map(run).collect(),
            printed: 0,
            pictures,
        }
    }

    /// Stores a result, and saves its picture if it failed.
    pub(super) fn take(&mut self, done: JobResult<'a>) {
        let is_meant = |run: &&mut Run<'_>| {
            std::ptr::eq(run.job.scenario, done.job.scenario) && run.job.seed == done.job.seed
        };
        let Some(run) = self.runs.iter_mut().find(is_meant) else {
            return;
        };
        let failure = done.result.failure.as_ref();
        let snapshot = failure.and_then(|failure| failure.snapshot.as_ref());
        let name = run.picture_name();
        run.picture = snapshot.map(|snapshot| save(snapshot, &self.pictures, &name));
        run.outcome = Some(done);
    }

    /// The text for the next files, in order, as far as they are complete; each file only once.
    pub(super) fn completed_files(&mut self) -> String {
        let mut text = String::new();
        while let Some(file) = self.files.get(self.printed)
            && self.runs_of(file).all(|run| run.outcome.is_some())
        {
            self.write(file, &mut text);
            self.printed += 1;
        }
        text
    }

    pub(super) fn summary(&self) -> String {
        let failed = self.failures();
        let done = self.outcomes().count();
        let simulated: Duration = self
            .outcomes()
            .map(|outcome| outcome.result.simulated)
            .sum();
        let mut text = format!("{} passed", plural(done - failed, "run"));
        if failed > 0 {
            let _ = write!(text, ", {failed} failed");
        }
        if done < self.runs.len() {
            let _ = write!(text, ", {} not run", self.runs.len() - done);
        }
        let broken = self.broken().count();
        if broken > 0 {
            let _ = write!(text, ", {} cannot be run", plural(broken, "file"));
        }
        text + &format!("; {} simulated\n", hours(simulated))
    }

    /// Whether a run has failed or a file cannot be run.
    pub(super) fn has_failed(&self) -> bool {
        self.failures() > 0 || self.broken().next().is_some()
    }

    pub(super) fn json(&self) -> Value {
        let failed = self.failures();
        let runs: Vec<Value> = self.runs.iter().filter_map(Run::json).collect();
        let broken: Vec<Value> = self
            .broken()
            .map(|(file, why)| json!({"file": shown(file), "message": why.to_string()}))
            .collect();
        json!({"passed": runs.len() - failed, "failed": failed, "broken": broken, "runs": runs})
    }

    fn runs_of(&self, file: &TestFile) -> impl Iterator<Item = &Run<'a>> {
        self.runs.iter().filter(|run| file.has(&run.job))
    }

    fn broken(&self) -> impl Iterator<Item = (&TestFile, &ScenarioFileError)> {
        let files = self.files.iter();
        files.filter_map(|file| Some((file, file.scenario_file.as_ref().err()?)))
    }

    fn outcomes(&self) -> impl Iterator<Item = &JobResult<'a>> {
        self.runs.iter().filter_map(|run| run.outcome.as_ref())
    }

    fn failures(&self) -> usize {
        let failed = self.runs.iter().filter(|run| run.failure().is_some());
        failed.count()
    }

    fn write(&self, file: &TestFile, text: &mut String) {
        // Writing into a string does not fail.
        let _ = writeln!(text, "{}", sanitize::line(&shown(file)));
        if let Err(broken) = &file.scenario_file {
            let _ = writeln!(text, "  FAIL  {}\n", indented(&broken.to_string(), 8));
            return;
        }
        let mut printed = BTreeSet::new();
        for run in self.runs_of(file) {
            if printed.insert(&run.job.scenario.name) {
                self.write_scenario(file, &run.job.scenario.name, text);
            }
        }
        text.push('\n');
    }

    fn write_scenario(&self, file: &TestFile, name: &str, text: &mut String) {
        let of_it = |run: &&Run<'_>| run.job.scenario.name == name;
        let runs: Vec<&Run<'_>> = self.runs_of(file).filter(of_it).collect();
        let outcomes = || runs.iter().filter_map(|run| run.outcome.as_ref());
        let simulated: Duration = outcomes().map(|outcome| outcome.result.simulated).sum();
        let passed = outcomes()
            .filter(|one| one.result.failure.is_none())
            .count();
        let word = if passed == runs.len() { "ok  " } else { "FAIL" };
        let seeds = match runs.len() {
            1 => format!("seed {}", runs[0].job.seed),
            count if passed == count => format!("{count} seeds"),
            count => format!("{passed} of {count} seeds"),
        };
        let name = sanitize::line(name);
        let _ = writeln!(text, "  {word}  {name} ({seeds}, {})", hours(simulated));
        let mut failed = runs.iter().filter(|run| run.failure().is_some());
        if let Some(first) = failed.next() {
            text.push_str(&first.describe());
            let others: Vec<String> = failed.map(|run| run.job.seed.to_string()).collect();
            if !others.is_empty() {
                let _ = writeln!(
                    text,
                    "        the scenario also fails with seed {}",
                    others.join(", ")
                );
            }
        }
    }
}

impl Run<'_> {
    fn failure(&self) -> Option<&Failure> {
        self.outcome.as_ref()?.result.failure.as_ref()
    }

    /// What is wrong with it; empty if nothing is.
    fn describe(&self) -> String {
        let mut text = String::new();
        let (Some(outcome), Some(failure)) = (&self.outcome, self.failure()) else {
            return text;
        };
        let location = failure.location.as_ref();
        let location = location.map_or_else(String::new, |location| format!("{location}: "));
        let message = indented(&failure.message, 8);
        let _ = writeln!(text, "        {location}{message}");
        if let (Some(location), Some(line)) = (&failure.location, &failure.line) {
            let number = location.line.to_string();
            let _ = writeln!(text, "        {number} | {}", line.trim_end());
            if let Some(help) = &failure.help {
                let _ = writeln!(text, "        {:1$} = help: {help}", "", number.len());
            }
        }
        let _ = match &failure.snapshot {
            Some(Snapshot {
                at, pose, battery, ..
            }) => writeln!(
                text,
                "        with seed {} after {:.1} s: robot at {:.2} {:.2} m, {:.0}°, battery {:.0} %",
                self.job.seed,
                at.as_secs_f64(),
                pose.x,
                pose.y,
                pose.heading.to_degrees(),
                battery,
            ),
            None => writeln!(text, "        with seed {}", self.job.seed),
        };
        write_list(&mut text, "        last events:", &failure.recent, |line| {
            format!("        {line}")
        });
        write_list(
            &mut text,
            "        output of the scenario:",
            &outcome.result.lines,
            |line| format!("          {}", indented(line, 10)),
        );
        let _ = match &self.picture {
            Some(Ok(path)) => {
                let path = path.display();
                writeln!(text, "        the robot's path is drawn in {path}")
            }
            Some(Err(why)) => writeln!(text, "        {why}"),
            None => Ok(()),
        };
        text
    }

    fn picture_name(&self) -> String {
        // The folders, too: two of them can have files of one name.
        let file = self.job.file.file().with_extension("");
        let file = file.to_string_lossy();
        let start = file.char_indices().rev().nth(99).map_or(0, |(at, _)| at);
        let slug = |text: &str| -> String {
            let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '-' };
            text.chars().take(100).map(plain).collect()
        };
        format!(
            "{}-{}-{}.png",
            slug(&file[start..]),
            slug(&self.job.scenario.name),
            self.job.seed
        )
    }

    fn json(&self) -> Option<Value> {
        let outcome = self.outcome.as_ref()?;
        let result = &outcome.result;
        let scenario = self.job.scenario;
        let failure = result.failure.as_ref().map(|failure| {
            let picture = self.picture.as_ref().and_then(|kept| kept.as_ref().ok());
            let snapshot = failure.snapshot.as_ref();
            json!({
                "message": failure.message,
                "file": failure.location.as_ref().map(|location| &location.file),
                "line": failure.location.as_ref().map(|location| location.line),
                "source": failure.line, "help": failure.help,
                "at": snapshot.map(|snapshot| snapshot.at.as_secs_f64()),
                "pose": snapshot.map(|snapshot| snapshot.pose),
                "battery": snapshot.map(|snapshot| snapshot.battery),
                "recent": failure.recent,
                "picture": picture.map(|path| path.display().to_string()),
            })
        });
        Some(json!({
            "file": self.job.file.file().display().to_string(), "scenario": scenario.name, "line": scenario.line, "seed": self.job.seed,
            "points": scenario.options.points, "passed": failure.is_none(),
            "simulated": result.simulated.as_secs_f64(), "seconds": outcome.took.as_secs_f64(),
            "lines": result.lines, "failure": failure,
        }))
    }
}

fn shown(file: &TestFile) -> String {
    file.file.display().to_string()
}

/// Saves a picture, readable only by the user, like all data of the program.
fn save(snapshot: &Snapshot, folder: &Path, name: &str) -> Result<PathBuf, String> {
    let path = folder.join(name);
    let saved = Folder::make(folder).and_then(|folder| folder.replace(name, &snapshot.picture));
    match saved {
        Ok(()) => Ok(path),
        Err(error) => Err(format!(
            "the robot's path could not be drawn in {}: {error}",
            path.display()
        )),
    }
}

fn write_list(text: &mut String, heading: &str, lines: &[String], show: fn(&String) -> String) {
    if !lines.is_empty() {
        let _ = writeln!(text, "{heading}");
    }
    for line in lines {
        let _ = writeln!(text, "{}", show(line));
    }
}

fn indented(text: &str, by: usize) -> String {
    text.replace('\n', &format!("\n{}", " ".repeat(by)))
}

pub(super) fn junit(report: &Report<'_>) -> Result<Vec<u8>, cli::Failure> {
    write_junit(report).map_err(|error| cli::Failure::io("create the JUnit report", error))
}

fn write_junit(report: &Report<'_>) -> io::Result<Vec<u8>> {
    let mut xml = Writer::new_with_indent(Vec::new(), b' ', 2);
    xml.write_event(Event::Decl(BytesDecl::new("1.0", Some("UTF-8"), None)))?;
    xml.create_element("testsuites")
        .with_attribute(("name", "spykee test"))
        .write_inner_content(|xml| {
            report
                .files
                .iter()
                .try_for_each(|file| write_file(xml, report, file))
        })?;
    let mut bytes = xml.into_inner();
    bytes.push(b'\n');
    Ok(bytes)
}

fn write_file(
    xml: &mut Writer<Vec<u8>>,
    report: &Report<'_>,
    test_file: &TestFile,
) -> io::Result<()> {
    let file = shown(test_file);
    let file = file.as_str();
    let errors = usize::from(test_file.scenario_file.is_err());
    let runs = || {
        let runs = report.runs_of(test_file);
        runs.filter_map(|run| Some((run, run.outcome.as_ref()?.took.as_secs_f64())))
    };
    let failures = runs().filter(|(run, _)| run.failure().is_some()).count();
    let seconds: f64 = runs().map(|(_, took)| took).sum();
    xml.create_element("testsuite")
        .with_attribute(("name", sanitize::xml(file).as_str()))
        .with_attribute(("tests", (runs().count() + errors).to_string().as_str()))
        .with_attribute(("failures", failures.to_string().as_str()))
        .with_attribute(("errors", errors.to_string().as_str()))
        .with_attribute(("time", format!("{seconds:.3}").as_str()))
        .write_inner_content(|xml| {
            if let Err(broken) = &test_file.scenario_file {
                let broken = &broken.to_string();
                write_case(xml, file, "the file", 0.0, Some(("error", broken, broken)))?;
            }
            for (run, took) in runs() {
                let words = run.describe();
                let failure = run.failure();
                let failure = failure.map(|one| ("failure", one.message.as_str(), words.as_str()));
                let name = format!("{} (seed {})", run.job.scenario.name, run.job.seed);
                write_case(xml, file, &name, took, failure)?;
            }
            Ok(())
        })?;
    Ok(())
}

/// Writes a test case; `wrong` is the element of a failure, its message and its full text.
fn write_case(
    xml: &mut Writer<Vec<u8>>,
    file: &str,
    name: &str,
    seconds: f64,
    wrong: Option<(&str, &str, &str)>,
) -> io::Result<()> {
    let time = format!("{seconds:.3}");
    let case = xml
        .create_element("testcase")
        .with_attribute(("classname", sanitize::xml(file).as_str()))
        .with_attribute(("name", sanitize::xml(name).as_str()))
        .with_attribute(("time", time.as_str()));
    match wrong {
        None => case.write_empty()?,
        Some((element, message, story)) => case.write_inner_content(|xml| {
            xml.create_element(element)
                .with_attribute(("message", sanitize::xml(message).as_str()))
                .write_text_content(BytesText::new(&sanitize::xml(story)))?;
            Ok(())
        })?,
    };
    Ok(())
}
