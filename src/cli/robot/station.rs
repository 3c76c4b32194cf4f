//! `spykee robot dock` and `undock`: through the pilot, under the watchdog's rules.

use std::time::Duration;

use serde_json::json;

use super::SharedTargetArgs;
use crate::cli::driver::drive;
use crate::cli::running::{ask, unexpected_reply};
use crate::cli::{Exit, Failure, argument, block_on, print};
use crate::control::{RunRequest, RunResponse};
use crate::robot::{DockEnd, DockOutcome, DockPlan};

/// Timeout for a run's reply, beyond the planned time.
const SLACK: Duration = Duration::from_secs(60);

/// Drive to the charging station, as `robot.dock` does
///
/// The robot's firmware searches for the station; between two tries the robot backs off a little.
/// Ctrl-C ends the search and stops the robot.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Example: spykee robot dock --robot 172.17.6.1 --timeout 60\n\n\
                        The distance from which the robot finds its station is not documented."
)]
pub(super) struct DockArgs {
    /// Time limit of each try, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 180,
          value_parser = argument::whole::<u64>(1..=3600))]
    timeout: u64,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

/// Leave the charging station; refused while the battery is low
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot undock --robot 172.17.6.1")]
pub(super) struct UndockArgs {
    /// Time to wait for the robot to report that it has left, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 15,
          value_parser = argument::whole::<u64>(1..=600))]
    timeout: u64,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

pub(super) fn dock(args: &DockArgs) -> Result<Exit, Failure> {
    let plan = DockPlan {
        timeout: Duration::from_secs(args.timeout),
        ..DockPlan::default()
    };
    if let Some(run) = args.target.find_run()? {
        let limit = (plan.timeout + plan.charge_timeout) * (plan.retries + 1) + SLACK;
        let request = RunRequest::Dock {
            seconds: Some(args.timeout),
            retries: None,
        };
        return match ask(&run, &request, limit)? {
            None => Ok(Exit::Interrupted),
            Some(RunResponse::Docked {
                end,
                attempts,
                seconds,
            }) => {
                let docked = DockOutcome {
                    end,
                    attempts,
                    took: Duration::try_from_secs_f64(seconds).unwrap_or_default(),
                };
                show_docked(args.json, docked)?;
                exit_of(end, run.status.low)
            }
            Some(_) => Err(unexpected_reply()),
        };
    }
    let seed = rand::random();
    let target = args.target.resolve(seed)?;
    let docking = drive(target.driver_parts(seed)?, async |driver| {
        let docked = driver.dock(plan).await?;
        show_docked(args.json, docked)?;
        exit_of(docked.end, driver.status().low)
    });
    block_on(docking)?
}

fn show_docked(as_json: bool, docked: DockOutcome) -> Result<(), Failure> {
    let end = docked.end;
    let attempts = docked.attempts;
    let seconds = docked.took.as_secs_f64();
    if as_json {
        let object = json!({ "end": end.name(), "attempts": attempts, "seconds": seconds });
        return print(&format!("{object}\n"));
    }
    match end {
        DockEnd::Done => print(&format!(
            "on its station and charging, after {seconds:.0} s\n"
        )),
        _ => Ok(()),
    }
}

pub(super) fn undock(args: &UndockArgs) -> Result<Exit, Failure> {
    let limit = Duration::from_secs(args.timeout);
    if let Some(run) = args.target.find_run()? {
        let request = RunRequest::Undock {
            seconds: Some(args.timeout),
        };
        return match ask(&run, &request, limit + SLACK)? {
            None => Ok(Exit::Interrupted),
            Some(RunResponse::Undocked { end }) => {
                show_undocked(args.json, end)?;
                exit_of(end, run.status.low)
            }
            Some(_) => Err(unexpected_reply()),
        };
    }
    let seed = rand::random();
    let target = args.target.resolve(seed)?;
    let undocking = drive(target.driver_parts(seed)?, async |driver| {
        let end = driver.undock(limit).await?;
        show_undocked(args.json, end)?;
        exit_of(end, driver.status().low)
    });
    block_on(undocking)?
}

fn show_undocked(as_json: bool, end: DockEnd) -> Result<(), Failure> {
    match end {
        _ if as_json => print(&format!("{}\n", json!({ "end": end.name() }))),
        DockEnd::Done => print("off its station\n"),
        _ => Ok(()),
    }
}

/// The exit code for this end. A robot that already was where it should go is a success.
fn exit_of(end: DockEnd, low: bool) -> Result<Exit, Failure> {
    let (exit, what, help) = match end {
        DockEnd::Done => return Ok(Exit::Done),
        DockEnd::AlreadyDocked => {
            tracing::info!("the robot was already on its station");
            return Ok(Exit::Done);
        }
        DockEnd::NotDocked => {
            tracing::info!("the robot was not on its station");
            return Ok(Exit::Done);
        }
        DockEnd::Safety => (
            Exit::Safety,
            "the watchdog does not allow it".to_owned(),
            "is the battery low? `spykee robot battery` shows its level. A robot whose level is not known \
             may leave its station after an hour in the same run",
        ),
        DockEnd::Disconnected => (
            Exit::Unreachable,
            "the link was lost".to_owned(),
            "is the robot still in reach of its Wi-Fi?",
        ),
        other => (
            if low { Exit::Safety } else { Exit::Failed },
            format!("it did not work: {}", other.name().replace('_', " ")),
            "put the robot in front of its station, some two metres away, and try again",
        ),
    };
    Err(Failure::new(exit, what).help(help))
}
