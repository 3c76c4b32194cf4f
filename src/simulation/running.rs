//! A running agent in a simulation.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::time::Duration;

use tokio::runtime;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use super::recorder::Recorder;
use super::sim_clock::SimClock;
use crate::agent::{self, Agent, AgentError, Behaviour, Outcome, Plan, RESCUE_NAME, Roster};
use crate::behaviour::{Launch, Launcher};
use crate::link;
use crate::pilot::{Connector, Reactions, Settings, Status};
use crate::robot::channel::Request;
use crate::robot::{Bus, Pictures, Streams};
use crate::safety::Limits;
use crate::script;
use crate::sim::{self, Handle};
use crate::vision::Camera;
use crate::wire::Login;

/// The nominal address of simulated robots.
const ADDRESS: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 9000);
/// Buffer size between robot and agent in each direction, bytes.
const LINK_LEN: usize = 64 * 1024;

/// A running agent. Dropping it ends the agent immediately: its hosts end, and its link sends a
/// stop as its last words.
pub struct Running {
    stop: CancellationToken,
    status: watch::Receiver<Status>,
    requests: mpsc::Sender<Request>,
    roster: Roster,
    pictures: watch::Receiver<Pictures>,
    reactions: Reactions,
    agent: JoinHandle<Result<Outcome, AgentError>>,
}

impl Running {
    pub(super) fn start(
        sim: Handle,
        options: &Options,
        behaviours: Vec<Behaviour>,
        limit: Option<Duration>,
    ) -> Running {
        let plan = Plan {
            limit,
            stays: options.sim_clock.is_some(),
            ..plan(sim, options, behaviours)
        };
        let stop = options.stop.child_token();
        let (agent, status) = Agent::new(plan);
        let requests = agent.requests();
        let roster = agent.roster();
        let pictures = agent.pictures();
        let reactions = agent.reactions();
        let agent = tokio::task::spawn_local(agent.run(stop.clone()));
        Running {
            stop,
            status,
            requests,
            roster,
            pictures,
            reactions,
            agent,
        }
    }

    /// Requests an orderly end: scripts run their last words, then the link is closed.
    pub fn stop(&self) {
        self.stop.cancel();
    }

    /// Returns a token that has the same effect as [`Running::stop`] when cancelled.
    pub fn stopper(&self) -> CancellationToken {
        self.stop.clone()
    }

    /// Returns a receiver of the latest status of robot and watchdog, as shown on the status line.
    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    pub fn requests(&self) -> mpsc::Sender<Request> {
        self.requests.clone()
    }

    /// Returns the roster, through which behaviours are started and stopped.
    pub fn roster(&self) -> Roster {
        self.roster.clone()
    }

    /// Returns a receiver of the camera's pictures.
    pub fn pictures(&self) -> watch::Receiver<Pictures> {
        self.pictures.clone()
    }

    /// Returns the measured reaction times, from a frame to a track command.
    pub fn reactions(&self) -> Reactions {
        self.reactions.clone()
    }

    /// Waits until the agent has ended. Without a limit, a call to [`Running::stop`] or behaviours
    /// that end, this never returns.
    pub async fn outcome(mut self) -> Result<Outcome, AgentError> {
        match (&mut self.agent).await {
            Ok(outcome) => outcome,
            Err(_) => Err(AgentError::Broken("the agent")),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.agent.abort();
    }
}

/// A simulated robot's camera is known: its world's counts, not the config's.
pub(super) fn plan(sim: Handle, options: &Options, mut behaviours: Vec<Behaviour>) -> Plan {
    let camera = sim.world().camera.calibrated();
    for behaviour in &mut behaviours {
        behaviour.launch.options.camera = camera;
    }
    Plan {
        behaviours,
        specs: Vec::new(),
        stays: false,
        settings: Settings {
            limits: options.limits.clone(),
            simulated: true,
            seed: options.seed,
            link: link::Options::default(),
            streams: options.streams,
        },
        connector: connector(sim, options.sim.login.clone()),
        launcher: Launcher::in_this_thread(),
        core: runtime::Handle::current(),
        heartbeat: None,
        rescue: rescue(options, camera),
        limit: None,
        bus: options.bus.clone(),
    }
}

/// Loads the rescue behaviour; logs an error and returns `None` if its file cannot be read.
fn rescue(options: &Options, camera: Camera) -> Option<Launch> {
    let choice = &options.limits.rescue;
    let script = script::Options {
        seed: options.seed,
        camera,
        ..script::Options::new(RESCUE_NAME, choice.to_string())
    };
    agent::rescue(choice, script).unwrap_or_else(|error| {
        tracing::error!("cannot read the rescue behaviour {choice}: {error}");
        None
    })
}

/// Creates a dialler that opens a new pipe to the simulator for each connection attempt.
fn connector(sim: Handle, login: Login) -> Connector {
    Box::new(move |supervision| {
        let sim = sim.clone();
        let login = login.clone();
        let options = link::Options::default();
        Box::pin(async move {
            let (ours, theirs) = tokio::io::duplex(LINK_LEN);
            sim.connect(theirs);
            let (reader, writer) = tokio::io::split(ours);
            link::open(reader, writer, ADDRESS, &login, supervision, &options).await
        })
    })
}

/// Options of a simulation.
#[derive(Default)]
pub struct Options {
    /// Seed of the simulator's noise and of the link's pauses; behaviours have their own seeds.
    pub seed: u64,
    /// The simulated robot: its login, firmware, frames per second and faults. Its `seed`,
    /// `listen`, `discovery` and `unacknowledged` are not used.
    pub sim: sim::Options,
    /// The parameters of the safety rules.
    pub limits: Limits,
    /// When the robot's streams are on.
    pub streams: Streams,
    /// Ends every run of this simulation when cancelled, from any thread.
    pub stop: CancellationToken,
    /// Wall-clock time at the start; 2026-01-01 09:00 UTC if `None`.
    pub date: Option<jiff::Timestamp>,
    /// Receives all events.
    pub events: Option<Recorder>,
    /// Slows the virtual clock down for viewers. A run with a sim_clock continues after its
    /// behaviours have ended. Without it, virtual time jumps ahead whenever all tasks wait.
    pub sim_clock: Option<SimClock>,
    /// The bus to which its agents publish.
    pub bus: Bus,
}
