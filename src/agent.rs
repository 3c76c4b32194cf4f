//! Wiring and lifetimes of a run: load the scripts, connect, run them side by side, and bring
//! everything to an end within two seconds, whoever asks for it and whatever hangs.

mod flight;
mod keeper;
mod rescue;
mod seat;
mod talk;

use std::time::Duration;

use tokio::runtime;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

pub use self::flight::{Flight, Preflight};
use self::keeper::{Keeper, Surroundings};
pub use self::rescue::{RESCUE_NAME, rescue};
pub use self::seat::{Docked, Seat, SeatError};
pub use self::talk::{Talk, TalkError};
use crate::behaviour::{Launch, Launcher, Prepared, Reload, RestartPolicy};
use crate::link::LinkError;
use crate::pilot::{Dial, Pulse, Settings, Status};
use crate::robot::channel::{Request, Role};
use crate::robot::{BehaviourId, EndReason, Pictures, Priority};
pub use crate::robot::{Bus, Happening, Heard, Listener, Occurrence};
use crate::script::Ending;

/// How long the scripts' last words and the end of their hosts may take together.
const SCRIPTS_END: Duration = Duration::from_millis(1100);

/// A script and what is to be made of it.
#[derive(Debug)]
pub struct Behaviour {
    /// Who wins when several want to drive.
    pub priority: Priority,
    /// The script and its VM's options.
    pub launch: Launch,
    /// A text that comes later is looked over as [`check`](crate::check::check) does, and not
    /// loaded if that finds an error. The first one is the caller's business.
    pub checked: bool,
    /// What is done when it fails.
    pub restart: RestartPolicy,
    /// Where new texts of the script come from, if it is watched. It is stopped for each that can be
    /// loaded, and when it has ended it waits for the next: then only the token or the time limit
    /// ends the run.
    pub reloads: Option<mpsc::Receiver<Reload>>,
}

/// Everything a run needs.
pub struct Plan {
    /// At least one.
    pub behaviours: Vec<Behaviour>,
    /// The pilot's numbers.
    pub settings: Settings,
    /// How to reach the robot.
    pub dial: Dial,
    /// How to start hosts.
    pub launcher: Launcher,
    /// Runs the pilot and serves the hosts' pipes: that of a [`DrivingCore`](crate::pilot::DrivingCore), or in virtual time
    /// the only one there is.
    pub core: runtime::Handle,
    /// Of a run in real time.
    pub pulse: Option<Pulse>,
    /// The rescue behaviour, if there is to be one: see [`rescue`].
    pub rescue: Option<Launch>,
    /// End after this time.
    pub limit: Option<Duration>,
    /// Where it says what happens; it may be another's too.
    pub bus: Bus,
}

/// How a run went.
#[derive(Debug)]
pub struct Outcome {
    /// Each behaviour by name and how it ended for the last time, in the order in which they ended.
    pub endings: Vec<(String, Ending)>,
    /// At the end the watchdog had the robot: low battery.
    pub safety: bool,
    /// Ended by the token, not by itself and not by the time limit.
    pub interrupted: bool,
}

/// Why a run could not go on.
#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// The first connection failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// A task of ours panicked; the robot was told to stop.
    #[error("internal error: {0} broke down; the robot was told to stop")]
    Broken(&'static str),
}

/// A run that has not begun.
pub struct Agent {
    behaviours: Vec<Behaviour>,
    launcher: Launcher,
    rescue: Option<Launch>,
    limit: Option<Duration>,
    bus: Bus,
    flight: Preflight,
}

impl Agent {
    /// Also returns the newest status of robot and watchdog.
    pub fn new(plan: Plan) -> (Agent, watch::Receiver<Status>) {
        let flight = Preflight::new(plan.settings, plan.dial, plan.core, plan.pulse)
            .with_bus(plan.bus.clone());
        let status = flight.status();
        let agent = Agent {
            behaviours: plan.behaviours,
            launcher: plan.launcher,
            rescue: plan.rescue,
            limit: plan.limit,
            bus: plan.bus,
            flight,
        };
        (agent, status)
    }

    /// Where the pilot of this run is asked, for what no behaviour may ask: see [`Request::Sleep`].
    pub fn requests(&self) -> mpsc::Sender<Request> {
        self.flight.requests()
    }

    /// What the camera shows.
    pub fn pictures(&self) -> watch::Receiver<Pictures> {
        self.flight.frames()
    }

    /// Runs until every behaviour has ended, the time is over, or `stop` is cancelled. Scripts that
    /// cannot be loaded and are not watched end the run before the robot is connected to.
    ///
    /// # Errors
    /// See [`AgentError`].
    pub async fn run(self, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let Agent {
            behaviours,
            launcher,
            rescue,
            limit,
            bus,
            mut flight,
        } = self;
        let ended = watch::Sender::new(None);
        let around = Surroundings {
            launcher: launcher.clone(),
            core: flight.core().clone(),
            requests: flight.requests(),
            frames: flight.frames(),
            stop: ended.subscribe(),
            longest_silence: flight.longest_silence(),
            bus,
        };
        if let Some(launch) = rescue {
            flight.stand_by(launcher, launch);
        }
        let prepared = match prepare(around, behaviours).await {
            Ok(prepared) => prepared,
            Err(refused) => return Ok(refused),
        };
        let mut run = Run {
            flight: flight.launch(&stop),
            scripts: JoinSet::new(),
            endings: Vec::new(),
            ended,
        };
        match run.live(prepared, limit, &stop).await {
            Ok(reason) => run.end(reason, stop.is_cancelled()).await,
            Err(error) => {
                run.abandon().await;
                Err(error)
            }
        }
    }
}

/// A behaviour with its first host, or why there is none.
type Kept = (Keeper, Result<Prepared, Ending>);

/// Loads all scripts; the first that cannot be, and that nobody can mend while the run goes on, ends
/// it.
async fn prepare(around: Surroundings, behaviours: Vec<Behaviour>) -> Result<Vec<Kept>, Outcome> {
    let mut prepared = Vec::new();
    for (number, behaviour) in behaviours.into_iter().enumerate() {
        let by = BehaviourId(u16::try_from(number).unwrap_or(u16::MAX));
        let keeper = Keeper::new(around.clone(), by, Role::Behaviour, behaviour);
        match keeper.prepare().await {
            Err(ending) if !keeper.is_watched() => {
                keeper.tell_ended(&ending, Duration::ZERO);
                return Err(refused(keeper.name(), ending));
            }
            first => prepared.push((keeper, first)),
        }
    }
    Ok(prepared)
}

fn refused(name: &str, ending: Ending) -> Outcome {
    report(name, &ending);
    Outcome {
        endings: vec![(name.to_owned(), ending)],
        safety: false,
        interrupted: false,
    }
}

/// A run under way.
struct Run {
    flight: Flight,
    scripts: JoinSet<(String, Ending)>,
    endings: Vec<(String, Ending)>,
    /// Tells the behaviours why the run ends.
    ended: watch::Sender<Option<EndReason>>,
}

impl Run {
    /// From the first connection to the reason to end.
    async fn live(
        &mut self,
        prepared: Vec<Kept>,
        limit: Option<Duration>,
        stop: &CancellationToken,
    ) -> Result<EndReason, AgentError> {
        tokio::select! {
            biased;
            () = stop.cancelled() => return Ok(EndReason::Shutdown),
            up = self.flight.up() => up?,
        }
        for (keeper, first) in prepared {
            self.scripts.spawn(keeper.keep(first));
        }
        let home = self.flight.stay();
        tokio::select! {
            biased;
            () = stop.cancelled() => Ok(EndReason::Shutdown),
            error = self.flight.lost() => Err(error),
            () = over(limit) => Ok(EndReason::Shutdown),
            ended = run_out(&mut self.scripts, &mut self.endings, home) => ended,
        }
    }

    /// First the tracks, then the scripts' last words, then the link.
    async fn end(mut self, reason: EndReason, interrupted: bool) -> Result<Outcome, AgentError> {
        self.flight.part();
        self.ended.send_replace(Some(reason));
        let scripts = async {
            while let Some(Ok(ended)) = self.scripts.join_next().await {
                self.endings.push(ended);
            }
        };
        if timeout(SCRIPTS_END, scripts).await.is_err() {
            warn!("scripts that did not end in time were left behind");
        }
        let safety = reason == EndReason::Safety || self.flight.status().low;
        self.flight.end().await;
        Ok(Outcome {
            endings: self.endings,
            safety,
            interrupted,
        })
    }

    /// Something of ours is broken: the pilot is dropped, and its writer's drop stops the tracks.
    async fn abandon(mut self) {
        drop(self.flight);
        self.scripts.shutdown().await;
    }
}

/// Waits until every behaviour has ended, and then until a robot with a low battery is home.
async fn run_out(
    scripts: &mut JoinSet<(String, Ending)>,
    endings: &mut Vec<(String, Ending)>,
    home: impl Future<Output = bool>,
) -> Result<EndReason, AgentError> {
    while let Some(ended) = scripts.join_next().await {
        endings.push(ended.map_err(|_| AgentError::Broken("a supervisor"))?);
    }
    Ok(match home.await {
        true => EndReason::Safety,
        false => EndReason::Done,
    })
}

fn report(name: &str, ending: &Ending) {
    let reason = ending.reason;
    let message = ending.message.as_deref().unwrap_or(reason.sentence());
    match reason {
        EndReason::Error | EndReason::Cpu | EndReason::Memory | EndReason::Safety => {
            error!(behaviour = name, %reason, "{message}");
        }
        _ => info!(behaviour = name, %reason, "{message}"),
    }
}

async fn over(limit: Option<Duration>) {
    match limit {
        Some(limit) => sleep(limit).await,
        None => std::future::pending().await,
    }
}
