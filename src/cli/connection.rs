//! The flags for the robot and the login, shared by all subcommands that connect to a robot.

use std::path::{Path, PathBuf};

use super::world::WorldParser;
use super::{Failure, secret};
use crate::config::Effective;
use crate::link::Target;
use crate::wire::Login;

/// The robot's own default, for user and password (`PROTOCOL.md`, AUTH_REQUEST).
const DEFAULT_LOGIN: &str = "admin";
/// The protocol's one-byte length prefix.
const MAX_LOGIN_CHARS: usize = 255;

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RobotChoice {
    Robot(Target),
    /// A simulated robot inside this program, in this world or the default one.
    Sim(Option<PathBuf>),
}

/// `--robot` or `--sim`, and the login.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Connection")]
pub struct ConnectionArgs {
    /// Robot's address [default port: 9000]
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with = "sim")]
    pub robot: Option<Target>,

    /// Use a simulated robot, in a built-in world or a world file [default: living_room]
    #[arg(long, value_name = "WORLD", num_args = 0..=1, value_parser = WorldParser, hide_possible_values = true)]
    pub sim: Option<Option<PathBuf>>,

    #[command(flatten)]
    pub login: LoginArgs,
}

/// User and password.
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
    /// The robot named by the flags; `None` leaves it to the config.
    pub fn robot(&self) -> Option<RobotChoice> {
        let robot = self.robot.clone().map(RobotChoice::Robot);
        robot.or_else(|| self.sim.clone().map(RobotChoice::Sim))
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

    /// Like [`LoginArgs::login`], without a config.
    pub(super) fn login_without_config(&self) -> Result<Login, Failure> {
        self.login(&Effective::default())
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
        let Some(path) = &settings.config.password_file else {
            return Ok(DEFAULT_LOGIN.to_owned());
        };
        secret::from_configured_file(path, settings.found_file())
    }
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
        let choice = |args| parse(args).unwrap().robot();
        let robot = "172.17.6.1".parse().unwrap();
        assert_eq!(
            choice(&["--robot", "172.17.6.1"]),
            Some(RobotChoice::Robot(robot))
        );
        assert_eq!(choice(&["--sim"]), Some(RobotChoice::Sim(None)));
        let world = Some(PathBuf::from("w.yaml"));
        assert_eq!(choice(&["--sim", "w.yaml"]), Some(RobotChoice::Sim(world)));
        assert_eq!(choice(&[]), None);
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
        assert_eq!(args.robot(), Some(RobotChoice::Sim(None)));
        let mut args = parse(&["--sim", "room.yaml"]).unwrap();
        assert_eq!(args.take_misplaced_behaviour(), None);
        assert_eq!(
            args.robot(),
            Some(RobotChoice::Sim(Some("room.yaml".into())))
        );
        assert_eq!(parse(&[]).unwrap().take_misplaced_behaviour(), None);
    }
}
