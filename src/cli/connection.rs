//! The flags that say which robot, as whom: shared by all subcommands that drive one.

use std::io::Read;
use std::path::{Path, PathBuf};

use super::Failure;
use super::world_name::WorldParser;
use crate::config::Config;
use crate::link::Target;
use crate::wire::Login;

/// Where the password is looked for when no file is named.
const PASSWORD_VARIABLE: &str = "SPYKEE_PASSWORD";
/// The robot's own default, for user and password (`PROTOCOL.md`, AUTH_REQUEST).
const DEFAULT_LOGIN: &str = "admin";
/// The protocol's one-byte length prefix.
const MAX_LOGIN_CHARS: usize = 255;
/// No password file is longer.
const MAX_PASSWORD_FILE_LEN: u64 = 4096;

/// Which robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// One on the network.
    Robot(Target),
    /// A simulated one inside this program, in this world or the built-in one.
    Sim(Option<PathBuf>),
}

/// `--robot` or `--sim`, and the login.
#[derive(Debug, Clone, clap::Args)]
#[command(next_help_heading = "Connection")]
pub struct ConnectionArgs {
    /// The robot's address; the port is 9000 unless given
    #[arg(long, value_name = "HOST[:PORT]", conflicts_with = "sim")]
    pub robot: Option<Target>,

    /// Drive a simulated robot, in the built-in world or the one of a YAML file
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

    /// Read the password from the first line of this file. Without it the password is
    /// $SPYKEE_PASSWORD, or else admin
    #[arg(long, value_name = "FILE")]
    pub password_file: Option<PathBuf>,
}

impl ConnectionArgs {
    /// Which robot was asked for; `None` leaves it to the config.
    pub fn place(&self) -> Option<Place> {
        let robot = self.robot.clone().map(Place::Robot);
        robot.or_else(|| self.sim.clone().map(Place::Sim))
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
    /// What the flags leave open comes from the config.
    pub fn or_from(&self, config: &Config) -> LoginArgs {
        LoginArgs {
            user: self.user.clone().or_else(|| config.user.clone()),
            password_file: self
                .password_file
                .clone()
                .or_else(|| config.password_file.clone()),
        }
    }

    /// User and password, from flags and environment.
    ///
    /// # Errors
    /// A password file that cannot be read or is empty; a name or password that the robot cannot
    /// know. The password is not shown.
    pub fn login(&self) -> Result<Login, Failure> {
        let user = self.user.as_deref().unwrap_or(DEFAULT_LOGIN);
        sendable("the user's name", user)?;
        let password = match &self.password_file {
            Some(path) => read_password(path)?,
            None => password_from_environment()?,
        };
        sendable("the password", &password)?;
        Ok(Login::new(user, password))
    }
}

fn password_from_environment() -> Result<String, Failure> {
    match std::env::var(PASSWORD_VARIABLE) {
        Ok(password) => Ok(password),
        Err(std::env::VarError::NotPresent) => Ok(DEFAULT_LOGIN.to_owned()),
        // Its text would show the password.
        Err(std::env::VarError::NotUnicode(_)) => Err(Failure::usage(format_args!(
            "{PASSWORD_VARIABLE} is not UTF-8"
        ))),
    }
}

fn read_password(path: &Path) -> Result<String, Failure> {
    let shown = path.display();
    let cannot = |error: std::io::Error| {
        Failure::usage(format_args!(
            "cannot read the password file {shown}: {error}"
        ))
        .help("write the password into its first line")
    };
    let file = std::fs::File::open(path).map_err(cannot)?;
    warn_if_others_can_read(&file, path);
    let mut text = String::new();
    file.take(MAX_PASSWORD_FILE_LEN)
        .read_to_string(&mut text)
        .map_err(cannot)?;
    let first = text.lines().next().unwrap_or_default();
    if first.is_empty() {
        let failure = Failure::usage(format_args!("the first line of {shown} is empty"));
        return Err(failure.help("write the password into its first line"));
    }
    Ok(first.to_owned())
}

fn warn_if_others_can_read(file: &std::fs::File, path: &Path) {
    use std::os::unix::fs::PermissionsExt;
    const OTHERS: u32 = 0o077;
    let mode = file
        .metadata()
        .map_or(0, |metadata| metadata.permissions().mode());
    if mode & OTHERS != 0 {
        let path = path.display();
        tracing::warn!("others can read the password file {path}: chmod 600 {path}");
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
        assert_eq!(place(&["--robot", "172.17.6.1"]), Some(Place::Robot(robot)));
        assert_eq!(place(&["--sim"]), Some(Place::Sim(None)));
        let world = Some(PathBuf::from("w.yaml"));
        assert_eq!(place(&["--sim", "w.yaml"]), Some(Place::Sim(world)));
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
        assert_eq!(args.place(), Some(Place::Sim(None)));
        let mut args = parse(&["--sim", "room.yaml"]).unwrap();
        assert_eq!(args.take_misplaced_behaviour(), None);
        assert_eq!(args.place(), Some(Place::Sim(Some("room.yaml".into()))));
        assert_eq!(parse(&[]).unwrap().take_misplaced_behaviour(), None);
    }
}
