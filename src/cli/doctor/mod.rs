//! `spykee doctor`: checks everything that running behaviours on a robot needs.

mod computer;
mod first;
mod network;

use serde::Serialize;

use super::settings::SettingsArgs;
use super::{ConnectionArgs, Exit, Failure, RobotChoice, block_on, print};
use crate::config::Effective;
use crate::sanitize;

/// Check network, robot, clock, disk, config, kernel and terminal
///
/// The exit code is 0 if nothing failed, even with warnings, and 3 otherwise. If a robot is named,
/// the command logs in for some seconds and stops the tracks.
///
/// With --first it then gets to know a robot, with a person beside it, in about ten minutes: how its
/// program executes commands, what its battery level means, how it leaves its station, the least
/// power that moves it, and whether it stops without a connection. It says what it will do, asks
/// before each motion, and writes the config, or prints its lines if there is one.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee doctor\n  spykee doctor --robot 172.17.6.1\n  \
                        spykee doctor --robot 172.17.6.1 --first\n  \
                        spykee doctor --config spykee.yaml --json"
)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Print a JSON array
    #[arg(long)]
    json: bool,

    /// Then find out what is not known of the robot: drives it
    #[arg(long, conflicts_with = "json")]
    first: bool,

    /// With --first: ask nobody before a motion
    #[arg(long, requires = "first")]
    yes: bool,

    #[command(flatten)]
    connection: ConnectionArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    Ok,
    Warn,
    Fail,
}

#[derive(Debug, Clone, Serialize)]
struct CheckResult {
    check: &'static str,
    verdict: Verdict,
    found: String,
    /// What to do; `None` if the check passed.
    help: Option<String>,
}

impl CheckResult {
    fn ok(check: &'static str, found: impl Into<String>) -> CheckResult {
        let verdict = Verdict::Ok;
        let found = found.into();
        let help = None;
        CheckResult {
            check,
            verdict,
            found,
            help,
        }
    }

    fn warn(check: &'static str, found: impl Into<String>, help: &str) -> CheckResult {
        let verdict = Verdict::Warn;
        let help = Some(help.to_owned());
        CheckResult {
            verdict,
            help,
            ..CheckResult::ok(check, found)
        }
    }

    fn fail(check: &'static str, found: impl Into<String>, help: &str) -> CheckResult {
        let verdict = Verdict::Fail;
        CheckResult {
            verdict,
            ..CheckResult::warn(check, found, help)
        }
    }

    fn line(&self) -> String {
        let verdict = match self.verdict {
            Verdict::Ok => "ok  ",
            Verdict::Warn => "warn",
            Verdict::Fail => "FAIL",
        };
        let help = self.help.as_ref();
        let help = help.map_or_else(String::new, |help| format!("\n{:18}-> {help}", ""));
        let found = sanitize::text(&self.found, false).replace('\n', " ");
        format!("{verdict}  {:10}  {found}{help}\n", self.check)
    }
}

/// Runs all checks and prints a line for each.
///
/// # Errors
/// No runtime, a login or world that cannot be used, an interruption, or a stdout that cannot be
/// written to. A failed check is not an error but sets the exit code.
pub(super) fn run(args: &DoctorArgs) -> Result<Exit, Failure> {
    let mut report = DoctorReport {
        json: args.json,
        results: Vec::new(),
    };
    let settings = settings(args, &mut report)?;
    let config = &settings.config;
    for result in [
        computer::clock(),
        computer::disk(config.data_folder()),
        computer::landlock(),
        computer::seccomp(),
        computer::terminal(),
    ] {
        report.add(result)?;
    }
    let choice = args.connection.robot();
    let choice = choice.or_else(|| config.robot.clone().map(RobotChoice::Robot));
    block_on(network::examine(
        choice,
        &args.connection,
        &settings,
        &mut report,
    ))??;
    let exit = report.end()?;
    if !args.first || exit != Exit::Done {
        return Ok(exit);
    }
    first::run(args, args.yes)
}

/// Loads the settings. Reports an invalid config and falls back to the defaults.
fn settings(args: &DoctorArgs, report: &mut DoctorReport) -> Result<Effective, Failure> {
    let config = args.settings.load();
    report.add(match (&config, args.settings.file()) {
        (Ok(_), Some(path)) => CheckResult::ok("config", format!("{} is valid", path.display())),
        (Ok(_), None) => {
            CheckResult::ok("config", "no config named, no spykee.yaml here: defaults")
        }
        (Err(error), _) => {
            let help = "correct the file; the README lists the keys";
            CheckResult::fail("config", error.to_string(), help)
        }
    })?;
    Ok(config.cloned().unwrap_or_default())
}

/// The results so far. Prints each line as soon as its result is known.
struct DoctorReport {
    json: bool,
    results: Vec<CheckResult>,
}

impl DoctorReport {
    fn add(&mut self, result: CheckResult) -> Result<(), Failure> {
        if !self.json {
            print(&result.line())?;
        }
        self.results.push(result);
        Ok(())
    }

    fn end(self) -> Result<Exit, Failure> {
        if self.json {
            print(&format!("{}\n", serde_json::json!(self.results)))?;
        }
        let failed = |result: &CheckResult| result.verdict == Verdict::Fail;
        Ok(if self.results.iter().any(failed) {
            Exit::Unreachable
        } else {
            Exit::Done
        })
    }
}
