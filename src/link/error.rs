//! The errors of the link, with messages for people.

use std::io::{self, ErrorKind};
use std::time::Duration;

use super::Target;
use crate::wire::{FramingError, Refusal};

/// Why there is no link, or no longer. Never contains a password.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    #[error("cannot reach the robot at {target}: {source}")]
    Unreachable { target: Target, source: io::Error },
    #[error("timed out after {after:?} while waiting for {what}")]
    TimedOut { what: &'static str, after: Duration },
    /// AUTH_REPLY 0, 1.
    #[error("the robot refuses user `{user}` with this password")]
    WrongPassword { user: String },
    /// AUTH_REPLY 0, 3: the robot serves one user at a time.
    #[error("the robot is in use{}", in_use_by(.by.as_deref()))]
    InUse {
        /// The connected user, if discovery could tell.
        by: Option<String>,
    },
    /// AUTH_REPLY 0 with a reason that the protocol does not list.
    #[error("the robot refuses the login (reason {0})")]
    Refused(u8),
    /// Accepted, but without a battery level: motion is not allowed.
    #[error("the robot accepted the login, but sent no battery level within {after:?}")]
    NoPower { after: Duration },
    #[error("the robot closed the connection")]
    Closed,
    #[error("the robot sends something that is not a Spykee message: {0}")]
    Framing(#[from] FramingError),
    #[error("the link is dead: nothing could be sent for {after:?}")]
    Dead { after: Duration },
    /// The guardian process cannot be given a duplicate of the socket: nothing may drive over it.
    #[error("no guardian process can watch this link: {0}")]
    Unguarded(#[source] io::Error),
    /// This side closes the link, for this reason.
    #[error("{0}")]
    ClosedHere(String),
    #[error("the link failed: {0}")]
    Io(#[source] io::Error),
}

impl LinkError {
    /// Whether another attempt with the same login is pointless.
    pub fn is_final(&self) -> bool {
        matches!(self, LinkError::WrongPassword { .. })
    }

    /// What a person can do about it, in one sentence.
    pub fn help(&self) -> &'static str {
        match self {
            LinkError::Unreachable { .. } | LinkError::TimedOut { .. } => {
                "is the robot on, and is this computer in its Wi-Fi? `spykee discover` lists robots"
            }
            LinkError::WrongPassword { .. } => {
                "give --user, and the password in SPYKEE_PASSWORD or --password-file"
            }
            LinkError::InUse { .. } => "end the other program: the robot serves one user at a time",
            LinkError::Refused(_) | LinkError::NoPower { .. } | LinkError::Closed => {
                "if this persists, switch the robot off and on again"
            }
            LinkError::Framing(_) => "is there a Spykee robot at this address and port?",
            LinkError::Unguarded(_) => "close other programs, or raise the limit of open files",
            LinkError::Dead { .. } | LinkError::ClosedHere(_) | LinkError::Io(_) => {
                "is the robot still in reach of its Wi-Fi?"
            }
        }
    }

    /// Every kind of close by the peer becomes [`LinkError::Closed`].
    pub(super) fn from_io(error: io::Error, dead_after: Duration) -> LinkError {
        match error.kind() {
            ErrorKind::ConnectionReset
            | ErrorKind::ConnectionAborted
            | ErrorKind::BrokenPipe
            | ErrorKind::NotConnected
            | ErrorKind::UnexpectedEof
            | ErrorKind::WriteZero => LinkError::Closed,
            ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
                LinkError::Dead { after: dead_after }
            }
            _ => LinkError::Io(error),
        }
    }

    pub(super) fn from_refusal(refusal: Refusal, user: &str) -> LinkError {
        match refusal {
            Refusal::WrongPassword => LinkError::WrongPassword {
                user: user.to_owned(),
            },
            Refusal::InUse => LinkError::InUse { by: None },
            Refusal::Unknown(reason) => LinkError::Refused(reason),
        }
    }
}

fn in_use_by(user: Option<&str>) -> String {
    user.map_or_else(String::new, |user| format!(" by `{user}`"))
}
