//! `spykee robot dock` and `undock`: through the pilot, under the watchdog's rules.

use std::time::Duration;

use serde_json::json;

use super::drive_robot;
use crate::cli::running::{SharedTargetArgs, ask, unexpected_reply};
use crate::cli::settings::CommandSettings;
use crate::cli::{Exit, Failure, argument, print, print_json};
use crate::control::{RunRequest, RunResponse};
use crate::robot::{DockEnd, DockOutcome, DockPlan};

/// Timeout for a run's reply, beyond the planned time.
const SLACK: Duration = Duration::from_secs(60);
/// Time limit of what follows a search, until the next one.
const BETWEEN_SEARCHES: Duration = Duration::from_secs(40);

/// Drive to the charging station, as `robot.dock` does
///
/// The robot's firmware searches for the station; between two tries the robot backs off a little.
/// Ctrl-C ends the search and stops the robot.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Example: spykee robot dock --robot 172.17.6.1 --timeout 60\n\n\
                        The distance from which the robot finds its station is not documented."
)]
pub(in crate::cli) struct DockArgs {
    /// Time limit of each try, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 180,
          value_parser = argument::whole::<u64>(1..=3600))]
    timeout: u64,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    target: SharedTargetArgs,
}

/// Leave the charging station; refused while the battery is low
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot undock --robot 172.17.6.1")]
pub(in crate::cli) struct UndockArgs {
    /// Time to wait for the robot to report that it has left, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 15,
          value_parser = argument::whole::<u64>(1..=600))]
    timeout: u64,
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    target: SharedTargetArgs,
}

pub(super) fn dock(args: &DockArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let plan = DockPlan {
        timeout: Duration::from_secs(args.timeout),
        ..DockPlan::ORDERED
    };
    if let Some(run) = args.target.find_run(settings)? {
        let attempt = plan.timeout + plan.charge_timeout + BETWEEN_SEARCHES;
        let limit = attempt * (plan.retries + 1) + SLACK;
        let request = RunRequest::Dock {
            seconds: Some(args.timeout),
            retries: None,
        };
        let RunResponse::Docked {
            end,
            attempts,
            seconds,
        } = ask(&run, &request, limit)?
        else {
            return Err(unexpected_reply());
        };
        let docked = DockOutcome {
            end,
            attempts,
            took: Duration::try_from_secs_f64(seconds).unwrap_or_default(),
        };
        return show_docked(args.json, docked, run.status.low);
    }
    // Without a run there is no rescue behaviour.
    let plan = DockPlan {
        retries: DockPlan::DEFAULT.retries,
        ..plan
    };
    drive_robot(&args.target.connection, settings, async |driver| {
        let docked = driver.ask(async |client| client.dock(plan).await);
        let docked = docked.await?;
        show_docked(args.json, docked, driver.status().low)
    })
}

fn show_docked(as_json: bool, docked: DockOutcome, low: bool) -> Result<Exit, Failure> {
    let end = docked.end;
    let seconds = docked.took.as_secs_f64();
    if as_json {
        let attempts = docked.attempts;
        print_json(&json!({ "end": end.name(), "attempts": attempts, "seconds": seconds }))?;
    } else if end == DockEnd::Done {
        print(&format!(
            "on its station and charging, after {seconds:.0} s\n"
        ))?;
    }
    exit_of(end, low)
}

pub(super) fn undock(args: &UndockArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let limit = Duration::from_secs(args.timeout);
    if let Some(run) = args.target.find_run(settings)? {
        let request = RunRequest::Undock {
            seconds: Some(args.timeout),
        };
        let RunResponse::Undocked { end } = ask(&run, &request, limit + SLACK)? else {
            return Err(unexpected_reply());
        };
        return show_undocked(args.json, end, run.status.low);
    }
    drive_robot(&args.target.connection, settings, async |driver| {
        let end = driver.ask(async |client| client.undock(limit).await);
        let end = end.await?;
        show_undocked(args.json, end, driver.status().low)
    })
}

fn show_undocked(as_json: bool, end: DockEnd, low: bool) -> Result<Exit, Failure> {
    if as_json {
        print_json(&json!({ "end": end.name() }))?;
    } else if end == DockEnd::Done {
        print("off its station\n")?;
    }
    exit_of(end, low)
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
