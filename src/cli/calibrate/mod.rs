//! `spykee calibrate`: measures the robot's track width and speed with two timed moves and a turn,
//! and with `camera` where its camera is.

mod camera;
mod measure;
pub(super) mod person;
mod simulated;

use std::time::Duration;

use serde_json::json;

use self::measure::Plan;
use super::driver::{Driver, drive};
use super::robot::TargetArgs;
use super::settings::SettingsArgs;
use super::{Exit, Failure, block_on, print};
use crate::pilot::Status;
use crate::robot::{MotionEnd, Setpoint};
use crate::safety::WatchdogState;
use crate::script::Calibration;

/// Measure the robot's track width and speed for the config
///
/// Guides you through two moves straight ahead and a turn on the spot, asks how far the robot
/// really went, and computes `calibration:` from your answers. Every step can be repeated. With
/// --sim the simulator does the measuring. Put the robot off its station, on the floor that it will
/// drive on, with two metres free ahead, no stairs and no people in the way. Ctrl-C stops the
/// robot.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Examples:\n  spykee calibrate --robot 172.17.6.1\n  \
                        spykee calibrate --sim --json\n  \
                        spykee calibrate camera --robot 172.17.6.1")]
#[command(args_conflicts_with_subcommands = true)]
pub(super) struct CalibrateArgs {
    #[command(subcommand)]
    what: Option<CalibrateCommand>,

    /// Print a JSON object; questions go to stderr
    #[arg(long)]
    json: bool,

    /// Seed for simulator noise [default: random]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    #[command(flatten)]
    target: TargetArgs,
}

#[derive(Debug, Clone, clap::Subcommand)]
enum CalibrateCommand {
    Camera(camera::CameraArgs),
}

impl CalibrateArgs {
    pub(super) fn settings(&self) -> &SettingsArgs {
        match &self.what {
            Some(CalibrateCommand::Camera(args)) => &args.target.settings,
            None => &self.target.settings,
        }
    }
}

pub(super) fn run(args: &CalibrateArgs) -> Result<Exit, Failure> {
    if let Some(CalibrateCommand::Camera(args)) = &args.what {
        return camera::run(args);
    }
    let seed = args.seed.unwrap_or_else(rand::random);
    let target = args.target.resolve(seed)?;
    let parts = target.driver_parts(seed)?;
    let simulator = target
        .sim
        .as_ref()
        .map(super::embedded::EmbeddedSim::handle);
    let mut measured = None;
    let measuring = drive(parts, async |driver| {
        let round = match &simulator {
            Some(handle) => simulated::round(driver, handle).await?,
            None => person::round(driver, args.json).await?,
        };
        measured = Some(round.calibration()?);
        Ok(Exit::Done)
    });
    let exit = block_on(measuring)??;
    let Some(calibration) = measured else {
        return Ok(exit);
    };
    conclude(args.json, calibration)
}

/// Returns an error with help if the robot may not drive.
pub(super) fn ready(status: Status) -> Result<(), Failure> {
    if status.low {
        let failure = Failure::new(Exit::Safety, "the battery is low: the robot may not drive");
        return Err(failure.help("charge the robot first"));
    }
    if status.safety == WatchdogState::Docked {
        let failure = Failure::new(Exit::Failed, "the robot is on its station");
        return Err(failure.help("`spykee robot undock`, then put it on free floor"));
    }
    Ok(())
}

/// Drives one step. A step that is cut short is an error: it would spoil the measurement.
async fn step(driver: &mut Driver, plan: Plan) -> Result<(), Failure> {
    drive_once(driver, plan.setpoint, plan.duration).await
}

/// Drives once; a motion that is cut short is an error.
pub(super) async fn drive_once(
    driver: &mut Driver,
    setpoint: Setpoint,
    duration: Duration,
) -> Result<(), Failure> {
    ready(driver.status())?;
    let end = driver.run(setpoint, duration).await?;
    let (exit, help) = match end {
        MotionEnd::Done => return Ok(()),
        MotionEnd::Safety => (Exit::Safety, "charge the robot first"),
        MotionEnd::Disconnected => (
            Exit::Unreachable,
            "is the robot still in reach of its Wi-Fi?",
        ),
        _ => (Exit::Failed, "start again, on free floor"),
    };
    let what = format_args!("the move was cut short: {end}");
    Err(Failure::new(exit, what).help(help))
}

fn conclude(json: bool, calibration: Calibration) -> Result<Exit, Failure> {
    let Calibration {
        track_width,
        full_speed,
    } = calibration;
    if json {
        let object = json!({ "track_width": track_width, "full_speed": full_speed });
        print(&format!("{object}\n"))?;
    } else {
        // Measurements are no more precise than a tenth of a millimetre.
        print(&format!(
            "\ncalibration: {{ track_width: {track_width:.4}, full_speed: {full_speed:.4} }}\n\
             Paste this line into your config, in place of its `calibration:` if it has one.\n"
        ))?;
    }
    Ok(Exit::Done)
}
