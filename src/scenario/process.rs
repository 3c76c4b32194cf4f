//! Reads each file and runs each scenario in a process of its own, which can read only the folders
//! of the scenario and of its behaviour (and the current one, if it contains the scenario and is
//! not as general as the home folder). If a script hangs in one call or crashes the process, the
//! scenario has failed.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio_util::sync::CancellationToken;

use super::scenario_file::{Scenario, ScenarioFile, ScenarioFileError};
use super::scenario_run::{Cause, Failure, RunSettings, ScenarioResult};
use crate::behaviour::STACK;
use crate::config::Config;
use crate::sandbox::{self, SandboxPolicy, Worker, WorkerError};
use crate::script;

/// The kind of worker process that reads and runs scenarios.
pub const SCENARIO_PROCESS: &str = "scenario";
/// Time limit for reading the declarations of a file.
const READING: Duration = Duration::from_secs(20);
/// A script that cannot be interrupted for this long ends its process.
const STUCK: Duration = Duration::from_secs(5);

#[derive(Debug, Clone)]
pub struct ScenarioProcess {
    worker: Worker,
    timeout: Duration,
}

#[derive(Serialize, Deserialize)]
struct ProcessRequest {
    file: PathBuf,
    folder: Option<PathBuf>,
    source: Vec<u8>,
    /// The scenario to run; `None` asks for the declarations.
    run: Option<RunParameters>,
}

#[derive(Serialize, Deserialize)]
struct RunParameters {
    scenario: Scenario,
    seed: u64,
    subject: Option<PathBuf>,
    /// The config as JSON, which can represent all of it.
    config: String,
    /// The firmware settings, also as JSON.
    firmware: String,
    data: PathBuf,
    stuck: Duration,
}

impl ScenarioProcess {
    /// Uses processes of the running executable, which must be `spykee`. `timeout` limits each
    /// run, in real time.
    pub fn new(timeout: Duration) -> io::Result<ScenarioProcess> {
        let worker = Worker::of_this_executable(SCENARIO_PROCESS)?;
        Ok(ScenarioProcess { worker, timeout })
    }

    pub fn read(&self, file: &Path) -> Result<ScenarioFile, ScenarioFileError> {
        self.declared(ScenarioFile::read_undeclared(file)?)
    }

    /// Like [`ScenarioFile::of_text`], in a confined process.
    /// Fails with [`ScenarioFileError::Invalid`].
    pub fn of_text(&self, name: &str, text: &str) -> Result<ScenarioFile, ScenarioFileError> {
        self.declared(ScenarioFile::undeclared(Path::new(name), None, text.into()))
    }

    fn declared(&self, scenario_file: ScenarioFile) -> Result<ScenarioFile, ScenarioFileError> {
        let policy = sandbox_policy(&scenario_file, None, READING);
        let invalid = |why: &dyn std::fmt::Display| {
            ScenarioFileError::Invalid(format!("{}: {why}", scenario_file.file().display()))
        };
        let request = pack(&request(&scenario_file, None)).map_err(|error| invalid(&error))?;
        let answer = self.worker.ask(&policy, &request, READING, &|| true);
        let answer = answer.map_err(|error| invalid(&error))?;
        let declared: Result<Vec<Scenario>, String> =
            postcard::from_bytes(&answer).map_err(|error| invalid(&error))?;
        Ok(scenario_file.with_scenarios(declared.map_err(ScenarioFileError::Invalid)?))
    }

    /// Like [`ScenarioFile::run`], in a confined process; `None` if it was cancelled by
    /// [`RunSettings::stop`].
    pub fn run(
        &self,
        scenario_file: &ScenarioFile,
        scenario: &Scenario,
        seed: u64,
        settings: &RunSettings,
    ) -> io::Result<Option<ScenarioResult>> {
        let data = tempfile::tempdir()?;
        let subject = settings.subject.clone().or_else(|| scenario_file.subject());
        let mut policy = sandbox_policy(scenario_file, subject.as_deref(), self.timeout);
        policy.write.push(data.path().to_owned());
        let run = RunParameters {
            scenario: scenario.clone(),
            seed,
            subject,
            config: serde_json::to_string(&without_credentials(&settings.config))
                .map_err(io::Error::other)?,
            firmware: serde_json::to_string(&settings.firmware).map_err(io::Error::other)?,
            data: data.path().to_owned(),
            stuck: STUCK.min(self.timeout / 2),
        };
        let request = pack(&request(scenario_file, Some(run)))?;
        let wanted = || !settings.stop.is_cancelled();
        match self.worker.ask(&policy, &request, self.timeout, &wanted) {
            Ok(answer) => {
                let result: Result<ScenarioResult, String> =
                    postcard::from_bytes(&answer).map_err(io::Error::other)?;
                result.map(Some).map_err(io::Error::other)
            }
            Err(WorkerError::Cancelled) => Ok(None),
            Err(error) => Ok(Some(without_answer(scenario_file, &error))),
        }
    }
}

/// Removes the robot's address, user and password file, which a scenario does not need.
fn without_credentials(config: &Config) -> Config {
    Config {
        robot: None,
        user: None,
        password_file: None,
        ..config.clone()
    }
}

fn pack(request: &ProcessRequest) -> io::Result<Vec<u8>> {
    postcard::to_allocvec(request).map_err(io::Error::other)
}

fn request(scenario_file: &ScenarioFile, run: Option<RunParameters>) -> ProcessRequest {
    ProcessRequest {
        file: scenario_file.file().to_owned(),
        folder: scenario_file.folder().map(Path::to_owned),
        source: scenario_file.source.clone(),
        run,
    }
}

/// Returns the confinement: allows reading the folders of the scenario and of the behaviour, and
/// the current folder if it contains the scenario's and is not too general ([`is_wide`]), because a
/// scenario may refer to `../patrol.lua`.
fn sandbox_policy(
    scenario_file: &ScenarioFile,
    subject: Option<&Path>,
    limit: Duration,
) -> SandboxPolicy {
    let of_subject = subject.map(|file| file.parent().unwrap_or(Path::new("")));
    let mut read: Vec<PathBuf> = [scenario_file.folder(), of_subject]
        .into_iter()
        .flatten()
        .map(Path::to_owned)
        .collect();
    let here = std::env::current_dir().and_then(|here| here.canonicalize());
    let there = scenario_file
        .folder()
        .map(|folder| Path::new(".").join(folder).canonicalize());
    if let (Ok(here), Some(Ok(there))) = (here, there)
        && there.starts_with(&here)
        && !is_wide(&here)
    {
        read.push(here);
    }
    SandboxPolicy {
        read,
        cpu_seconds: 2 * limit.as_secs() + 1,
        ..SandboxPolicy::default()
    }
}

/// Whether a folder is too general for a scenario to read: the root folder, the home folder or a
/// parent of it.
fn is_wide(folder: &Path) -> bool {
    let home = std::env::var_os("HOME").map(PathBuf::from);
    let home = home.and_then(|home| home.canonicalize().ok());
    folder.parent().is_none() || home.is_some_and(|home| home.starts_with(folder))
}

fn without_answer(scenario_file: &ScenarioFile, error: &WorkerError) -> ScenarioResult {
    let words = match error {
        WorkerError::TimedOut(limit) => format!(
            "it did not finish within {} s of real time and was stopped; --timeout sets a longer \
             limit",
            limit.as_secs_f64()
        ),
        other => other.to_string(),
    };
    let own = words.starts_with(&format!("{}: ", scenario_file.file().display()));
    let cause = match error {
        WorkerError::Broken(_) if !own => Cause::Behaviour(words.clone()),
        _ => Cause::Scenario,
    };
    ScenarioResult {
        simulated: Duration::ZERO,
        failure: Some(Failure {
            message: words,
            cause,
            location: None,
            line: None,
            help: None,
            recent: Vec::new(),
            snapshot: None,
        }),
        lines: Vec::new(),
    }
}

/// The main function of such a process. The arguments describe its confinement.
pub fn scenario_process_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    sandbox::answer(arguments, STACK, |request| {
        let request: ProcessRequest = postcard::from_bytes(request).map_err(io::Error::other)?;
        let scenario_file = ScenarioFile::undeclared(&request.file, request.folder, request.source);
        match request.run {
            None => {
                end_when_stuck(STUCK);
                let declared = scenario_file
                    .read_declarations()
                    .map_err(|error| error.to_string());
                postcard::to_allocvec(&declared).map_err(io::Error::other)
            }
            Some(run) => {
                end_when_stuck(run.stuck);
                let result = run.run(&scenario_file).map_err(|error| error.to_string());
                postcard::to_allocvec(&result).map_err(io::Error::other)
            }
        }
    })
}

impl RunParameters {
    fn run(self, scenario_file: &ScenarioFile) -> io::Result<ScenarioResult> {
        let settings = RunSettings {
            config: serde_json::from_str(&self.config).map_err(io::Error::other)?,
            firmware: serde_json::from_str(&self.firmware).map_err(io::Error::other)?,
            subject: self.subject,
            data: Some(self.data),
            stop: CancellationToken::new(),
        };
        scenario_file.run(&self.scenario, self.seed, &settings)
    }
}

/// Ends the process, with a message that names the script, if a script cannot be interrupted for
/// this long.
fn end_when_stuck(after: Duration) {
    script::when_stuck(after, |file| {
        eprintln!("{}", script::stuck(file));
        std::process::exit(1);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_config_is_transferred_completely() {
        let text = "robot: 10.0.0.1\npassword_file: secret\n\
                    watchdog: { low: 25, host_silence: 0.5, rescue: off }\n\
                    streams: { video: off }\n\
                    limits: { memory_bytes: 16777216, noise_dbfs: -41.5 }\n\
                    calibration: { full_speed: 0.31 }\ncamera: { hfov: 1.02 }\n\
                    colours: { wall: { h: [350, 10], s: [20, 100], v: [0, 90] }, \
                    sky: { l: [0, 50], a: [-3, 4], b: [1, 9] } }\n";
        let config = Config::parse(text, "spykee.yaml").unwrap();
        let there = serde_json::to_string(&without_credentials(&config)).unwrap();
        assert!(
            !there.contains("10.0.0.1") && !there.contains("secret"),
            "{there}"
        );
        let back: Config = serde_json::from_str(&there).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), there);
        assert_eq!(back.watchdog, config.watchdog);
        assert_eq!(back.limits, config.limits);
        assert_eq!(back.calibration, config.calibration);
    }
}
