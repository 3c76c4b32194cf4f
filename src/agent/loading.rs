//! Creates a behaviour from its spec and loads it.

use std::time::Duration;

use tokio::sync::watch;
use tokio::task::spawn_blocking;
use tokio::time::timeout;

use super::restart_loop::{LaunchContext, RestartLoop};
use super::roster::{BehaviourSpec, BehaviourSpecError, RosterError};
use crate::behaviour::Prepared;
use crate::pilot::{LinkState, Status};
use crate::robot::BehaviourId;
use crate::robot::channel::Role;
use crate::script::ScriptExit;

/// How long a loaded behaviour waits for the robot.
const REACH: Duration = Duration::from_millis(3500);

/// Creates a behaviour and has a host load it. A behaviour that is told to end meanwhile does not
/// run.
pub(super) async fn load(
    context: LaunchContext,
    by: BehaviourId,
    spec: BehaviourSpec,
    mut status: watch::Receiver<Status>,
) -> Result<(RestartLoop, Prepared), RosterError> {
    let made = spawn_blocking(move || spec.make()).await;
    let behaviour = made
        .unwrap_or(Err(BehaviourSpecError::Internal))
        .map_err(|error| RosterError::CannotLoad(error.to_string()))?;
    let restart_loop = RestartLoop::new(context, by, Role::Behaviour, behaviour);
    let prepared = restart_loop.prepare().await;
    let host = prepared.map_err(|exit| RosterError::CannotLoad(describe(&exit)))?;
    // A robot whose link was released is being dialled meanwhile.
    let up = status.wait_for(|status| status.link == LinkState::Up);
    match timeout(REACH, up).await {
        Ok(Ok(_)) => Ok((restart_loop, host)),
        _ => Err(RosterError::Offline),
    }
}

fn describe(exit: &ScriptExit) -> String {
    let words = exit.message.as_deref();
    words.unwrap_or(exit.reason.sentence()).to_owned()
}
