//! Wiring and lifetimes of a run: load the scripts, connect, run them in parallel, and end
//! everything within two seconds, whatever hangs.

mod aboard;
mod company;
mod flight;
mod loading;
mod rescue;
mod restart_loop;
mod roster;
mod seat;
mod talk;
mod waiting;

use std::time::Duration;

use tokio::runtime;
use tokio::sync::{mpsc, watch};
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use self::company::Company;
pub use self::flight::{Flight, Preflight};
pub use self::rescue::{RESCUE_NAME, rescue};
use self::restart_loop::LaunchContext;
pub use self::roster::{Blueprint, BlueprintError, Member, MemberState, Roster, RosterError};
pub use self::seat::{Docked, Seat, SeatError};
pub use self::talk::{Talk, TalkError};
pub use self::waiting::{Tries, until_answered};
use crate::behaviour::{Launch, Launcher, Reload, RestartPolicy};
use crate::link::LinkError;
use crate::pilot::{Dial, Pulse, Reactions, Settings, Status};
use crate::robot::channel::Request;
pub use crate::robot::{Bus, Happening, Heard, Listener, Occurrence};
use crate::robot::{EndReason, Lookout, Pictures, Priority};
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
    /// Where new texts of the script come from, if it is watched. It is stopped for each that can
    /// be loaded, and when it has ended it waits for the next: then only the token or the time
    /// limit ends the run.
    pub reloads: Option<mpsc::Receiver<Reload>>,
}

/// Everything a run needs.
pub struct Plan {
    /// Those that run from the beginning.
    pub behaviours: Vec<Behaviour>,
    /// What else can be started, and from what those of the beginning are made when they are
    /// started anew; without one, from the text that they had.
    pub blueprints: Vec<Blueprint>,
    /// Goes on when no behaviour runs.
    pub stays: bool,
    /// The pilot's numbers.
    pub settings: Settings,
    /// How to reach the robot.
    pub dial: Dial,
    /// How to start hosts.
    pub launcher: Launcher,
    /// Runs the pilot and serves the hosts' pipes: that of a
    /// [`DrivingCore`](crate::pilot::DrivingCore), or in virtual time the only one there is.
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
    #[error("internal error: {0} panicked; the robot has been stopped")]
    Broken(&'static str),
}

/// A run that has not begun.
pub struct Agent {
    behaviours: Vec<Behaviour>,
    company: Company,
    roster: Roster,
    launcher: Launcher,
    rescue: Option<Launch>,
    limit: Option<Duration>,
    stays: bool,
    flight: Preflight,
}

impl Agent {
    /// Also returns the newest status of robot and watchdog.
    pub fn new(plan: Plan) -> (Agent, watch::Receiver<Status>) {
        let flight = Preflight::new(plan.settings, plan.dial, plan.core, plan.pulse)
            .with_bus(plan.bus.clone());
        let status = flight.status();
        let around = LaunchContext {
            launcher: plan.launcher.clone(),
            core: flight.core().clone(),
            requests: flight.requests(),
            frames: flight.frames(),
            // Each behaviour has its own.
            stop: watch::channel(None).1,
            longest_silence: flight.longest_silence(),
            lookout: Lookout::default(),
            bus: plan.bus,
        };
        let (company, roster) = Company::new(around, status.clone(), plan.blueprints);
        let agent = Agent {
            behaviours: plan.behaviours,
            company,
            roster,
            launcher: plan.launcher,
            rescue: plan.rescue,
            limit: plan.limit,
            stays: plan.stays,
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

    /// How long it takes from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.flight.reactions()
    }

    /// Where behaviours are started and stopped while it runs.
    pub fn roster(&self) -> Roster {
        self.roster.clone()
    }

    /// Runs until every behaviour has ended (unless the plan says that it stays), the time is over,
    /// or `stop` is cancelled. Scripts that cannot be loaded and are not watched end the run before
    /// the robot is connected to.
    ///
    /// # Errors
    /// See [`AgentError`].
    pub async fn run(self, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let Agent {
            behaviours,
            mut company,
            launcher,
            rescue,
            limit,
            stays,
            mut flight,
            ..
        } = self;
        if let Some(launch) = rescue {
            flight.stand_by(launcher, launch);
        }
        let prepared = match company.prepare(behaviours).await {
            Ok(prepared) => prepared,
            Err(refused) => return Ok(Outcome::refused(refused)),
        };
        let mut run = Run {
            flight: flight.launch(&stop),
            company,
            stays,
        };
        let lived = tokio::select! {
            biased;
            () = stop.cancelled() => Ok(EndReason::Shutdown),
            up = run.reach() => match up {
                Ok(()) => {
                    run.company.begin(prepared);
                    run.live(limit, &stop).await
                }
                Err(error) => Err(error),
            },
        };
        match lived {
            Ok(reason) => run.end(reason, stop.is_cancelled()).await,
            Err(error) => {
                run.abandon().await;
                Err(error)
            }
        }
    }
}

impl Outcome {
    /// Of a script that cannot be loaded.
    fn refused(ending: (String, Ending)) -> Outcome {
        Outcome {
            endings: vec![ending],
            safety: false,
            interrupted: false,
        }
    }
}

/// A run under way.
struct Run {
    flight: Flight,
    company: Company,
    stays: bool,
}

impl Run {
    /// Waits for the first connection.
    async fn reach(&mut self) -> Result<(), AgentError> {
        tokio::select! {
            biased;
            up = self.flight.up() => up,
            never = self.company.wait_for_robot() => match never {},
        }
    }

    /// From the first connection to the reason to end.
    async fn live(
        &mut self,
        limit: Option<Duration>,
        stop: &CancellationToken,
    ) -> Result<EndReason, AgentError> {
        let over = over(limit);
        tokio::pin!(over);
        loop {
            let alone = self.company.is_empty() && !self.stays;
            let home = self.flight.stay();
            tokio::select! {
                biased;
                () = stop.cancelled() => return Ok(EndReason::Shutdown),
                error = self.flight.lost() => return Err(error),
                () = &mut over => return Ok(EndReason::Shutdown),
                stayed = home, if alone => {
                    return Ok(if stayed { EndReason::Safety } else { EndReason::Done });
                }
                turn = self.company.turn() => turn?,
            }
        }
    }

    /// First the tracks, then the scripts' last words, then the link.
    async fn end(self, reason: EndReason, interrupted: bool) -> Result<Outcome, AgentError> {
        self.flight.part();
        let endings = self.company.end(reason).await;
        let safety = reason == EndReason::Safety || self.flight.status().low;
        self.flight.end().await;
        Ok(Outcome {
            endings,
            safety,
            interrupted,
        })
    }

    /// Something of ours is broken: the pilot is dropped, and its writer's drop stops the tracks.
    async fn abandon(self) {
        drop(self.flight);
        self.company.abandon().await;
    }
}

async fn over(limit: Option<Duration>) {
    match limit {
        Some(limit) => sleep(limit).await,
        None => std::future::pending().await,
    }
}
