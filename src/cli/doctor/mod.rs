//! `spykee doctor`: checks everything that running behaviours on a robot needs.

mod computer;
mod first;
mod network;

use serde::Serialize;

use super::settings::CommandSettings;
use super::usable::check_config;
use super::{ConnectionArgs, Console, Exit, Failure, print, print_json};
use crate::clock::Clock;
use crate::config::Effective;
use crate::sandbox::Restrictions;
use crate::sanitize;

/// Check network, robot, clock, disk, config, kernel and terminal
///
/// The exit code is 0 if nothing failed, even with warnings, and 3 otherwise. If a robot is named,
/// the command logs in for some seconds and stops the tracks.
///
/// With --first it then gets to know a robot, with a person beside it, in about ten minutes: how
/// its program executes commands, what its battery level means, how it leaves its station, the
/// least power that moves it, and whether it stops without a connection. It says what it will do,
/// asks before each motion, and writes the config, or prints its lines if there is one.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee doctor\n  spykee doctor --robot 172.17.6.1\n  \
                        spykee doctor --robot 172.17.6.1 --first\n  \
                        spykee doctor --config spykee.yaml --json"
)]
pub(super) struct DoctorArgs {
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
        CheckResult {
            check,
            verdict: Verdict::Ok,
            found: found.into(),
            help: None,
        }
    }

    fn warn(check: &'static str, found: impl Into<String>, help: &str) -> CheckResult {
        CheckResult {
            verdict: Verdict::Warn,
            help: Some(help.to_owned()),
            ..CheckResult::ok(check, found)
        }
    }

    fn fail(check: &'static str, found: impl Into<String>, help: &str) -> CheckResult {
        CheckResult {
            verdict: Verdict::Fail,
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

pub(super) fn run(
    args: &DoctorArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let mut report = DoctorReport {
        json: args.json,
        results: Vec::new(),
        printed: Ok(Exit::Done),
    };
    let checked = checked_config(settings, console, &mut report);
    for result in [
        computer::clock(Clock::default().now()),
        computer::disk(checked.config.data_folder()),
        computer::landlock(),
        computer::seccomp(Restrictions::supported().calls),
        computer::terminal(),
    ] {
        report.add(result);
    }
    network::examine(&args.connection, checked, &mut report)?;
    let exit = report.end()?;
    if !args.first || exit != Exit::Done {
        return Ok(exit);
    }
    first::run(args, settings)
}

/// Loads the settings. Reports an invalid config and falls back to the defaults.
fn checked_config(
    settings: &CommandSettings,
    console: &Console,
    report: &mut DoctorReport,
) -> Effective {
    let config = settings.load();
    report.add(match (&config, settings.file()) {
        (Ok(effective), Some(path)) => match check_config(path, &effective.config, console) {
            Ok(()) => CheckResult::ok("config", format!("{} is valid", path.display())),
            Err(failure) => {
                let help = "`spykee serve` would refuse it; `spykee config check` says more";
                CheckResult::fail("config", failure.what, help)
            }
        },
        (Ok(_), None) => {
            CheckResult::ok("config", "no config named, no spykee.yaml here: defaults")
        }
        (Err(error), _) => {
            let help = "correct the file; the book's chapter Config lists the keys";
            CheckResult::fail("config", error.to_string(), help)
        }
    });
    config.cloned().unwrap_or_default()
}

/// The results so far. Prints each line as soon as its result is known.
struct DoctorReport {
    json: bool,
    results: Vec<CheckResult>,
    printed: Result<Exit, Failure>,
}

impl DoctorReport {
    fn add(&mut self, result: CheckResult) {
        if !self.json && self.printed.is_ok() {
            self.printed = print(&result.line());
        }
        self.results.push(result);
    }

    fn end(self) -> Result<Exit, Failure> {
        self.printed?;
        if self.json {
            print_json(&self.results)?;
        }
        let failed = |result: &CheckResult| result.verdict == Verdict::Fail;
        Ok(if self.results.iter().any(failed) {
            Exit::Unreachable
        } else {
            Exit::Done
        })
    }
}
