//! The rescue behaviour: the script to which the watchdog grants the tracks when a robot with a low
//! battery does not find its station. Its host runs only while the watchdog wants it.

use std::io;
use std::pin::pin;

use tokio::sync::watch;
use tracing::info;

use super::Behaviour;
use super::restart_loop::{LaunchContext, RestartLoop};
use crate::behaviour::{Launch, Library, RestartPolicy};
use crate::pilot::Status;
use crate::robot::channel::Role;
use crate::robot::{BehaviourId, EndReason, Priority};
use crate::safety::Rescue;
use crate::script;

/// Its name in the log.
pub const RESCUE_NAME: &str = "rescue";
/// Other behaviours are numbered from 0.
pub(super) const RESCUER: BehaviourId = BehaviourId(u16::MAX);

/// The rescue behaviour to launch, with `options` for its VM; `None`: the config has none.
///
/// # Errors
/// If its file cannot be read.
pub fn rescue(choice: &Rescue, options: script::Options) -> io::Result<Option<Launch>> {
    let (source, library) = match choice {
        Rescue::Off => return Ok(None),
        Rescue::Builtin => (script::RESCUE.into(), Library::default()),
        Rescue::File(path) => {
            let folder = path.parent().unwrap_or(path);
            (
                crate::behaviour::read_source(path)?,
                Library::new(folder.to_owned()),
            )
        }
    };
    Ok(Some(Launch {
        source,
        options,
        library,
    }))
}

/// Runs the rescue behaviour whenever the watchdog wants it. Never returns while the pilot runs.
pub(super) async fn stand_by(
    context: LaunchContext,
    launch: Launch,
    mut status: watch::Receiver<Status>,
) {
    while until(true, &mut status).await {
        info!("starts the rescue behaviour, which looks for the way to the station");
        let stop = watch::Sender::new(None);
        let context = LaunchContext {
            stop: stop.subscribe(),
            ..context.clone()
        };
        let restart_loop =
            RestartLoop::new(context, RESCUER, Role::Rescuer, behaviour(launch.clone()));
        let first = restart_loop.prepare().await;
        let mut life = pin!(restart_loop.run(first));
        let mut unwanted = status.clone();
        tokio::select! {
            biased;
            // It has failed permanently: the watchdog continues without it.
            _ = &mut life => {}
            _ = until(false, &mut unwanted) => {
                stop.send_replace(Some(EndReason::Cancelled));
                life.await;
            }
        }
        until(false, &mut status).await;
    }
}

/// Waits until the watchdog wants it, or no longer does; `false`: the pilot has ended.
async fn until(wanted: bool, status: &mut watch::Receiver<Status>) -> bool {
    let changed = status.wait_for(|status| status.rescue == wanted).await;
    changed.is_ok()
}

fn behaviour(launch: Launch) -> Behaviour {
    Behaviour {
        priority: Priority::default(),
        launch,
        checked: false,
        restart: RestartPolicy::OnFailure(Default::default()),
        reloads: None,
    }
}
