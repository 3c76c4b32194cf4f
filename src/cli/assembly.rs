//! The one assembly of a run in real time, of `spykee run` and of `spykee serve`: simulator, driving
//! core, agent, page, broker, journal, notifications and the socket for other commands.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::runtime::{Handle, Runtime};
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::embedded::{EmbeddedSim, Simulated};
use super::live::PageInputs;
use super::robot_target::{ChosenRobot, connector};
use super::startup::{
    JOURNAL_END, driving_core, emergency_stop, guardian_files, heartbeat, journal, launcher,
    refuse_if_stopped, rescue, runtime, warn_of_unpaid_stop,
};
use super::status::StatusLine;
use super::{Console, Failure, RUNTIME_LIMIT, broker, notify};
use crate::agent::{
    Agent, Behaviour, BehaviourSpec, Bus, ConnectAttempts, Plan, retry_until_connected,
};
use crate::clock::Clock;
use crate::config::Effective;
use crate::control::{self, ControlServer, EmergencyStop, SimulatedRobot};
use crate::journal::Journal;
use crate::live::{Live, RunDefinition};
use crate::mqtt::Account;
use crate::notify::Notifier;
use crate::pilot::{DrivingCore, Status};
use crate::robot::channel::Request;
use crate::sim::{self, Firmware};
use crate::timetable::View;
use crate::wire::Login;

/// What distinguishes one run from another.
pub(super) struct RunSetup<'a> {
    /// The settings; the page's address may come from a flag.
    pub(super) settings: &'a Effective,
    pub(super) robot: ChosenRobot,
    pub(super) login: Login,
    pub(super) seed: u64,
    pub(super) firmware: Firmware,
    /// Retry until the robot answers.
    pub(super) waits: bool,
    /// Start although a person's STOP holds.
    pub(super) waits_for_reset: bool,
    pub(super) keeps_journal: bool,
    pub(super) clock: Clock,
    /// The beginning of the status line.
    pub(super) names: String,
    pub(super) behaviours: Vec<Behaviour>,
    pub(super) specs: Vec<BehaviourSpec>,
    /// Continue when no behaviour runs.
    pub(super) stays: bool,
    pub(super) limit: Option<Duration>,
    /// What the page knows of the behaviours, if the run has a page.
    pub(super) page: Option<watch::Receiver<RunDefinition>>,
    /// Told of each heartbeat of the driving core.
    pub(super) beats: Option<Arc<Notify>>,
}

/// A run that is ready to start.
pub(super) struct Assembly {
    runtime: Runtime,
    core: DrivingCore,
    sim: Option<EmbeddedSim>,
    journal: Option<Journal>,
    notifier: Option<Notifier>,
    emergency_stop: EmergencyStop,
    parts: RunParts,
}

/// The parts of a run that live on its runtime.
pub(super) struct RunParts {
    plan: Plan,
    line: StatusLine,
    server: io::Result<ControlServer>,
    target: String,
    emergency_stop: EmergencyStop,
    page: Option<(PageInputs, Option<sim::Handle>)>,
    account: Option<Account>,
}

/// A run whose agent can be run.
pub(super) struct StartedRun {
    pub(super) agent: Agent,
    pub(super) status: watch::Receiver<Status>,
    pub(super) bus: Bus,
    pub(super) run: control::Run,
    pub(super) line: StatusLine,
    pub(super) server: io::Result<ControlServer>,
    pub(super) mqtt: Option<crate::side_thread::SideThread>,
    /// Ends with the run.
    _page: Option<Live>,
}

impl Assembly {
    /// Starts simulator, driving core, guardian, journal and notifications.
    pub(super) fn new(setup: RunSetup<'_>) -> Result<Assembly, Failure> {
        let config = &setup.settings.config;
        let runtime = runtime()?;
        let kind = Simulated {
            faults: setup.page.is_some(),
            firmware: setup.firmware,
        };
        let (target, sim) = setup.robot.start(&setup.login, setup.seed, kind)?;
        // A person can release a STOP that holds at a page, and a service waits for that.
        if setup.page.is_none() && !setup.waits_for_reset {
            refuse_if_stopped(config, sim.is_some())?;
        }
        warn_of_unpaid_stop(config);
        let bus = Bus::default();
        let emergency_stop = emergency_stop(config, sim.is_some(), &bus);
        let handle = sim.as_ref().map(EmbeddedSim::handle);
        let simulated = sim.is_some();
        let server = ControlServer::open(config.data_folder());
        let core = driving_core()?;
        let attempts = ConnectAttempts::default();
        let mut connector = connector(target.clone(), setup.login);
        if setup.waits {
            connector = retry_until_connected(connector, setup.seed, attempts.clone());
        }
        let mut heartbeat = heartbeat(simulated, guardian_files(config))?;
        if let Some(beats) = setup.beats {
            heartbeat = heartbeat.notify_beats(beats);
        }
        let page = setup.page.map(|page| PageInputs::new(config, page, &bus));
        let plan = Plan {
            behaviours: setup.behaviours,
            specs: setup.specs,
            stays: setup.stays,
            settings: config.pilot(simulated, setup.seed),
            connector,
            launcher: launcher()?,
            core: core.handle().clone(),
            heartbeat: Some(heartbeat),
            rescue: rescue(config, setup.seed)?,
            limit: setup.limit,
            bus: bus.clone(),
        };
        let target = target.to_string();
        let account = broker::of_run(setup.settings)?;
        let journal = if setup.keeps_journal {
            journal(config, &bus, &target, simulated, setup.clock)
        } else {
            None
        };
        Ok(Assembly {
            runtime,
            core,
            journal,
            notifier: notify::start(setup.settings, &bus)?,
            emergency_stop: emergency_stop.clone(),
            parts: RunParts {
                plan,
                line: StatusLine::new(setup.names, handle.clone(), attempts),
                server,
                target,
                emergency_stop,
                page: page.map(|page| (page, handle)),
                account,
            },
            sim,
        })
    }

    /// The simulated robot.
    pub(super) fn sim(&self) -> Option<sim::Handle> {
        self.sim.as_ref().map(EmbeddedSim::handle)
    }

    /// Runs to the end, then ends everything beside the agent.
    pub(super) fn run<T>(self, drive: impl AsyncFnOnce(RunParts) -> T) -> T {
        let outcome = self.runtime.block_on(drive(self.parts));
        drop(self.core);
        self.runtime.shutdown_timeout(RUNTIME_LIMIT);
        self.emergency_stop.finish(JOURNAL_END);
        self.journal.map(|journal| journal.finish(JOURNAL_END));
        let notifier = self.notifier;
        notifier.map(|notifier| notifier.finish(notify::SHUTDOWN_TIMEOUT));
        outcome
    }
}

impl RunParts {
    /// Starts the agent's parts, page and broker. Signals cancel `stop`; `end` ends a run at a
    /// person's request.
    pub(super) fn start(
        self,
        stop: &CancellationToken,
        end: Option<CancellationToken>,
        handle_signals: fn(
            &Handle,
            mpsc::Sender<Request>,
            CancellationToken,
        ) -> Result<(), Failure>,
        view: watch::Receiver<View>,
        console: &Console,
    ) -> Result<StartedRun, Failure> {
        let core = self.plan.core.clone();
        let bus = self.plan.bus.clone();
        let streams = self.plan.settings.streams;
        let simulated = self.plan.settings.simulated;
        let (agent, status) = Agent::new(self.plan);
        self.emergency_stop.restore(&agent.requests());
        handle_signals(&core, agent.requests(), stop.clone())?;
        let (page, sim) = match self.page {
            Some((page, sim)) => (Some(page), sim.map(SimulatedRobot::from)),
            None => (None, None),
        };
        let run = control::Run {
            requests: agent.requests(),
            roster: agent.roster(),
            status: status.clone(),
            pictures: agent.pictures(),
            reactions: agent.reactions(),
            end,
            emergency_stop: self.emergency_stop,
            streams,
            target: self.target,
            simulated,
            sim,
            began: Instant::now(),
            view,
        };
        // Only the command line ends a run: a person at the page could not release its STOP.
        let shared = control::Run {
            end: None,
            ..run.clone()
        };
        let page = page.map(|page| page.serve(shared.clone(), console));
        Ok(StartedRun {
            agent,
            status,
            line: self.line,
            server: self.server,
            _page: page.transpose()?,
            mqtt: broker::start(&bus, &shared, self.account),
            bus,
            run,
        })
    }
}
