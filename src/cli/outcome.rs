//! The exit code of a run.

use super::{Exit, Failure};
use crate::agent::{AgentError, Outcome};
use crate::behaviour::is_failure;
use crate::link::LinkError;
use crate::robot::EndReason;

/// The exit code for the outcome of a run.
///
/// # Errors
/// The first connection failed, or a part of the agent ended unexpectedly.
pub(super) fn exit(outcome: Result<Outcome, AgentError>) -> Result<Exit, Failure> {
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(AgentError::Link(error)) => return Err(unreachable(error)),
        Err(error @ AgentError::Broken(_)) => return Err(Failure::new(Exit::Failed, error)),
    };
    let ended_by = |is: fn(EndReason) -> bool| {
        let mut endings = outcome.endings.iter();
        endings.any(|(_, ending)| is(ending.reason))
    };
    Ok(if outcome.interrupted && outcome.safety {
        Exit::Safety
    } else if outcome.interrupted {
        Exit::Interrupted
    } else if ended_by(is_failure) {
        Exit::Failed
    } else if outcome.safety || ended_by(|reason| reason == EndReason::Safety) {
        Exit::Safety
    } else {
        Exit::Done
    })
}

/// The failure of the first connection.
fn unreachable(error: LinkError) -> Failure {
    if error.is_final() {
        return error.into();
    }
    let help = error.help();
    Failure::from(error).help(format!(
        "{help}; `spykee run --wait` retries until it answers"
    ))
}
