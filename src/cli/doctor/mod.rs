//! `spykee doctor`: checks everything between this computer and a robot that runs behaviours.

mod computer;
mod network;

use serde::Serialize;

use super::settings::SettingsArgs;
use super::{ConnectionArgs, Exit, Failure, RobotChoice, block_on, print};
use crate::clean;
use crate::config::Effective;

/// Check network, robot, clock, disk, config, kernel and terminal
///
/// The exit code is 0 if nothing failed, even with warnings, and 3 otherwise. With a robot it logs
/// in for some seconds and stops the tracks.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee doctor\n  spykee doctor --robot 172.17.6.1\n  \
                        spykee doctor --config spykee.yaml --json"
)]
pub(super) struct DoctorArgs {
    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Print a JSON array instead of lines
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    connection: ConnectionArgs,
}

/// How a check went.
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
    /// What to do; nothing if all is well.
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

/// Checks everything, and prints a line for each.
///
/// # Errors
/// No runtime, or a stdout that cannot be written to. What is found wrong is no error, but an exit
/// code.
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
        diagnosis.tell(finding)?;
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

/// A wrong one is told, and the rest is checked with the defaults.
fn settings(args: &DoctorArgs, diagnosis: &mut Diagnosis) -> Result<Effective, Failure> {
    let config = args.settings.load();
    diagnosis.tell(match (&config, args.settings.file()) {
        (Ok(_), Some(path)) => Finding::ok("config", format!("{} is valid", path.display())),
        (Ok(_), None) => Finding::ok("config", "no spykee.yaml here, none named: defaults"),
        (Err(error), _) => {
            let help = "correct it there; the README lists the keys";
            Finding::fail("config", error.to_string(), help)
        }
    })?;
    Ok(config.cloned().unwrap_or_default())
}

/// What was found so far; lines are printed as they come.
struct Diagnosis {
    json: bool,
    findings: Vec<Finding>,
}

impl Diagnosis {
    fn tell(&mut self, finding: Finding) -> Result<(), Failure> {
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
