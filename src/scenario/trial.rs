//! Plays scenarios in confined processes: each file is read, and each scenario is played, in a
//! separate process confined by the kernel. The process can read only the folders of the scenario
//! and of the behaviour under test, and the current folder if it contains the scenario and is not
//! too general, as the home folder is. It writes to a folder that is deleted afterwards, and its
//! answer goes over a pipe that no script can access.
//!
//! If a script hangs in one call, crashes the process or takes too long, the process is ended and
//! the scenario has failed.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio_util::sync::CancellationToken;

use super::book::{Book, BookError, Scenario};
use super::play::{Cause, Failure, Played, Setting};
use crate::behaviour::{STACK, read_source};
use crate::config::Config;
use crate::script;
use crate::walls::{self, SandboxPolicy, Worker, WorkerError};

/// The kind of worker process that reads and plays scenarios.
pub const TRIAL: &str = "scenario";
/// Time limit for reading the declarations of a file.
const READING: Duration = Duration::from_secs(20);
/// A script that cannot be interrupted for this long ends its process.
const STUCK: Duration = Duration::from_secs(5);

/// Plays scenarios in confined processes.
#[derive(Debug, Clone)]
pub struct Trials {
    worker: Worker,
    timeout: Duration,
}

#[derive(Serialize, Deserialize)]
struct Question {
    file: PathBuf,
    folder: Option<PathBuf>,
    source: Vec<u8>,
    /// The scenario to play; `None` asks for the declarations.
    play: Option<Play>,
}

#[derive(Serialize, Deserialize)]
struct Play {
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

impl Trials {
    /// Uses processes of the running executable, which must be `spykee`. `timeout` limits each
    /// played scenario, in real time.
    ///
    /// # Errors
    /// If the path of the executable cannot be determined.
    pub fn new(timeout: Duration) -> io::Result<Trials> {
        let worker = Worker::of_this_executable(TRIAL)?;
        Ok(Trials { worker, timeout })
    }

    /// Like [`Book::read`], in a confined process.
    ///
    /// # Errors
    /// See [`BookError`].
    pub fn read(&self, file: &Path) -> Result<Book, BookError> {
        let source = read_source(file).map_err(|source| BookError::Read {
            path: file.display().to_string(),
            source,
        })?;
        let folder = file.parent().unwrap_or(Path::new(""));
        self.book(file, Some(folder.to_owned()), source)
    }

    /// Like [`Book::of_text`], in a confined process.
    ///
    /// # Errors
    /// [`BookError::Invalid`].
    pub fn of_text(&self, name: &str, text: &str) -> Result<Book, BookError> {
        self.book(Path::new(name), None, text.into())
    }

    fn book(
        &self,
        file: &Path,
        folder: Option<PathBuf>,
        source: Vec<u8>,
    ) -> Result<Book, BookError> {
        let book = Book::undeclared(file, folder, source);
        let policy = sandbox_policy(&book, None, READING);
        let invalid =
            |why: &dyn std::fmt::Display| BookError::Invalid(format!("{}: {why}", file.display()));
        let question = pack(&question(&book, None)).map_err(|error| invalid(&error))?;
        let answer = self.worker.ask(&policy, &question, READING, &|| true);
        let answer = answer.map_err(|error| invalid(&error))?;
        let declared: Result<Vec<Scenario>, String> =
            postcard::from_bytes(&answer).map_err(|error| invalid(&error))?;
        Ok(book.with_scenarios(declared.map_err(BookError::Invalid)?))
    }

    /// Like [`Book::play`], in a confined process; `None` if it was cancelled by [`Setting::stop`].
    ///
    /// # Errors
    /// If the system cannot create the behaviours' data folder.
    pub fn play(
        &self,
        book: &Book,
        scenario: &Scenario,
        seed: u64,
        setting: &Setting,
    ) -> io::Result<Option<Played>> {
        let data = tempfile::tempdir()?;
        let subject = setting.subject.clone().or_else(|| book.subject());
        let mut policy = sandbox_policy(book, subject.as_deref(), self.timeout);
        policy.write.push(data.path().to_owned());
        let play = Play {
            scenario: scenario.clone(),
            seed,
            subject,
            config: serde_json::to_string(&without_credentials(&setting.config))
                .map_err(io::Error::other)?,
            firmware: serde_json::to_string(&setting.firmware).map_err(io::Error::other)?,
            data: data.path().to_owned(),
            stuck: STUCK.min(self.timeout / 2),
        };
        let question = pack(&question(book, Some(play)))?;
        let wanted = || !setting.stop.is_cancelled();
        match self.worker.ask(&policy, &question, self.timeout, &wanted) {
            Ok(answer) => {
                let played: Result<Played, String> =
                    postcard::from_bytes(&answer).map_err(io::Error::other)?;
                played.map(Some).map_err(io::Error::other)
            }
            Err(WorkerError::Cancelled) => Ok(None),
            Err(error) => Ok(Some(without_answer(book, &error))),
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

fn pack(question: &Question) -> io::Result<Vec<u8>> {
    postcard::to_allocvec(question).map_err(io::Error::other)
}

fn question(book: &Book, play: Option<Play>) -> Question {
    Question {
        file: book.file().to_owned(),
        folder: book.folder().map(Path::to_owned),
        source: book.source().to_vec(),
        play,
    }
}

/// Returns the confinement: allows reading the folders of the scenario and of the behaviour, and
/// the current folder if it contains the scenario's and is not too general ([`is_wide`]), because a
/// scenario may refer to `../patrol.lua`.
fn sandbox_policy(book: &Book, subject: Option<&Path>, limit: Duration) -> SandboxPolicy {
    let of_subject = subject.map(|file| file.parent().unwrap_or(Path::new("")));
    let mut read: Vec<PathBuf> = [book.folder(), of_subject]
        .into_iter()
        .flatten()
        .map(Path::to_owned)
        .collect();
    let here = std::env::current_dir().and_then(|here| here.canonicalize());
    let there = book
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
        write: Vec::new(),
        cpu_seconds: 2 * limit.as_secs() + 1,
    }
}

/// Whether a folder is too general for a scenario to read: the root folder, the home folder or a
/// parent of it.
fn is_wide(folder: &Path) -> bool {
    let home = std::env::var_os("HOME").map(PathBuf::from);
    let home = home.and_then(|home| home.canonicalize().ok());
    folder.parent().is_none() || home.is_some_and(|home| home.starts_with(folder))
}

/// Returns the result of a scenario whose process gave no answer.
fn without_answer(book: &Book, error: &WorkerError) -> Played {
    let words = match error {
        WorkerError::TimedOut(limit) => format!(
            "it did not finish within {} s of real time and was stopped; --timeout sets a longer \
             limit",
            limit.as_secs_f64()
        ),
        other => other.to_string(),
    };
    let own = words.starts_with(&format!("{}: ", book.file().display()));
    let cause = match error {
        WorkerError::Broken(_) if !own => Cause::Behaviour(words.clone()),
        _ => Cause::Scenario,
    };
    Played {
        simulated: Duration::ZERO,
        failure: Some(Failure {
            message: words,
            cause,
            place: None,
            line: None,
            help: None,
            recent: Vec::new(),
            scene: None,
        }),
        lines: Vec::new(),
    }
}

/// The main function of such a process. The arguments describe its confinement.
pub fn trial_main(arguments: impl Iterator<Item = OsString>) -> ExitCode {
    walls::answer(arguments, STACK, |question| {
        let question: Question = postcard::from_bytes(question).map_err(io::Error::other)?;
        let book = Book::undeclared(&question.file, question.folder, question.source);
        match question.play {
            None => {
                end_when_stuck(STUCK);
                let declared = book.read_declarations().map_err(|error| error.to_string());
                postcard::to_allocvec(&declared).map_err(io::Error::other)
            }
            Some(play) => {
                end_when_stuck(play.stuck);
                let played = play.play(&book).map_err(|error| error.to_string());
                postcard::to_allocvec(&played).map_err(io::Error::other)
            }
        }
    })
}

impl Play {
    fn play(self, book: &Book) -> io::Result<Played> {
        let setting = Setting {
            config: serde_json::from_str(&self.config).map_err(io::Error::other)?,
            firmware: serde_json::from_str(&self.firmware).map_err(io::Error::other)?,
            subject: self.subject,
            data: Some(self.data),
            stop: CancellationToken::new(),
        };
        book.play(&self.scenario, self.seed, &setting)
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
                    watchdog: { low: 25, host_silence: 0.5, rescue: off, host_idle_silence: 7.5 }\n\
                    link: {}\nstreams: { video: off }\n\
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
