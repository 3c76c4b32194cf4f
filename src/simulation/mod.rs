//! A simulation: a complete run in virtual time. Agent, hosts, watchdog and simulated robot share
//! one thread, whose clock jumps ahead when all tasks wait, and communicate over in-memory pipes.
//! The same world, behaviours, options and seed give the same run, event by event, in every build.
//!
//! Within the closure of [`run`] `tokio::time` is virtual: always set timeouts, because unlimited
//! virtual time can pass in almost no real time, and never wait for anything outside the
//! simulation. Only the VM confines scripts, without landlock, seccomp and resource limits: run
//! only scripts that you trust with that.

mod recorder;
mod running;
mod sim_clock;

use std::io;
use std::panic::resume_unwind;
use std::time::Duration;

pub use recorder::{Event, EventKind, Recorder, now};
pub use running::{Options, Running};
pub use sim_clock::{ClockMode, SimClock, TimeScale};
use tokio::runtime::{Builder, LocalOptions};
use tokio::time::Instant;

use crate::agent::{Behaviour, Plan};
use crate::behaviour::STACK;
use crate::clock;
use crate::link;
use crate::script;
use crate::sim::{self, World};

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

    /// Returns the simulation's seed.
    pub fn seed(&self) -> u64 {
        self.options.seed
    }

    /// Starts an agent with these behaviours. It ends when they have ended, after `limit`, or by
    /// [`Running::stop`] or [`Options::stop`]. It does nothing before the caller's next wait.
    /// Agents may run one after another; each finds the robot in the state in which the previous
    /// one left it.
    pub fn start(&self, behaviours: Vec<Behaviour>, limit: Option<Duration>) -> Running {
        Running::start(self.sim.clone(), &self.options, behaviours, limit)
    }

    /// Returns the plan of an agent for this simulation's robot, for callers that create the agent
    /// themselves, such as a service. Run that agent within the simulation.
    pub fn plan(&self, behaviours: Vec<Behaviour>) -> Plan {
        running::plan(self.sim.clone(), &self.options, behaviours)
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
