//! Wiring and lifetimes of a run: loads the scripts, connects, runs them in parallel, and ends
//! everything within two seconds, even if something hangs.

mod behaviour_set;
mod pilot_client;
mod repl_session;
mod restart_loop;
mod roster;
mod running_pilot;

use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::time::sleep;
use tokio_util::sync::CancellationToken;

use self::behaviour_set::BehaviourSet;
pub use self::pilot_client::{PilotClient, PilotClientError};
pub use self::repl_session::{ReplError, run_repl};
pub use self::roster::{
    BehaviourSpec, BehaviourState, BehaviourStatus, Change, Roster, RosterError,
};
pub use self::running_pilot::{PilotPlan, PilotSetup, RESCUE_NAME, RunningPilot, rescue};
use crate::behaviour::{Launch, RestartPolicy};
use crate::clock::or_never;
use crate::link::LinkError;
use crate::pilot::{LinkState, Reactions, Status};
use crate::robot::channel::Request;
pub use crate::robot::{AgentEvent, Bus, BusMessage, Listener, TimedEvent};
use crate::robot::{EndReason, Pictures, Priority};
use crate::script::ScriptExit;

const SCRIPTS_END: Duration = Duration::from_millis(1100);

#[derive(Debug)]
pub struct Behaviour {
    /// Decides which behaviour drives when several want to.
    pub priority: Priority,
    /// The script and its VM's options.
    pub launch: Launch,
    /// Whether a later text of the script is checked like [`check`](crate::check::check) does, and
    /// not loaded if the check finds an error. The first text is left to the caller.
    pub checked: bool,
    /// What to do when it fails.
    pub restart: RestartPolicy,
    /// Delivers new texts of the script, if its file is watched. The behaviour is stopped for each
    /// one that can be loaded, and when it has ended it waits for the next: then only the token or
    /// the time limit ends the run.
    pub reloads: Option<mpsc::Receiver<Vec<u8>>>,
}

impl Behaviour {
    /// The same, from its first text on.
    pub fn again(&self) -> Behaviour {
        Behaviour {
            launch: self.launch.clone(),
            reloads: None,
            ..*self
        }
    }
}

pub struct Plan {
    /// The behaviours that run from the beginning.
    pub behaviours: Vec<Behaviour>,
    /// What else can be started, and from what the initial behaviours are made when they are
    /// started again after their end; without a spec, from their first text.
    pub specs: Vec<BehaviourSpec>,
    /// Continue when no behaviour runs.
    pub stays: bool,
    /// End after this time.
    pub limit: Option<Duration>,
    pub pilot: PilotPlan,
}

#[derive(Debug, Default)]
pub struct Outcome {
    /// Each behaviour's name and last ending, in the order in which they ended.
    pub exits: Vec<(String, ScriptExit)>,
    /// The watchdog controlled the robot at the end: low battery.
    pub safety: bool,
    /// Ended by the token, and not by the end of its behaviours or by the time limit.
    pub interrupted: bool,
    /// The robot may be driving: no stop was confirmed.
    pub owes_stop: bool,
}

#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// The first connection failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    #[error("internal error: {0} panicked; the robot has been stopped")]
    Broken(&'static str),
}

/// A run that has not begun.
pub struct Agent {
    behaviours: Vec<Behaviour>,
    behaviour_set: BehaviourSet,
    roster: Roster,
    limit: Option<Duration>,
    stays: bool,
    setup: PilotSetup,
}

impl Agent {
    /// Prepares a run. Also returns the newest status of robot and watchdog.
    pub fn new(plan: Plan) -> (Agent, watch::Receiver<Status>) {
        let setup = PilotSetup::new(plan.pilot);
        let status = setup.status();
        let context = setup.host_context();
        let (behaviour_set, roster) = BehaviourSet::new(context, status.clone(), plan.specs);
        let agent = Agent {
            behaviours: plan.behaviours,
            behaviour_set,
            roster,
            limit: plan.limit,
            stays: plan.stays,
            setup,
        };
        (agent, status)
    }

    /// The pilot's queue, for requests that no behaviour may make: see [`Request::Suspend`].
    pub fn requests(&self) -> mpsc::Sender<Request> {
        self.setup.requests()
    }

    pub fn pictures(&self) -> watch::Receiver<Pictures> {
        self.setup.frames()
    }

    /// The times from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.setup.reactions()
    }

    /// The handle that starts and stops behaviours during the run.
    pub fn roster(&self) -> Roster {
        self.roster.clone()
    }

    /// Runs until every behaviour has ended (unless the plan says that the run stays), the time is
    /// over, or `stop` is cancelled. A script that cannot be loaded and is not watched ends the run
    /// before it connects to the robot.
    pub async fn run(mut self, stop: CancellationToken) -> Result<Outcome, AgentError> {
        let prepared = match self.behaviour_set.prepare(self.behaviours).await {
            Ok(prepared) => prepared,
            Err(refused) => {
                return Ok(Outcome {
                    exits: vec![refused],
                    ..Outcome::default()
                });
            }
        };
        let mut run = Run {
            pilot: self.setup.launch(&stop),
            behaviour_set: self.behaviour_set,
            stays: self.stays,
        };
        let lived = tokio::select! {
            biased;
            () = stop.cancelled() => Ok(EndReason::Shutdown),
            up = run.reach() => match up {
                Ok(()) => {
                    run.behaviour_set.begin(prepared);
                    run.live(self.limit, &stop).await
                }
                Err(error) => Err(error),
            },
        };
        match lived {
            Ok(reason) => run.end(reason, &stop).await,
            Err(error) => {
                run.abandon().await;
                Err(error)
            }
        }
    }
}

struct Run {
    pilot: RunningPilot,
    behaviour_set: BehaviourSet,
    stays: bool,
}

impl Run {
    async fn reach(&mut self) -> Result<(), AgentError> {
        tokio::select! {
            biased;
            up = self.pilot.connected() => up,
            never = self.behaviour_set.wait_for_robot() => match never {},
        }
    }

    /// Runs from the first connection on; returns the reason to end.
    async fn live(
        &mut self,
        limit: Option<Duration>,
        stop: &CancellationToken,
    ) -> Result<EndReason, AgentError> {
        let over = or_never(limit.map(sleep));
        tokio::pin!(over);
        loop {
            let alone = self.behaviour_set.is_empty() && !self.stays;
            let home = self.pilot.wait_until_settled();
            tokio::select! {
                biased;
                () = stop.cancelled() => return Ok(EndReason::Shutdown),
                error = self.pilot.failure() => return Err(error),
                () = &mut over => return Ok(EndReason::Shutdown),
                stayed = home, if alone => {
                    return Ok(if stayed { EndReason::Safety } else { EndReason::Done });
                }
                handled = self.behaviour_set.handle_next() => handled?,
            }
        }
    }

    /// Ends the run: first the tracks, then the scripts' last words, then the link; unless
    /// interrupted, only when a stop that is owed was executed.
    async fn end(self, reason: EndReason, stop: &CancellationToken) -> Result<Outcome, AgentError> {
        let interrupted = stop.is_cancelled();
        self.pilot.stop_motion();
        let exits = self.behaviour_set.end(reason).await;
        let safety = reason == EndReason::Safety || self.pilot.status().low;
        if self.pilot.status().link == LinkState::Lost {
            stop.run_until_cancelled(self.pilot.wait_until_stopped())
                .await;
        }
        let delivery = self.pilot.end().await;
        Ok(Outcome {
            exits,
            safety,
            interrupted,
            owes_stop: delivery.is_owed(),
        })
    }

    /// After an internal error: drops the pilot, and its writer's drop stops the tracks.
    async fn abandon(self) {
        drop(self.pilot);
        self.behaviour_set.abandon().await;
    }
}
