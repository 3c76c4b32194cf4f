//! A laboratory: a whole run in virtual time. Agent, behaviour hosts, watchdog and simulated robot
//! live on one thread, on one runtime whose clock jumps when everything waits, over pipes in
//! memory; codec, pilot, messages and script code are those of a run with a robot. The same world,
//! behaviours, options and seed give the same run, event by event, in every build.
//!
//! ```no_run
//! # fn main() -> std::io::Result<()> {
//! use spykee::{lab, sim::World};
//! # let behaviours = vec![];
//! let options = lab::Options { seed: 7, ..lab::Options::default() };
//! let docked = lab::run(World::default_world(), options, async |lab: &lab::Lab| {
//!     let run = lab.start(behaviours, None);
//!     lab.sim().set_battery(15.0);
//!     let home = lab.sim().wait_state(|state| state.docked && state.charging);
//!     let home = tokio::time::timeout(std::time::Duration::from_secs(300), home).await;
//!     run.stop();
//!     let outcome = run.outcome().await; // how each behaviour ended
//!     home.is_ok()
//! })?;
//! # Ok(()) }
//! ```
//!
//! [`run`] works on any thread, many at a time. It takes a thread of its own for the VMs' stack and
//! returns when the closure has. Within the closure `tokio::time` is virtual: sleep, timeout and
//! interval as you like, and always set limits, because virtual time can pass without end in no
//! real time. Wait for nothing outside the laboratory: virtual time would not stand still in the
//! meantime.
//!
//! A script's CPU budget is in real time, so that one that never waits is ended as on a robot,
//! while virtual time stands still. A host's walls are absent: only the VM confines scripts, not
//! landlock, seccomp and limits of the kernel; run only scripts that you trust with that.

mod event;
mod options;
mod recorder;
mod running;
mod tempo;

use std::io;
use std::panic::resume_unwind;
use std::time::Duration;

use tokio::runtime::{Builder, LocalOptions};
use tokio::time::Instant;

use crate::agent::{Behaviour, Plan};
use crate::behaviour::STACK;
use crate::clock;
use crate::script;
use crate::sim::{self, World};

pub use event::{Event, EventKind};
pub use options::Options;
pub use recorder::{Recorder, now};
pub use running::Running;
pub use tempo::{Factor, Going, Tempo};

/// A running laboratory.
pub struct Lab {
    sim: sim::Handle,
    began: Instant,
    options: Options,
}

/// Sets up a laboratory in this world and lets `work` work in it, in virtual time.
///
/// # Errors
/// If the system gives no thread or no runtime.
pub fn run<T: Send>(
    world: World,
    options: Options,
    work: impl AsyncFnOnce(&Lab) -> T + Send,
) -> io::Result<T> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new()
            .name("lab".into())
            .stack_size(STACK)
            .spawn_scoped(scope, {
                let parent = tracing::dispatcher::get_default(Clone::clone);
                let events = options.events.clone();
                move || recorder::under(parent, events, || live(world, options, work))
            })?;
        thread.join().unwrap_or_else(|panic| resume_unwind(panic))
    })
}

/// No I/O driver: nothing here waits for the world outside, and time jumps faster without.
fn live<T>(world: World, options: Options, work: impl AsyncFnOnce(&Lab) -> T) -> io::Result<T> {
    script::only_simulated();
    let runtime = Builder::new_current_thread()
        .enable_time()
        .start_paused(true)
        .build_local(LocalOptions::default())?;
    runtime.block_on(async {
        let began = recorder::begin();
        clock::begin_virtual(options.date);
        let sim_options = sim::Options {
            seed: options.seed,
            unacknowledged: Some(options.link.dead_after),
            ..options.sim.clone()
        };
        let server = sim::Server::detached(world, sim_options);
        let lab = Lab {
            sim: server.handle(),
            began,
            options,
        };
        if let Some(tempo) = lab.options.tempo.clone() {
            tokio::spawn(tempo.keep(began, lab.options.stop.clone()));
        }
        let server = tokio::spawn(server.run());
        let result = work(&lab).await;
        lab.record_end();
        server.abort();
        Ok(result)
    })
}

impl Lab {
    /// The simulated robot: its state, what it has heard, and all trouble one can make for it.
    pub fn sim(&self) -> &sim::Handle {
        &self.sim
    }

    /// Virtual time since the laboratory was set up.
    pub fn now(&self) -> Duration {
        self.began.elapsed()
    }

    /// The seed it was set up with.
    pub fn seed(&self) -> u64 {
        self.options.seed
    }

    /// Starts an agent with these behaviours, which ends when they have, after `limit`, by
    /// [`Running::stop`] or [`Options::stop`]. It does not move before the next wait. There may be
    /// one after the other: they find the robot as the last one left it.
    pub fn start(&self, behaviours: Vec<Behaviour>, limit: Option<Duration>) -> Running {
        Running::start(self.sim.clone(), &self.options, behaviours, limit)
    }

    /// What an agent on the robot of this laboratory needs, for who composes one by himself, such
    /// as a service: it is run within the laboratory.
    pub fn plan(&self, behaviours: Vec<Behaviour>) -> Plan {
        running::plan(self.sim.clone(), &self.options, behaviours)
    }

    fn record_end(&self) {
        let state = self.sim.state();
        let (pose, battery) = (state.pose, state.power.percent);
        tracing::debug!(
            target: "spykee::lab::end", x = pose.x, y = pose.y, heading = pose.heading, battery,
            docked = state.docked, distance = state.distance, collisions = state.collisions, "the end"
        );
    }
}
