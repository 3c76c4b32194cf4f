//! The pilot's lifetime, for all its users: a run, an interactive session, a tool. It is launched
//! on the driving core, stops all motion at the first signal, and ends when its last commands are
//! acknowledged.

use std::io;
use std::pin::pin;
use std::time::Duration;

use tokio::runtime;
use tokio::sync::{mpsc, watch};
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tokio_util::task::AbortOnDropHandle;
use tracing::{info, warn};

use super::restart_loop::RestartLoop;
use super::{AgentError, Behaviour};
use crate::behaviour::{Accounts, Handle, HostContext, Launch, Launcher, Library, RestartPolicy};
use crate::link::LinkError;
use crate::pilot::{
    self, Connector, Delivery, Heartbeat, LinkState, Pilot, Reactions, Settings, Status,
};
use crate::robot::channel::{MAX_REQUESTS, Request, Role};
use crate::robot::{BehaviourId, Bus, EndReason, Pictures, Priority, ViewerChannel, WatchdogState};
use crate::safety::Rescue;
use crate::script;

/// How long a run goes on after the docking, so that the answer leaves first.
const ANSWER_TIME: Duration = Duration::from_millis(50);
/// How long the last writes and the closing of the link may take.
const LINK_END: Duration = Duration::from_millis(2800);

/// What a pilot needs, whoever it serves.
pub struct PilotPlan {
    pub settings: Settings,
    pub connector: Connector,
    pub launcher: Launcher,
    /// Runs the pilot and serves the hosts' pipes: the runtime of a [`pilot::DrivingCore`], or in
    /// virtual time the only runtime.
    pub core: runtime::Handle,
    /// The heartbeat, in real time only.
    pub heartbeat: Option<Heartbeat>,
    /// The rescue behaviour, if any: see [`rescue`].
    pub rescue: Option<Launch>,
    /// The bus on which the pilot publishes; it may be shared.
    pub bus: Bus,
}

pub struct PilotSetup {
    pilot: Pilot,
    plan: PilotPlan,
    requests: (mpsc::Sender<Request>, mpsc::Receiver<Request>),
    frames: watch::Receiver<Pictures>,
    status: watch::Receiver<Status>,
}

impl PilotSetup {
    pub fn new(mut plan: PilotPlan) -> PilotSetup {
        let (mut pilot, frames, status) = Pilot::new(&plan.settings);
        pilot.set_heartbeat(plan.heartbeat.take());
        pilot.set_bus(plan.bus.clone());
        PilotSetup {
            pilot,
            plan,
            requests: mpsc::channel(MAX_REQUESTS),
            frames,
            status,
        }
    }

    pub fn requests(&self) -> mpsc::Sender<Request> {
        self.requests.0.clone()
    }

    pub fn frames(&self) -> watch::Receiver<Pictures> {
        self.frames.clone()
    }

    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    /// The times from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.pilot.reactions()
    }

    pub(super) fn host_context(&self) -> HostContext {
        HostContext {
            launcher: self.plan.launcher.clone(),
            core: self.plan.core.clone(),
            requests: self.requests(),
            frames: self.frames(),
            longest_silence: self.plan.settings.limits.host_idle_silence.get(),
            viewers: ViewerChannel::default(),
            bus: self.plan.bus.clone(),
            accounts: Accounts::default(),
        }
    }

    /// Connects, and drives until it is ended. Cancelling `stop` stops all motion at once, even if
    /// the calling thread is blocked by the system. The rescue behaviour runs whenever the watchdog
    /// wants it; its hosts are started on the calling task's runtime.
    pub fn launch(mut self, stop: &CancellationToken) -> RunningPilot {
        let rescue = self.plan.rescue.take().map(|launch| {
            let standing_by = stand_by(self.host_context(), launch, self.status());
            AbortOnDropHandle::new(tokio::spawn(standing_by))
        });
        let PilotPlan {
            settings,
            connector,
            core,
            ..
        } = self.plan;
        let shutdown = pilot::Shutdown::default();
        let run = self
            .pilot
            .run(connector, settings, self.requests.1, shutdown.clone());
        let stopped = stop.clone();
        let motion = shutdown.stop_motion.clone();
        let stop_motion = core.spawn(async move {
            stopped.cancelled().await;
            motion.cancel();
        });
        RunningPilot {
            pilot: AbortOnDropHandle::new(core.spawn(run)),
            ended: false,
            shutdown,
            status: self.status,
            _stop_motion: AbortOnDropHandle::new(stop_motion),
            _rescue: rescue,
        }
    }
}

/// A running pilot. Dropping it drops the pilot, whose writer sends the watchdog's last words.
pub struct RunningPilot {
    pilot: AbortOnDropHandle<Result<Delivery, LinkError>>,
    ended: bool,
    shutdown: pilot::Shutdown,
    status: watch::Receiver<Status>,
    _stop_motion: AbortOnDropHandle<()>,
    /// Ends with the pilot.
    _rescue: Option<AbortOnDropHandle<()>>,
}

impl RunningPilot {
    pub fn status(&self) -> Status {
        *self.status.borrow()
    }

    /// Waits until the robot is connected. Cancel-safe.
    pub async fn connected(&mut self) -> Result<(), AgentError> {
        let mut status = self.status.clone();
        tokio::select! {
            biased;
            error = self.failure() => Err(error),
            _ = status.wait_for(|status| status.link == LinkState::Up) => Ok(()),
        }
    }

    /// Waits until the pilot ends without being told to: the first connection has
    /// failed, or the pilot has panicked. Cancel-safe.
    pub async fn failure(&mut self) -> AgentError {
        if self.ended {
            return AgentError::Broken("the pilot");
        }
        let ended = (&mut self.pilot).await;
        self.ended = true;
        match ended {
            Ok(Err(error)) => AgentError::Link(error),
            Ok(Ok(_)) | Err(_) => AgentError::Broken("the pilot"),
        }
    }

    /// Stops all motion for the rest of the run, except the search of a robot with a low battery;
    /// lights and sounds still work.
    pub fn stop_motion(&self) {
        self.shutdown.stop_motion.cancel();
    }

    /// Whether the battery is low and the robot is not on its station.
    pub fn is_away(&self) -> bool {
        is_away(&self.status.borrow())
    }

    /// Waits until a docking that a person has ordered is over, until a robot that may be driving has
    /// executed a stop, for at most [`HURRY_LIMIT`](pilot::HURRY_LIMIT), and until one with a low
    /// battery is home, also across lost links; returns at once if none is the case, or the pilot has
    /// ended. Returns whether one was low and away. Cancel-safe.
    pub fn wait_until_settled(&self) -> impl Future<Output = bool> + Send + use<> {
        let mut status = self.status.clone();
        async move {
            if is_docking(&status.borrow_and_update()) {
                let _ = status.wait_for(|status| !is_docking(status)).await;
                sleep(ANSWER_TIME).await;
            }
            wait_until_stopped(&mut status).await;
            if !is_away(&status.borrow_and_update()) {
                return false;
            }
            info!("battery low: staying until the robot is on its station (Ctrl-C leaves now)");
            let _ = status.wait_for(|status| !is_away(status)).await;
            true
        }
    }

    /// Waits until a robot that may be driving has executed a stop, for at most
    /// [`HURRY_LIMIT`](pilot::HURRY_LIMIT). Cancel-safe.
    pub(super) async fn wait_until_stopped(&self) {
        wait_until_stopped(&mut self.status.clone()).await;
    }

    /// Stops the tracks, then closes the link when the last commands are acknowledged, or the time
    /// for that is over.
    pub async fn end(mut self) -> Delivery {
        if self.ended {
            return Delivery::Offline;
        }
        self.stop_motion();
        self.shutdown.close_link.cancel();
        match timeout(LINK_END, &mut self.pilot).await {
            Ok(Ok(Ok(delivery))) => delivery,
            Ok(Ok(Err(error))) => {
                warn!("at the end of the link: {error}");
                Delivery::Offline
            }
            Ok(Err(_)) => Delivery::NotConfirmed {
                after: Duration::ZERO,
            },
            Err(_) => Delivery::NotConfirmed { after: LINK_END },
        }
    }
}

async fn wait_until_stopped(status: &mut watch::Receiver<Status>) {
    if !status.borrow_and_update().owes_stop {
        return;
    }
    let stopped = status.wait_for(|status| !status.owes_stop || status.link == LinkState::Lost);
    if stopped.await.is_ok_and(|status| !status.owes_stop) {
        return;
    }
    let minutes = pilot::HURRY_LIMIT.as_secs() / 60;
    warn!(
        "the robot is out of reach, and may be driving: trying to stop it for {minutes} minutes \
         (Ctrl-C leaves that to the guardian process)"
    );
    let stopped = status.wait_for(|status| !status.owes_stop);
    match timeout(pilot::HURRY_LIMIT, stopped).await {
        Ok(_) => info!("the robot has stopped"),
        Err(_) => warn!("gave up after {minutes} minutes: the robot may be driving"),
    }
}

fn is_docking(status: &Status) -> bool {
    status.safety == WatchdogState::Docking
}

fn is_away(status: &Status) -> bool {
    status.low && !status.docked
}

pub const RESCUE_NAME: &str = "rescue";
/// The built-in rescue behaviour looks at a picture for a few milliseconds. On a machine that is too busy for
/// that, a slow robot is better than one that drives blindly. No longer than the watchdog waits until it ends
/// a silent host; it stops the tracks long before.
const RESCUE_BUDGET_MS: u64 = 2_000;
/// Other behaviours are numbered from 0.
pub(super) const RESCUER: BehaviourId = BehaviourId(u16::MAX);

/// The rescue behaviour to launch, with `options` for its VM; `None`: the config has none.
pub fn rescue(choice: &Rescue, mut options: script::Options) -> io::Result<Option<Launch>> {
    let (source, library) = match choice {
        Rescue::Off => return Ok(None),
        Rescue::Builtin => {
            let budget = &mut options.limits.callback_budget_ms;
            *budget = RESCUE_BUDGET_MS.max(*budget);
            (script::RESCUE.into(), Library::default())
        }
        Rescue::File(path) => (crate::behaviour::read_source(path)?, Library::beside(path)),
    };
    Ok(Some(Launch {
        source,
        options,
        library,
    }))
}

/// Runs the rescue behaviour whenever the watchdog wants it. Never returns while the pilot runs.
pub(super) async fn stand_by(
    context: HostContext,
    launch: Launch,
    mut status: watch::Receiver<Status>,
) {
    while until(true, &mut status).await {
        info!("starts the rescue behaviour, which looks for the way to the station");
        let stop = Handle::default();
        let rescuer = behaviour(launch.clone());
        let restart_loop = RestartLoop::new(
            context.clone(),
            stop.clone(),
            RESCUER,
            Role::Rescuer,
            rescuer,
        );
        let first = restart_loop.prepare().await;
        let mut life = pin!(restart_loop.run(first));
        let mut unwanted = status.clone();
        tokio::select! {
            biased;
            // It has failed permanently: the watchdog continues without it.
            _ = &mut life => {}
            _ = until(false, &mut unwanted) => {
                stop.stop(EndReason::Cancelled);
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_rescue_behaviour_has_more_time_than_a_script() {
        let budget = |choice: &Rescue, given: u64| {
            let mut options = script::Options::new(RESCUE_NAME, "rescue.lua");
            options.limits.callback_budget_ms = given;
            let launch = rescue(choice, options).unwrap().unwrap();
            launch.options.limits.callback_budget_ms
        };
        assert_eq!(budget(&Rescue::Builtin, 100), RESCUE_BUDGET_MS);
        assert_eq!(budget(&Rescue::Builtin, 9_000), 9_000);
        let folder = tempfile::tempdir().unwrap();
        let own = folder.path().join("rescue.lua");
        std::fs::write(&own, "task.wait(1)").unwrap();
        assert_eq!(budget(&Rescue::File(own), 100), 100);
    }
}
