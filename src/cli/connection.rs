//! The flags that name the robot and the login: shared by all subcommands that drive one.

use std::path::{Path, PathBuf};

use super::world_name::WorldParser;
use super::{Failure, secret};
use crate::config::{Effective, Named};
use crate::link::Target;
use crate::wire::Login;

/// The robot's own default, for user and password (`PROTOCOL.md`, AUTH_REQUEST).
const DEFAULT_LOGIN: &str = "admin";
/// The protocol's one-byte length prefix.
const MAX_LOGIN_CHARS: usize = 255;

/// Which robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RobotChoice {
    /// One on the network.
    Robot(Target),
    /// A simulated one inside this program, in this world or the built-in one.
    Sim(Option<PathBuf>),
}

/// `--robot` or `--sim`, and the login.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Connection")]
pub struct ConnectionArgs {
    /// The robot's address [default port: 9000]
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with = "sim")]
    pub robot: Option<Target>,

    /// Use a simulated robot, in the built-in living room, another built-in world or a world file
    #[arg(long, value_name = "WORLD", num_args = 0..=1, value_parser = WorldParser, hide_possible_values = true)]
    pub sim: Option<Option<PathBuf>>,

    #[command(flatten)]
    #[allow(missing_docs)]
    pub login: LoginArgs,
}

/// User and password.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Connection")]
pub struct LoginArgs {
    /// Log in as this user [default: admin]
    #[arg(long, value_name = "NAME")]
    pub user: Option<String>,

    /// Read the password from the first line of this file [default: $SPYKEE_PASSWORD, or else the
    /// config's password_file, or else admin]
    #[arg(long, value_name = "FILE")]
    pub password_file: Option<PathBuf>,
}

impl ConnectionArgs {
    /// Which robot was asked for; `None` leaves it to the config.
    pub fn place(&self) -> Option<RobotChoice> {
        let robot = self.robot.clone().map(RobotChoice::Robot);
        robot.or_else(|| self.sim.clone().map(RobotChoice::Sim))
    }

    /// In `--sim patrol.lua` the file is meant as a behaviour, not as a world: takes it out.
    pub fn take_misplaced_behaviour(&mut self) -> Option<PathBuf> {
        let world = self.sim.as_mut()?;
        let extension = world.as_deref().and_then(Path::extension);
        let is_script = extension.is_some_and(|ext| ext == "lua" || ext == "luau");
        if is_script { world.take() } else { None }
    }
}

impl LoginArgs {
    /// User and password: flags over the environment over the config's file over the robot's own
    /// default.
    ///
    /// # Errors
    /// A password file that cannot be read or is empty, or that a config names which was found and
    /// not named and may not; a name or password that the robot cannot know. The password is not
    /// shown.
    pub(super) fn login(&self, settings: &Effective) -> Result<Login, Failure> {
        let config = &settings.config;
        let user = self.user.as_deref().or(config.user.as_deref());
        let user = user.unwrap_or(DEFAULT_LOGIN);
        sendable("the user's name", user)?;
        let password = self.password(settings)?;
        sendable("the password", &password)?;
        Ok(Login::new(user, password))
    }

    /// As [`LoginArgs::login`], without a config.
    ///
    /// # Errors
    /// The same.
    pub(super) fn login_without_config(&self) -> Result<Login, Failure> {
        self.login(&Effective::default())
    }

    fn password(&self, settings: &Effective) -> Result<String, Failure> {
        if let Some(path) = &self.password_file {
            return secret::of_chosen_file(path);
        }
        if let Some(password) = secret::of_environment()? {
            return Ok(password);
        }
        if let Some(password) = secret::of_credential()? {
            return Ok(password);
        }
        let Some(path) = &settings.config.password_file else {
            return Ok(DEFAULT_LOGIN.to_owned());
        };
        match settings.file_of("password_file") {
            None => secret::of_chosen_file(path),
            Some((config, Named::Found)) => secret::of_found_file(path, config),
            Some((_, Named::Chosen)) => secret::of_named_file(path),
        }
    }
}

/// The protocol carries ISO-8859-1 with a one-byte length; anything else would arrive changed.
fn sendable(what: &str, text: &str) -> Result<(), Failure> {
    if text.chars().count() > MAX_LOGIN_CHARS {
        return Err(Failure::usage(format_args!(
            "{what} is longer than {MAX_LOGIN_CHARS} characters"
        )));
    }
    if text.chars().any(|c| u32::from(c) > u32::from(u8::MAX)) {
        let failure = Failure::usage(format_args!(
            "{what} has a character that the robot does not know"
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
    fn a_robot_or_a_simulator_or_what_the_config_says_but_not_both() {
        let place = |args| parse(args).unwrap().place();
        let robot = "172.17.6.1".parse().unwrap();
        assert_eq!(
            place(&["--robot", "172.17.6.1"]),
            Some(RobotChoice::Robot(robot))
        );
        assert_eq!(place(&["--sim"]), Some(RobotChoice::Sim(None)));
        let world = Some(PathBuf::from("w.yaml"));
        assert_eq!(place(&["--sim", "w.yaml"]), Some(RobotChoice::Sim(world)));
        assert_eq!(place(&[]), None);
        assert!(parse(&["--sim", "--robot", "172.17.6.1"]).is_err());
    }

    #[test]
    fn an_address_that_is_none_is_refused_with_what_was_expected() {
        let error = parse(&["--robot", "http://robot"]).unwrap_err();
        assert!(
            error.to_string().contains("expected HOST[:PORT]"),
            "{error}"
        );
    }

    #[test]
    fn a_behaviour_behind_sim_is_not_taken_for_a_world() {
        let mut args = parse(&["--sim", "patrol.lua"]).unwrap();
        assert_eq!(args.take_misplaced_behaviour(), Some("patrol.lua".into()));
        assert_eq!(args.place(), Some(RobotChoice::Sim(None)));
        let mut args = parse(&["--sim", "room.yaml"]).unwrap();
        assert_eq!(args.take_misplaced_behaviour(), None);
        assert_eq!(
            args.place(),
            Some(RobotChoice::Sim(Some("room.yaml".into())))
        );
        assert_eq!(parse(&[]).unwrap().take_misplaced_behaviour(), None);
    }
}
