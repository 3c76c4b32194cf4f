//! Why a run did not answer, locally or remotely.

use std::io;
use std::time::Duration;

/// Why a run did not answer.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// No answer in time.
    #[error("the run does not answer within {:.0} s", .0.as_secs_f64())]
    TimedOut(Duration),
    /// The run ended before it answered.
    #[error("the run has ended")]
    Ended,
    /// An error of the system.
    #[error("the request to the run failed: {0}")]
    Io(#[from] io::Error),
    /// A service on another computer denies access.
    #[error("the service denies access: {0}")]
    Denied(String),
    /// A service on another computer replies with an unexpected HTTP status.
    #[error("the service replies with the HTTP status {0}: is it a different version?")]
    UnexpectedStatus(u16),
}
