//! How the program ends, in numbers for scripts and in words for people.

use std::process::ExitCode;

use crate::link::LinkError;

/// The exit codes. Their numbers are a promise to scripts that call `spykee`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    /// All done.
    Done = 0,
    /// A behaviour failed.
    Script = 1,
    /// The command line, the config, a world or another file cannot be used.
    Usage = 2,
    /// No robot in reach, or it does not let us in.
    Unreachable = 3,
    /// A check or a test of a behaviour failed.
    Check = 4,
    /// At the end the watchdog had the robot: its battery is low.
    Safety = 5,
    /// Ended by a person or the system: SIGINT, SIGTERM.
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> ExitCode {
        ExitCode::from(exit as u8)
    }
}

/// What went wrong, and what the person can do about it.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct Failure {
    /// The exit code.
    pub exit: Exit,
    /// What happened, and where; no full stop.
    pub what: String,
    /// What to do.
    pub help: Option<String>,
}

impl Failure {
    /// Of an exit code and what happened.
    pub fn new(exit: Exit, what: impl std::fmt::Display) -> Failure {
        Failure {
            exit,
            what: what.to_string(),
            help: None,
        }
    }

    /// A command line, config or file that cannot be used.
    pub fn usage(what: impl std::fmt::Display) -> Failure {
        Failure::new(Exit::Usage, what)
    }

    /// With what to do.
    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Failure {
        Failure {
            help: Some(help.into()),
            ..self
        }
    }

    /// As it stands on stderr.
    pub fn report(&self) -> String {
        match &self.help {
            Some(help) => format!("error: {}\nhelp: {help}", self.what),
            None => format!("error: {}", self.what),
        }
    }
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Failure {
        Failure::new(Exit::Unreachable, &error).help(error.help())
    }
}
