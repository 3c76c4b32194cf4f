//! `spykee calibrate`: measures the robot's track width and speed with two timed moves and a turn.

mod edit;
mod measure;
mod person;
mod simulated;

use std::io::IsTerminal;
use std::path::Path;

use serde_json::json;

use self::measure::{Measured, Plan};
use super::driver::{Driver, drive};
use super::robot::AimArgs;
use super::{Exit, Failure, block_on, number, print};
use crate::files;
use crate::pilot::Status;
use crate::robot::MotionEnd;
use crate::safety::WatchdogState;
use crate::script::Calibration;
use crate::yaml;

/// Measure the robot's track width and speed for the config
///
/// Guides you through two moves straight ahead and a turn on the spot, asks how far the robot
/// really went, and computes `calibration:` from your answers. Every step can be repeated. With
/// --sim the simulator does the measuring. Put the robot off its station, on the floor that it will
/// drive on, with two metres free ahead, no stairs and no people in the way. Ctrl-C stops the
/// robot.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee calibrate --robot 172.17.6.1 --config spykee.yaml\n  \
                        spykee calibrate --sim --json"
)]
pub(super) struct CalibrateArgs {
    /// Print a JSON object; questions go to stderr
    #[arg(long)]
    json: bool,

    /// Write the result into the config without asking
    #[arg(long)]
    yes: bool,

    /// Number of measurements to average
    #[arg(long, value_name = "COUNT", default_value_t = 1,
          value_parser = number::whole::<u8>(1..=20))]
    rounds: u8,

    /// Seed for simulator noise [default: random]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    #[command(flatten)]
    pub(super) aim: AimArgs,
}

/// Measures, prints the result, and writes it into the config if the user agrees.
///
/// # Errors
/// A robot that cannot be reached or may not drive, implausible measurements, a config that cannot
/// be changed.
pub(super) fn run(args: &CalibrateArgs) -> Result<Exit, Failure> {
    let seed = args.seed.unwrap_or_else(rand::random);
    let aim = args.aim.aim(seed)?;
    let parts = aim.driver_parts(seed)?;
    let simulator = aim.sim.as_ref().map(super::embedded::EmbeddedSim::handle);
    let mut measured = None;
    let measuring = drive(parts, async |driver| {
        let mut rounds = Vec::new();
        for _ in 0..args.rounds {
            rounds.push(match &simulator {
                Some(handle) => simulated::round(driver, handle).await?,
                None => person::round(driver, args.json).await?,
            });
        }
        measured = Some(Measured::average(&rounds)?);
        Ok(Exit::Done)
    });
    let exit = block_on(measuring)??;
    let Some(calibration) = measured else {
        return Ok(exit);
    };
    conclude(args, calibration)
}

/// Returns an error with help if the robot may not drive.
fn ready(status: Status) -> Result<(), Failure> {
    if status.low {
        let failure = Failure::new(Exit::Safety, "the battery is low: the robot may not drive");
        return Err(failure.help("charge the robot first"));
    }
    if status.safety == WatchdogState::Docked {
        let failure = Failure::usage("the robot is on its station");
        return Err(failure.help("`spykee robot undock`, then put it on free floor"));
    }
    Ok(())
}

/// Drives one step. A step that is cut short is an error: it would spoil the measurement.
async fn step(driver: &mut Driver, plan: Plan) -> Result<(), Failure> {
    ready(driver.status())?;
    let end = driver.run(plan.setpoint, plan.duration).await?;
    let (exit, help) = match end {
        MotionEnd::Done => return Ok(()),
        MotionEnd::Safety => (Exit::Safety, "charge the robot first"),
        MotionEnd::Disconnected => (
            Exit::Unreachable,
            "is the robot still in reach of its Wi-Fi?",
        ),
        _ => (Exit::Script, "start again, on free floor"),
    };
    let what = format_args!("the move was cut short: {end}");
    Err(Failure::new(exit, what).help(help))
}

fn conclude(args: &CalibrateArgs, calibration: Calibration) -> Result<Exit, Failure> {
    let line = edit::line_of(calibration);
    if !args.json {
        print(&format!("\n{line}\n"))?;
    }
    let written = match args.aim.settings.file() {
        Some(path) => write(args, path, calibration)?,
        None => {
            if !args.json {
                print(
                    "Paste this line into your config, or use --config FILE or a spykee.yaml in this folder to have it written.\n",
                )?;
            }
            false
        }
    };
    if args.json {
        let Calibration {
            track_width,
            full_speed,
        } = calibration;
        let object = json!({
            "track_width": track_width, "full_speed": full_speed, "written": written,
        });
        print(&format!("{object}\n"))?;
    }
    Ok(Exit::Done)
}

/// Shows the change, asks, and replaces the file atomically. Returns whether it was written.
fn write(args: &CalibrateArgs, path: &Path, calibration: Calibration) -> Result<bool, Failure> {
    let shown = path.display();
    let cannot = |what: &str, error: &dyn std::fmt::Display| {
        Failure::usage(format_args!("cannot {what} {shown}: {error}"))
            .help(format!("write it yourself: {}", edit::line_of(calibration)))
    };
    let before = files::read_text(path, yaml::MAX_LEN).map_err(|error| cannot("read", &error))?;
    let after = edit::with_calibration(&before, &shown.to_string(), calibration)
        .map_err(|error| cannot("change", &error))?;
    let change = edit::diff(&before, &after);
    if change.is_empty() {
        person::say(args.json, &format!("{shown} already has these values.\n"))?;
        return Ok(false);
    }
    person::say(args.json, &format!("\n{shown}:\n{change}"))?;
    if !args.yes {
        if !std::io::stdin().is_terminal() {
            person::say(
                args.json,
                "Not written: stdin is not a terminal. --yes writes without asking.\n",
            )?;
            return Ok(false);
        }
        person::say(args.json, "Write it? [y/N] ")?;
        if !matches!(person::line()?.as_str(), "y" | "Y" | "yes") {
            return Ok(false);
        }
    }
    replace(path, &after).map_err(|error| cannot("write", &error))?;
    Ok(true)
}

/// Replaces the file atomically: readers see the old file or the new one, never a partial one.
fn replace(path: &Path, text: &str) -> std::io::Result<()> {
    let path = path.canonicalize()?;
    let name = format!(".spykee-calibrate-{}", std::process::id());
    let new = path.with_file_name(name);
    let replaced = std::fs::write(&new, text)
        .and_then(|()| std::fs::set_permissions(&new, path.metadata()?.permissions()))
        .and_then(|()| std::fs::rename(&new, &path));
    if replaced.is_err() {
        // Best effort: the incomplete temporary file is of no use.
        let _ = std::fs::remove_file(&new);
    }
    replaced
}
