//! A simulation: a complete run in virtual time. Agent, hosts, watchdog and simulated robot share
//! one thread, whose clock jumps ahead when all tasks wait, and communicate over in-memory pipes.
//! The same world, behaviours, options and seed give the same run, event by event, in every build.
//!
//! Within the closure of [`run`] `tokio::time` is virtual: always set timeouts, because unlimited
//! virtual time can pass in almost no real time, and never wait for anything outside the
//! simulation. Only the VM confines scripts, without landlock, seccomp and resource limits: run
//! only scripts that you trust with that.

mod recorder;
mod sim_clock;

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::panic::resume_unwind;
use std::time::Duration;

use tokio::runtime::{self, Builder, LocalOptions};
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

pub use self::recorder::{Event, EventKind, Recorder, now};
pub use self::sim_clock::{ClockMode, SimClock, TimeScale};
use crate::agent::{self, Agent, AgentError, Behaviour, Outcome, PilotPlan, Plan, RESCUE_NAME};
use crate::behaviour::{Launch, Launcher, STACK};
use crate::pilot::{Connector, Settings, Status};
use crate::robot::channel::Request;
use crate::robot::{Bus, Streams};
use crate::safety::Limits;
use crate::sim::{self, Handle, World};
use crate::vision::Camera;
use crate::wire::Login;
use crate::{clock, link, script};

pub struct Simulation {
    sim: sim::Handle,
    began: Instant,
    options: Options,
}

/// Sets up a simulation in this world and runs `work` in it, in virtual time.
/// Fails if the system cannot create a thread or a runtime.
pub fn run<T: Send>(
    world: World,
    options: Options,
    work: impl AsyncFnOnce(&Simulation) -> T + Send,
) -> io::Result<T> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new()
            .name("simulation".into())
            .stack_size(STACK)
            .spawn_scoped(scope, {
                let parent = tracing::dispatcher::get_default(Clone::clone);
                let events = options.events.clone();
                move || recorder::with_recorder(parent, events, || run_here(world, options, work))
            })?;
        thread.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}

/// Runs the simulation on this thread. The runtime has no I/O driver: nothing here waits for
/// external I/O, and virtual time jumps faster without one.
fn run_here<T>(
    world: World,
    options: Options,
    work: impl AsyncFnOnce(&Simulation) -> T,
) -> io::Result<T> {
    script::set_simulated_wall_factor();
    let runtime = Builder::new_current_thread()
        .enable_time()
        .start_paused(true)
        .build_local(LocalOptions::default())?;
    runtime.block_on(async {
        let began = recorder::begin();
        clock::begin_virtual(options.date);
        let sim_options = sim::Options {
            seed: options.seed,
            unacknowledged: Some(link::Options::default().dead_after),
            ..options.sim.clone()
        };
        let server = sim::Server::detached(world, sim_options);
        let simulation = Simulation {
            sim: server.handle(),
            began,
            options,
        };
        if let Some(sim_clock) = simulation.options.sim_clock.clone() {
            tokio::spawn(sim_clock.run(began, simulation.options.stop.clone()));
        }
        let server = tokio::spawn(server.run());
        let result = work(&simulation).await;
        simulation.record_end();
        server.abort();
        Ok(result)
    })
}

impl Simulation {
    /// Returns the handle of the simulated robot: its state, the commands that it received, and
    /// fault injection.
    pub fn sim(&self) -> &sim::Handle {
        &self.sim
    }

    /// Returns the virtual time since the simulation was set up.
    pub fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// Returns the token that ends its runs.
    pub fn stop(&self) -> CancellationToken {
        self.options.stop.clone()
    }

    /// Returns the clock that people control, if it has one.
    pub fn sim_clock(&self) -> Option<SimClock> {
        self.options.sim_clock.clone()
    }

    /// Returns the simulation's seed.
    pub fn seed(&self) -> u64 {
        self.options.seed
    }

    /// Starts an agent with these behaviours. It ends when they have ended, after `limit`, or by
    /// [`Running::stop`] or [`Options::stop`]. It does nothing before the caller's next wait.
    /// Agents may run one after another; each finds the robot in the state in which the previous
    /// one left it.
    pub fn start(&self, behaviours: Vec<Behaviour>, limit: Option<Duration>) -> Running {
        let plan = Plan {
            limit,
            stays: self.options.sim_clock.is_some(),
            ..self.plan(behaviours)
        };
        let stop = self.options.stop.child_token();
        let (agent, status) = Agent::new(plan);
        Running {
            status,
            requests: agent.requests(),
            agent: tokio::task::spawn_local(agent.run(stop.clone())),
            stop,
        }
    }

    /// Returns the plan of an agent for this simulation's robot, for callers that create the agent
    /// themselves, such as a service. Run that agent within the simulation.
    ///
    /// A simulated robot's camera is known: its world's counts, not the config's.
    pub fn plan(&self, mut behaviours: Vec<Behaviour>) -> Plan {
        let options = &self.options;
        let camera = self.sim.world().camera.calibrated();
        for behaviour in &mut behaviours {
            behaviour.launch.options.camera = camera;
        }
        Plan {
            behaviours,
            specs: Vec::new(),
            stays: false,
            limit: None,
            pilot: PilotPlan {
                settings: Settings {
                    limits: options.limits.clone(),
                    simulated: true,
                    seed: options.seed,
                    link: link::Options::default(),
                    waits: false,
                    streams: options.streams,
                },
                connector: connector(self.sim.clone(), options.sim.login.clone()),
                launcher: Launcher::in_this_thread(),
                core: runtime::Handle::current(),
                heartbeat: None,
                rescue: rescue(options, camera),
                bus: options.bus.clone(),
            },
        }
    }

    fn record_end(&self) {
        let state = self.sim.state();
        let pose = state.pose;
        let battery = state.power.percent;
        tracing::debug!(
            target: "spykee::simulation::end", x = pose.x, y = pose.y, heading = pose.heading, battery,
            docked = state.docked, distance = state.distance, collisions = state.collisions, "the end"
        );
    }
}

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
    agent: JoinHandle<Result<Outcome, AgentError>>,
}

impl Running {
    /// Requests an orderly end: scripts run their last words, then the link is closed.
    pub fn stop(&self) {
        self.stop.cancel();
    }

    /// Returns a receiver of the latest status of robot and watchdog, as shown on the status line.
    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    pub fn requests(&self) -> mpsc::Sender<Request> {
        self.requests.clone()
    }

    /// Waits until the agent has ended. Without a limit, a call to [`Running::stop`] or behaviours
    /// that end, this never returns.
    pub async fn outcome(mut self) -> Result<Outcome, AgentError> {
        self.ended().await
    }

    /// The same once, for callers that wait for other things too. Cancel-safe.
    pub async fn ended(&mut self) -> Result<Outcome, AgentError> {
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
    pub events: Option<Recorder>,
    /// Slows the virtual clock down for viewers. A run with a sim_clock continues after its
    /// behaviours have ended. Without it, virtual time jumps ahead whenever all tasks wait.
    pub sim_clock: Option<SimClock>,
    /// The bus to which its agents publish.
    pub bus: Bus,
}
