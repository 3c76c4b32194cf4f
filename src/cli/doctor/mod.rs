//! `spykee doctor`: checks everything that running behaviours on a robot needs.

mod computer;
mod network;

use serde::Serialize;

use super::settings::SettingsArgs;
use super::{ConnectionArgs, Exit, Failure, RobotChoice, block_on, print};
use crate::clean;
use crate::config::Effective;

/// Check network, robot, clock, disk, config, kernel and terminal
///
/// The exit code is 0 if nothing failed, even with warnings, and 3 otherwise. If a robot is named,
/// the command logs in for some seconds and stops the tracks.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee doctor\n  spykee doctor --robot 172.17.6.1\n  \
                        spykee doctor --config spykee.yaml --json"
)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Print a JSON array
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    connection: ConnectionArgs,
}

/// The result of a check.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
enum Verdict {
    Ok,
    Warn,
    Fail,
}

/// One line of the diagnosis.
#[derive(Debug, Clone, Serialize)]
struct Finding {
    check: &'static str,
    verdict: Verdict,
    found: String,
    /// What to do; `None` if the check passed.
    help: Option<String>,
}

impl Finding {
    fn ok(check: &'static str, found: impl Into<String>) -> Finding {
        let (verdict, found, help) = (Verdict::Ok, found.into(), None);
        Finding {
            check,
            verdict,
            found,
            help,
        }
    }

    fn warn(check: &'static str, found: impl Into<String>, help: &str) -> Finding {
        let (verdict, help) = (Verdict::Warn, Some(help.to_owned()));
        Finding {
            verdict,
            help,
            ..Finding::ok(check, found)
        }
    }

    fn fail(check: &'static str, found: impl Into<String>, help: &str) -> Finding {
        let verdict = Verdict::Fail;
        Finding {
            verdict,
            ..Finding::warn(check, found, help)
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
        let found = clean::text(&self.found, false).replace('\n', " ");
        format!("{verdict}  {:10}  {found}{help}\n", self.check)
    }
}

/// Runs all checks and prints a line for each.
///
/// # Errors
/// No runtime, a login or world that cannot be used, an interruption, or a stdout that cannot be
/// written to. A failed check is not an error but sets the exit code.
pub(super) fn run(args: &DoctorArgs) -> Result<Exit, Failure> {
    let mut diagnosis = Diagnosis {
        json: args.json,
        findings: Vec::new(),
    };
    let settings = settings(args, &mut diagnosis)?;
    let config = &settings.config;
    for finding in [
        computer::clock(),
        computer::disk(config.data_folder()),
        computer::landlock(),
        computer::seccomp(),
        computer::terminal(),
    ] {
        diagnosis.add(finding)?;
    }
    let place = args.connection.place();
    let place = place.or_else(|| config.robot.clone().map(RobotChoice::Robot));
    block_on(network::examine(
        place,
        &args.connection,
        &settings,
        &mut diagnosis,
    ))??;
    diagnosis.end()
}

/// Loads the settings. Reports an invalid config and falls back to the defaults.
fn settings(args: &DoctorArgs, diagnosis: &mut Diagnosis) -> Result<Effective, Failure> {
    let config = args.settings.load();
    diagnosis.add(match (&config, args.settings.file()) {
        (Ok(_), Some(path)) => Finding::ok("config", format!("{} is valid", path.display())),
        (Ok(_), None) => Finding::ok("config", "no config named, no spykee.yaml here: defaults"),
        (Err(error), _) => {
            let help = "correct the file; the README lists the keys";
            Finding::fail("config", error.to_string(), help)
        }
    })?;
    Ok(config.cloned().unwrap_or_default())
}

/// The findings so far. Prints each line as soon as its finding is known.
struct Diagnosis {
    json: bool,
    findings: Vec<Finding>,
}

impl Diagnosis {
    fn add(&mut self, finding: Finding) -> Result<(), Failure> {
        if !self.json {
            print(&finding.line())?;
        }
        self.findings.push(finding);
        Ok(())
    }

    fn end(self) -> Result<Exit, Failure> {
        if self.json {
            print(&format!("{}\n", serde_json::json!(self.findings)))?;
        }
        let failed = |finding: &Finding| finding.verdict == Verdict::Fail;
        Ok(if self.findings.iter().any(failed) {
            Exit::Unreachable
        } else {
            Exit::Done
        })
    }
}
