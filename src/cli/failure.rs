//! Exit codes for scripts, and error messages for people.

use std::fmt::Display;
use std::path::Path;
use std::process::ExitCode;

use crate::link::LinkError;

/// The exit codes. Their numbers are stable: scripts that call `spykee` rely on them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Exit {
    Done = 0,
    /// A behaviour failed, the robot did not carry out a command, or the system refused a file, a
    /// socket or a process.
    Failed = 1,
    /// The command line, or a config, world or other file that the command needs, cannot be used.
    Usage = 2,
    /// The robot, a run, a service or a broker cannot be reached or refused the login, or `doctor`
    /// found a problem.
    Unreachable = 3,
    /// A check or a test of a behaviour, a config or a world failed, a notification was not
    /// delivered, or a robot did not carry out a command of `fleet`.
    Check = 4,
    /// The run ended while the watchdog controlled the robot because of a low battery, or a
    /// person's STOP forbids driving.
    Safety = 5,
    /// Ended by a signal from a person or the system: SIGINT, SIGTERM.
    Interrupted = 130,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> ExitCode {
        ExitCode::from(exit as u8)
    }
}

/// An error that ends the program, with help for the user.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct Failure {
    pub exit: Exit,
    /// What happened, and where; no full stop.
    pub what: String,
    /// What the user can do about it.
    pub help: Option<String>,
}

impl Failure {
    pub fn new(exit: Exit, what: impl Display) -> Failure {
        Failure {
            exit,
            what: what.to_string(),
            help: None,
        }
    }

    /// A command line, config or input file that cannot be used.
    pub fn usage(what: impl Display) -> Failure {
        Failure::new(Exit::Usage, what)
    }

    /// A robot, a run, a service or a broker that cannot be reached.
    pub fn unreachable(what: impl Display) -> Failure {
        Failure::new(Exit::Unreachable, what)
    }

    /// An input file or folder that cannot be read.
    pub fn unreadable(path: &Path, error: impl Display) -> Failure {
        Failure::usage(format_args!("cannot read {}: {error}", path.display()))
    }

    /// The same with the kind of file, such as `the picture`.
    pub fn unreadable_file(kind: &str, path: &Path, error: impl Display) -> Failure {
        let path = path.display();
        Failure::usage(format_args!("cannot read {kind} {path}: {error}"))
    }

    /// An output file that cannot be written.
    pub fn unwritable(path: &Path, error: impl Display) -> Failure {
        Failure::io(format_args!("write {}", path.display()), error)
    }

    /// Something that the system refused; `doing` completes "cannot ...".
    pub fn io(doing: impl Display, error: impl Display) -> Failure {
        Failure::internal(format_args!("cannot {doing}: {error}"))
    }

    /// A failure that the caller did not cause.
    pub fn internal(what: impl Display) -> Failure {
        Failure::new(Exit::Failed, what)
    }

    /// Ended by a person or the system, who know why: there is nothing to report.
    pub fn interrupted() -> Failure {
        Failure::new(Exit::Interrupted, "")
    }

    #[must_use]
    pub fn help(self, help: impl Into<String>) -> Failure {
        Failure {
            help: Some(help.into()),
            ..self
        }
    }

    pub fn report(&self) -> String {
        match &self.help {
            Some(help) => format!("error: {}\nhelp: {help}", self.what),
            None => format!("error: {}", self.what),
        }
    }
}

impl From<LinkError> for Failure {
    fn from(error: LinkError) -> Failure {
        Failure::unreachable(&error).help(error.help())
    }
}
