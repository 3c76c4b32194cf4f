//! `spykee robot`: single commands to the robot from the shell. Commands that move it go through
//! the pilot and its watchdog; others are sent over a plain link.

mod act;
mod ask;
mod session;
mod settings;
mod snapshot;
mod station;
mod stop;
mod upload;

pub(super) use session::RobotSession;
pub(super) use snapshot::{video, with_pictures};

use clap::Subcommand;

use super::driver::{Driver, drive_target};
use super::running::SharedTargetArgs;
use super::settings::CommandSettings;
use super::{ConnectionArgs, Console, Exit, Failure};

#[derive(Debug, Clone, Subcommand)]
pub(super) enum RobotCommand {
    /// Print the robot's id, names, firmware, battery and station
    #[command(after_help = "Example: spykee robot info --robot 172.17.6.1 --json")]
    Info(ask::ReportArgs),
    /// Print the battery level and whether it charges
    #[command(after_help = "Example: spykee robot battery --robot 172.17.6.1")]
    Battery(ask::ReportArgs),
    Dock(station::DockArgs),
    Undock(station::UndockArgs),
    Stop(stop::StopArgs),
    /// Release STOP, so that the robot may move again
    ///
    /// STOP, pressed at the page, through the API, a broker or with `spykee robot stop`, holds until a
    /// person releases it, also in later programs of the same data folder. This releases it in all
    /// runs and services of the data folder, or only in the one that uses the robot of --robot; with
    /// --url in the service there; without any, what an earlier program has left behind in the data
    /// folder.
    #[command(after_help = "Example: spykee robot reset-stop")]
    ResetStop(SharedTargetArgs),
    Led(act::LedArgs),
    Play(act::PlayArgs),
    Volume(act::VolumeArgs),
    Say(act::SayArgs),
    Snapshot(snapshot::SnapshotArgs),
    Log(ask::LogArgs),
    /// Print the robot's settings, or change them with --set
    ///
    /// The settings are not documented. Only settings that the robot lists itself can be changed,
    /// and a wrong value may leave it unreachable. Keys and passwords are shown as ***.
    #[command(
        after_help = "Examples:\n  spykee robot config --robot 172.17.6.1 --json\n  \
                      spykee robot config --set name=Anna --robot 172.17.6.1"
    )]
    Config(settings::SettingArgs),
    /// List the wireless networks that the robot sees, and its own network settings
    ///
    /// How to make the robot join a network is not documented; --set changes network settings that
    /// the robot lists itself. A wrong value may leave it unreachable until it is reset.
    #[command(after_help = "Example: spykee robot wifi --robot 172.17.6.1")]
    Wifi(settings::SettingArgs),
    UploadSound(upload::UploadArgs),
}

pub(super) fn run(
    command: &RobotCommand,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    match command {
        RobotCommand::Info(args) => ask::info(args, settings),
        RobotCommand::Battery(args) => ask::battery(args, settings),
        RobotCommand::Dock(args) => station::dock(args, settings),
        RobotCommand::Undock(args) => station::undock(args, settings),
        RobotCommand::Stop(args) => stop::stop(args, settings),
        RobotCommand::ResetStop(args) => stop::reset_stop(args, settings),
        RobotCommand::Led(args) => act::led(args, settings),
        RobotCommand::Play(args) => act::play(args, settings),
        RobotCommand::Volume(args) => act::volume(args, settings),
        RobotCommand::Say(args) => act::say(args, settings),
        RobotCommand::Snapshot(args) => snapshot::snapshot(args, settings),
        RobotCommand::Log(args) => ask::log(args, settings),
        RobotCommand::Config(args) => settings::config(args, settings),
        RobotCommand::Wifi(args) => settings::wifi(args, settings),
        RobotCommand::UploadSound(args) => upload::upload(args, settings, console),
    }
}

/// Drives the robot that the flags or the config name: see [`drive_target`].
fn drive_robot(
    connection: &ConnectionArgs,
    settings: &CommandSettings,
    job: impl AsyncFnOnce(&mut Driver) -> Result<Exit, Failure>,
) -> Result<Exit, Failure> {
    let seed = rand::random();
    let target = connection.resolve(settings, seed)?;
    drive_target(&target, seed, job)
}
