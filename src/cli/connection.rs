//! The flags for the robot and the login, shared by all subcommands that connect to a robot, and
//! the robot that they name.

use std::path::{Path, PathBuf};

use super::settings::CommandSettings;
use super::startup::{driving_core, heartbeat, launcher, refuse_if_stopped, rescue};
use super::world::{EmbeddedSim, load};
use super::{Failure, secret};
use crate::agent::{Bus, PilotPlan};
use crate::config::{Config, Effective};
use crate::guardian::GuardianFiles;
use crate::link::{self, LinkError, Session, Target};
use crate::pilot::{Connector, DrivingCore};
use crate::sim::{self, World};
use crate::wire::{Command, Login};

/// The robot's own default, for user and password (`PROTOCOL.md`, AUTH_REQUEST).
const DEFAULT_LOGIN: &str = "admin";
/// The protocol's one-byte length prefix.
const MAX_LOGIN_CHARS: usize = 255;

#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Connection")]
pub struct ConnectionArgs {
    /// Robot's address [default port: 9000]
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with = "sim")]
    pub robot: Option<Target>,

    /// Use a simulated robot, in a built-in world or a world file [default: living_room]
    #[arg(long, value_name = "WORLD", num_args = 0..=1)]
    pub sim: Option<Option<PathBuf>>,

    #[command(flatten)]
    pub login: LoginArgs,
}

#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Connection")]
pub struct LoginArgs {
    /// User name for the login [default: admin]
    #[arg(long, value_name = "NAME")]
    pub user: Option<String>,

    /// File with the password in its first line [default: $SPYKEE_PASSWORD, or else the config's
    /// password_file, or else the password admin]
    #[arg(long, value_name = "FILE")]
    pub password_file: Option<PathBuf>,
}

impl ConnectionArgs {
    /// The robot of the flags, or else of the config; `None` if neither names one. What is known of
    /// a simulated robot enters the config.
    pub(super) fn choose(&self, config: &mut Config) -> Result<Option<ChosenRobot>, Failure> {
        if let Some(world) = &self.sim {
            let world = load(world.as_deref())?;
            *config = std::mem::take(config).with_robot_of(&world);
            return Ok(Some(ChosenRobot::Sim(world.into())));
        }
        let robot = self.robot.as_ref().or(config.robot.as_ref());
        Ok(robot.cloned().map(ChosenRobot::Robot))
    }

    /// Resolves flags and config, and starts the simulator if requested.
    pub(super) fn resolve(
        &self,
        settings: &CommandSettings,
        seed: u64,
    ) -> Result<RobotTarget, Failure> {
        let mut config = settings.config()?.clone();
        let robot = self.choose(&mut config)?.ok_or_else(no_robot)?;
        let login = self.login.login(settings.load()?)?;
        let options = sim::Options {
            login,
            seed,
            ..sim::Options::default()
        };
        robot.start(config, options)
    }

    /// Removes and returns the file of `--sim patrol.lua`, which is a behaviour, not a world.
    pub fn take_misplaced_behaviour(&mut self) -> Option<PathBuf> {
        let world = self.sim.as_mut()?;
        let extension = world.as_deref().and_then(Path::extension);
        let is_script = extension.is_some_and(|ext| ext == "lua" || ext == "luau");
        if is_script { world.take() } else { None }
    }
}

impl LoginArgs {
    /// User and password: flags override the environment, which overrides systemd's credential (the
    /// password), which overrides the config, which overrides the robot's default.
    pub(super) fn login(&self, settings: &Effective) -> Result<Login, Failure> {
        let config = &settings.config;
        let user = self.user.as_deref().or(config.user.as_deref());
        let user = user.unwrap_or(DEFAULT_LOGIN);
        sendable("the user's name", user)?;
        let password = self.password(settings)?;
        sendable("the password", &password)?;
        Ok(Login::new(user, password))
    }

    fn password(&self, settings: &Effective) -> Result<String, Failure> {
        if let Some(path) = &self.password_file {
            return secret::from_chosen_file(path);
        }
        if let Some(password) = secret::from_environment()? {
            return Ok(password);
        }
        if let Some(password) = secret::from_credential()? {
            return Ok(password);
        }
        let file = settings.config.password_file.as_deref();
        let password = secret::from_optional_file(file, settings.found_file())?;
        Ok(password.unwrap_or_else(|| DEFAULT_LOGIN.to_owned()))
    }
}

/// The robot that is meant, with the world of a simulated one.
pub(super) enum ChosenRobot {
    Robot(Target),
    Sim(Box<World>),
}

pub(super) fn no_robot() -> Failure {
    Failure::usage("which robot? neither --robot nor --sim was given").help(
        "--sim uses a simulated robot; --robot HOST[:PORT] uses yours (`spykee discover` finds it)",
    )
}

impl ChosenRobot {
    pub(super) fn is_simulated(&self) -> bool {
        matches!(self, ChosenRobot::Sim(_))
    }

    /// Refuses a flag for a real robot; `why` names it.
    pub(super) fn refuse_if_real(&self, is_given: bool, why: &str) -> Result<(), Failure> {
        if self.is_simulated() || !is_given {
            return Ok(());
        }
        Err(Failure::usage(why).help("--sim [WORLD] runs on a simulated robot"))
    }

    pub(super) fn into_world(self) -> Result<World, Failure> {
        self.refuse_if_real(true, "--fast needs --sim: a real robot runs in real time")?;
        match self {
            ChosenRobot::Sim(world) => Ok(*world),
            ChosenRobot::Robot(_) => Err(no_robot()),
        }
    }

    /// Starts a simulated robot with these options; a real one has only their login.
    pub(super) fn start(
        self,
        config: Config,
        options: sim::Options,
    ) -> Result<RobotTarget, Failure> {
        let login = options.login.clone();
        let (address, sim) = match self {
            ChosenRobot::Robot(target) => (target, None),
            ChosenRobot::Sim(world) => {
                let sim = EmbeddedSim::start(*world, options)?;
                (sim.target(), Some(sim))
            }
        };
        Ok(RobotTarget {
            address,
            login,
            config,
            sim,
        })
    }
}

/// A robot to connect to. A simulator ends when this is dropped.
pub(super) struct RobotTarget {
    pub(super) address: Target,
    pub(super) login: Login,
    pub(super) config: Config,
    pub(super) sim: Option<EmbeddedSim>,
}

impl RobotTarget {
    pub(super) async fn connect(&self) -> Result<Session, LinkError> {
        let stop = vec![Command::STOP];
        link::connect(&self.address, &self.login, stop, &link::Options::default()).await
    }

    pub(super) fn connector(&self) -> Connector {
        connector(self.address.clone(), self.login.clone())
    }

    /// How to drive the robot on this core, with a guardian that uses these files.
    pub(super) fn pilot_plan(
        &self,
        core: &DrivingCore,
        files: GuardianFiles,
        seed: u64,
    ) -> Result<PilotPlan, Failure> {
        let simulated = self.sim.is_some();
        Ok(PilotPlan {
            settings: self.config.pilot(simulated, seed),
            connector: self.connector(),
            launcher: launcher()?,
            core: core.handle().clone(),
            rescue: rescue(&self.config, seed)?,
            heartbeat: Some(heartbeat(simulated, files)?),
            bus: Bus::default(),
        })
    }

    /// The same for a tool, on a core of its own, which must outlive the pilot. Refused while a
    /// person's STOP holds.
    pub(super) fn driver_plan(&self, seed: u64) -> Result<(DrivingCore, PilotPlan), Failure> {
        refuse_if_stopped(&self.config, self.sim.is_some())?;
        let core = driving_core()?;
        let plan = self.pilot_plan(&core, GuardianFiles::default(), seed)?;
        Ok((core, plan))
    }
}

pub(super) fn connector(target: Target, login: Login) -> Connector {
    Box::new(move |supervision| {
        let target = target.clone();
        let login = login.clone();
        let options = link::Options::default();
        Box::pin(async move { link::connect(&target, &login, supervision, &options).await })
    })
}

/// Refuses text that the protocol would change: it carries ISO-8859-1 with a one-byte length.
fn sendable(what: &str, text: &str) -> Result<(), Failure> {
    if text.chars().count() > MAX_LOGIN_CHARS {
        return Err(Failure::usage(format_args!(
            "{what} is longer than {MAX_LOGIN_CHARS} characters"
        )));
    }
    if text.chars().any(|c| u32::from(c) > u32::from(u8::MAX)) {
        let failure = Failure::usage(format_args!(
            "{what} has a character that the robot does not support"
        ));
        return Err(failure.help("use letters of western European languages, digits and signs"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Debug, Parser)]
    struct Cli {
        #[command(flatten)]
        connection: ConnectionArgs,
    }

    fn parse(args: &[&str]) -> Result<ConnectionArgs, clap::Error> {
        let args = std::iter::once("spykee").chain(args.iter().copied());
        Cli::try_parse_from(args).map(|cli| cli.connection)
    }

    #[test]
    fn robot_and_sim_exclude_each_other() {
        let choice = |args| parse(args).map(|args| (args.robot, args.sim)).unwrap();
        let robot = Some("172.17.6.1".parse().unwrap());
        assert_eq!(choice(&["--robot", "172.17.6.1"]), (robot, None));
        assert_eq!(choice(&["--sim"]), (None, Some(None)));
        let world = Some(PathBuf::from("w.yaml"));
        assert_eq!(choice(&["--sim", "w.yaml"]), (None, Some(world)));
        assert_eq!(choice(&[]), (None, None));
        assert!(parse(&["--sim", "--robot", "172.17.6.1"]).is_err());
    }

    #[test]
    fn the_error_for_an_invalid_address_names_the_expected_form() {
        let error = parse(&["--robot", "http://robot"]).unwrap_err();
        assert!(
            error.to_string().contains("expected HOST[:PORT]"),
            "{error}"
        );
    }

    #[test]
    fn a_behaviour_after_sim_is_not_taken_for_a_world() {
        let mut args = parse(&["--sim", "patrol.lua"]).unwrap();
        assert_eq!(args.take_misplaced_behaviour(), Some("patrol.lua".into()));
        assert_eq!(args.sim, Some(None));
        let mut args = parse(&["--sim", "room.yaml"]).unwrap();
        assert_eq!(args.take_misplaced_behaviour(), None);
        assert_eq!(args.sim, Some(Some("room.yaml".into())));
        assert_eq!(parse(&[]).unwrap().take_misplaced_behaviour(), None);
    }
}
