//! Why a run did not answer, by whichever way it was asked.

use std::io;
use std::time::Duration;

/// Why a run did not answer.
#[derive(Debug, thiserror::Error)]
pub enum AskError {
    /// Not in time.
    #[error("the run does not answer within {:.0} s", .0.as_secs_f64())]
    Silent(Duration),
    /// It ended before it had answered.
    #[error("the run has ended")]
    Ended,
    /// What the system says.
    #[error("the run cannot be asked: {0}")]
    Io(#[from] io::Error),
    /// A service on another computer does not let us in.
    #[error("the service does not let us in: {0}")]
    Denied(String),
    /// A service on another computer answers with a status that means nothing here.
    #[error("the service answers {0}: is it of another version?")]
    Strange(u16),
}
