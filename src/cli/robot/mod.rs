//! `spykee robot`: single commands to the robot from the shell. Commands that move it go through
//! the pilot and its watchdog; others are sent over a plain link.

mod act;
mod ask;
mod say;
mod session;
mod settings;
mod snapshot;
mod station;
mod stop;
mod upload;
mod wav;

pub(super) use session::send_home_if_low;
pub(super) use snapshot::with_picture;

use std::ops::Deref;

use clap::Subcommand;

use super::driver::DriverParts;
use super::embedded::{EmbeddedSim, Simulated};
use super::robot_target::{ChosenRobot, connector};
use super::running::RemoteArgs;
use super::running::{find_run, find_service};
use super::settings::SettingsArgs;
use super::startup::{refuse_if_stopped, rescue};
use super::{ConnectionArgs, Console, Exit, Failure};
use crate::config::Config;
use crate::control::Client;
use crate::link::{self, Target};
use crate::wire::{self, Login};

/// Send the robot a single command: battery, docking, lights, a picture, its settings
///
/// The watchdog handles a low battery, the station and a dead link as in a run. The robot serves
/// one user at a time. If that is a `spykee run` of the same data folder, then battery, info,
/// snapshot, dock, undock, stop, reset-stop, led, play, volume and say go through it; without
/// --robot they address the only active run, stop and reset-stop all of them. With --url they go through a service on another
/// computer. If any other program uses the robot, end it first.
#[derive(Debug, Clone, clap::Args)]
#[command(
    subcommand_required = true,
    arg_required_else_help = true,
    after_help = "Examples:\n  spykee robot battery --robot 172.17.6.1\n  spykee robot stop --robot 172.17.6.1\n  spykee robot snapshot -o room.jpg --sim"
)]
pub(super) struct RobotArgs {
    #[command(subcommand)]
    command: RobotCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum RobotCommand {
    Info(ask::InfoArgs),
    Battery(ask::BatteryArgs),
    Dock(station::DockArgs),
    Undock(station::UndockArgs),
    Stop(stop::StopArgs),
    ResetStop(stop::ResetStopArgs),
    Led(act::LedArgs),
    Play(act::PlayArgs),
    Volume(act::VolumeArgs),
    Say(say::SayArgs),
    Snapshot(snapshot::SnapshotArgs),
    Log(ask::LogArgs),
    Config(settings::ConfigArgs),
    Wifi(settings::WifiArgs),
    UploadSound(upload::UploadArgs),
}

impl RobotArgs {
    /// The settings of the chosen subcommand.
    pub(super) fn settings(&self) -> &SettingsArgs {
        use RobotCommand as C;
        let target: &TargetArgs = match &self.command {
            C::Info(args) => &args.target,
            C::Battery(args) => &args.target,
            C::Dock(args) => &args.target,
            C::Undock(args) => &args.target,
            C::Stop(args) => &args.target,
            C::ResetStop(args) => &args.target,
            C::Led(args) => &args.target,
            C::Play(args) => &args.target,
            C::Volume(args) => &args.target,
            C::Say(args) => &args.target,
            C::Snapshot(args) => &args.target,
            C::Log(args) => &args.target,
            C::Config(args) => &args.change.target,
            C::Wifi(args) => &args.change.target,
            C::UploadSound(args) => &args.target,
        };
        &target.settings
    }
}

/// Runs the subcommand.
///
/// # Errors
/// An invalid command line, a robot that cannot be reached, or an unexpected reply.
pub(super) fn run(args: &RobotArgs, console: &Console) -> Result<Exit, Failure> {
    match &args.command {
        RobotCommand::Info(args) => ask::info(args),
        RobotCommand::Battery(args) => ask::battery(args),
        RobotCommand::Dock(args) => station::dock(args),
        RobotCommand::Undock(args) => station::undock(args),
        RobotCommand::Stop(args) => stop::stop(args),
        RobotCommand::ResetStop(args) => stop::reset_stop(args),
        RobotCommand::Led(args) => act::led(args),
        RobotCommand::Play(args) => act::play(args),
        RobotCommand::Volume(args) => act::volume(args),
        RobotCommand::Say(args) => say::say(args),
        RobotCommand::Snapshot(args) => snapshot::snapshot(args),
        RobotCommand::Log(args) => ask::log(args),
        RobotCommand::Config(args) => settings::config(args),
        RobotCommand::Wifi(args) => settings::wifi(args),
        RobotCommand::UploadSound(args) => upload::upload(args, console),
    }
}

/// Selects the robot, the login and the settings.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct TargetArgs {
    #[command(flatten)]
    pub(in crate::cli) settings: SettingsArgs,

    #[command(flatten)]
    pub(super) connection: ConnectionArgs,
}

/// The same, for commands that can also go through a run or service that uses the robot.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct SharedTargetArgs {
    #[command(flatten)]
    alone: TargetArgs,

    #[command(flatten)]
    remote: RemoteArgs,
}

impl Deref for SharedTargetArgs {
    type Target = TargetArgs;

    fn deref(&self) -> &TargetArgs {
        &self.alone
    }
}

/// A robot to connect to. A simulator ends when this is dropped.
pub(super) struct RobotTarget {
    pub(super) address: Target,
    pub(super) login: Login,
    pub(super) config: Config,
    pub(super) sim: Option<EmbeddedSim>,
}

impl SharedTargetArgs {
    /// The active run or the service that uses the chosen robot, if any.
    ///
    /// # Errors
    /// See [`find_run`].
    pub(super) fn find_run(&self) -> Result<Option<Client>, Failure> {
        find_run(&self.settings, &self.connection, &self.remote)
    }

    /// The service on another computer that the command line or the config names, if any.
    ///
    /// # Errors
    /// See [`find_service`].
    fn find_service(&self) -> Result<Option<Client>, Failure> {
        find_service(&self.settings, &self.connection, &self.remote)
    }
}

impl TargetArgs {
    /// Resolves flags and config, and starts the simulator if requested.
    ///
    /// # Errors
    /// A config, login or world that cannot be used; no robot named.
    pub(super) fn resolve(&self, seed: u64) -> Result<RobotTarget, Failure> {
        let mut config = self.settings.config()?.clone();
        let robot = ChosenRobot::required(ChosenRobot::load(&self.connection, &mut config)?)?;
        let login = self.connection.login.login(self.settings.load()?)?;
        let (address, sim) = robot.start(&login, seed, Simulated::default())?;
        Ok(RobotTarget {
            address,
            login,
            config,
            sim,
        })
    }
}

impl RobotTarget {
    /// Logs in once.
    ///
    /// # Errors
    /// Every kind of [`link::LinkError`].
    pub(super) async fn connect(&self) -> Result<link::Session, link::LinkError> {
        link::connect(
            &self.address,
            &self.login,
            vec![wire::Command::STOP],
            &link::Options::default(),
        )
        .await
    }

    /// The parts needed to drive the robot.
    ///
    /// # Errors
    /// A person's STOP holds; the rescue behaviour of the config cannot be read.
    pub(super) fn driver_parts(&self, seed: u64) -> Result<DriverParts, Failure> {
        refuse_if_stopped(&self.config, self.sim.is_some())?;
        Ok(DriverParts {
            connector: connector(self.address.clone(), self.login.clone()),
            settings: self.config.pilot(self.sim.is_some(), seed),
            rescue: rescue(&self.config, seed)?,
        })
    }
}
