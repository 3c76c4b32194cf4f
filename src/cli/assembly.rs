//! The one assembly of a run in real time, of `spykee run` and of `spykee serve`: driving core,
//! agent, page, broker, journal, notifications and the socket for other commands.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::connection::RobotTarget;
use super::interrupt::handle_signals;
use super::startup::{
    JOURNAL_END, driving_core, emergency_stop, guardian_files, heartbeat, journal, launcher,
    refuse_if_stopped, rescue, runtime, serve, warn_of_unpaid_stop,
};
use super::status::{StatusLine, show};
use super::world::{EmbeddedSim, TraceFile};
use super::{Console, Exit, Failure, RUNTIME_LIMIT, fleet, live, notify};
use crate::agent::{Agent, AgentError, Behaviour, BehaviourSpec, Bus, Outcome, Plan};
use crate::behaviour::is_failure;
use crate::clock::{Clock, Date, Zone};
use crate::config::{Config, Effective};
use crate::control::{self, ControlServer, EmergencyStop, SimulatedRobot};
use crate::live::RunDefinition;
use crate::mqtt;
use crate::pilot::{DrivingCore, Status};
use crate::robot::EndReason;
use crate::timetable::View;

pub(super) struct RunSetup<'a> {
    pub(super) settings: &'a Effective,
    /// The robot, with the config in effect: flags may change that of the settings.
    pub(super) robot: RobotTarget,
    pub(super) seed: u64,
    pub(super) waits: bool,
    pub(super) keeps_journal: bool,
    pub(super) clock: Clock,
    /// The beginning of the status line.
    pub(super) names: String,
    pub(super) behaviours: Vec<Behaviour>,
    pub(super) specs: Vec<BehaviourSpec>,
    pub(super) limit: Option<Duration>,
    /// What the page knows of the behaviours, if the run has a page.
    pub(super) page: Option<watch::Receiver<RunDefinition>>,
    /// The picture of a simulated robot's path, drawn at the end.
    pub(super) trace: Option<TraceFile>,
    pub(super) service: Option<ServiceSetup>,
}

/// What a service has beyond a single run. It handles SIGHUP itself, also starts while a person's
/// STOP holds, and goes on when no behaviour runs.
pub(super) struct ServiceSetup {
    /// Told of each heartbeat of the driving core.
    pub(super) beats: Arc<Notify>,
    pub(super) view: watch::Receiver<View>,
}

pub(super) struct StartedRun {
    pub(super) agent: Agent,
    pub(super) status: watch::Receiver<Status>,
    pub(super) bus: Bus,
    /// Cancelled by signals; ends the run.
    pub(super) stop: CancellationToken,
}

impl RunSetup<'_> {
    /// Starts everything that a run needs, has `drive` run the agent, and ends the rest.
    pub(super) fn run(
        mut self,
        console: &Console,
        drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure>,
    ) -> Result<Exit, Failure> {
        let settings = self.settings;
        let config = &self.robot.config;
        let simulated = self.robot.sim.is_some();
        let runtime = runtime()?;
        // A person can release a STOP that holds at a page, and a service waits for that.
        if self.page.is_none() && self.service.is_none() {
            refuse_if_stopped(config, simulated)?;
        }
        warn_of_unpaid_stop(config);
        let bus = Bus::default();
        let emergency_stop = emergency_stop(config, simulated, &bus);
        let core = driving_core()?;
        let plan = self.plan(&core, &bus)?;
        let journal = if self.keeps_journal {
            let target = self.robot.address.to_string();
            journal(&self.robot.config, &bus, &target, simulated, self.clock)
        } else {
            None
        };
        let notifier = notify::start(settings, &bus)?;
        let trace = self.trace.take();
        let sim = self.robot.sim.as_ref().map(EmbeddedSim::handle);
        let outcome = runtime.block_on(self.run_agent(plan, &emergency_stop, console, drive));
        drop(core);
        runtime.shutdown_timeout(RUNTIME_LIMIT);
        emergency_stop.finish(JOURNAL_END);
        journal.map(|journal| journal.finish(JOURNAL_END));
        notifier.map(|notifier| notifier.finish(notify::SHUTDOWN_TIMEOUT));
        // Also drawn for a run that failed or was interrupted, where it is most useful.
        let drawn = match (trace, &sim) {
            (Some(trace), Some(sim)) => trace.write(sim),
            _ => Ok(()),
        };
        outcome.and_then(|exit| drawn.map(|()| exit))
    }

    fn plan(&mut self, core: &DrivingCore, bus: &Bus) -> Result<Plan, Failure> {
        let config = &self.robot.config;
        let simulated = self.robot.sim.is_some();
        let mut settings = config.pilot(simulated, self.seed);
        settings.waits = self.waits;
        let mut heartbeat = heartbeat(simulated, guardian_files(config))?;
        if let Some(service) = &self.service {
            heartbeat = heartbeat.notify_beats(service.beats.clone());
        }
        Ok(Plan {
            behaviours: std::mem::take(&mut self.behaviours),
            specs: std::mem::take(&mut self.specs),
            stays: self.page.is_some() || self.service.is_some(),
            settings,
            connector: self.robot.connector(),
            launcher: launcher()?,
            core: core.handle().clone(),
            heartbeat: Some(heartbeat),
            rescue: rescue(config, self.seed)?,
            limit: self.limit,
            bus: bus.clone(),
        })
    }

    /// The handles through which persons control the run.
    fn control_run(
        &self,
        agent: &Agent,
        status: &watch::Receiver<Status>,
        emergency_stop: &EmergencyStop,
    ) -> control::Run {
        let sim = self.robot.sim.as_ref().map(EmbeddedSim::handle);
        let service = self.service.as_ref();
        control::Run {
            requests: agent.requests(),
            roster: agent.roster(),
            status: status.clone(),
            pictures: agent.pictures(),
            reactions: agent.reactions(),
            end: None,
            emergency_stop: emergency_stop.clone(),
            streams: self.robot.config.streams,
            target: self.robot.address.to_string(),
            simulated: sim.is_some(),
            sim: self.page.as_ref().and(sim).map(SimulatedRobot::from),
            began: Instant::now(),
            // A single run has no timetable.
            view: service.map_or_else(|| View::channel().1, |service| service.view.clone()),
        }
    }

    /// Runs the agent, and serves page, broker and other commands meanwhile.
    async fn run_agent(
        self,
        plan: Plan,
        emergency_stop: &EmergencyStop,
        console: &Console,
        drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure>,
    ) -> Result<Exit, Failure> {
        let server = ControlServer::open(self.robot.config.data_folder());
        let account = fleet::account_of_run(self.settings)?;
        let core = plan.core.clone();
        let bus = plan.bus.clone();
        let sim = self.robot.sim.as_ref().map(EmbeddedSim::handle);
        let listener = bus.subscribe();
        let stop = CancellationToken::new();
        let (agent, status) = Agent::new(plan);
        emergency_stop.restore(&agent.requests());
        let is_service = self.service.is_some();
        let others: &[i32] = if is_service { &[libc::SIGHUP] } else { &[] };
        handle_signals(&core, agent.requests(), stop.clone(), others, None)?;
        let shared = self.control_run(&agent, &status, emergency_stop);
        // Only the command line ends a run: a person at the page could not release its STOP.
        let run = control::Run {
            end: if is_service { None } else { Some(stop.clone()) },
            ..shared.clone()
        };
        let config = &self.robot.config;
        let page = self
            .page
            .map(|page| live::serve(config, shared.clone(), page, listener, console));
        let _page = page.transpose()?;
        let mqtt = account.and_then(|account| {
            let started = mqtt::start(&bus, shared.clone(), account);
            // Without it, the run continues.
            started.map_err(|error| tracing::warn!("{error}")).ok()
        });
        let line = StatusLine::new(self.names, sim);
        let started = StartedRun {
            agent,
            status: status.clone(),
            bus,
            stop,
        };
        let exit = tokio::select! {
            exit = drive(started) => exit,
            never = show(line, status, console, is_service, String::new) => match never {},
            never = serve(server, run) => match never {},
        };
        mqtt.map(|mqtt| mqtt.finish(fleet::BROKER_END));
        exit
    }
}

/// The exit code for the outcome of a run, or of a service, which behaviours and signals do not
/// make fail.
pub(super) fn exit_of(
    outcome: Result<Outcome, AgentError>,
    is_service: bool,
) -> Result<Exit, Failure> {
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(AgentError::Link(error)) if error.is_final() => return Err(error.into()),
        Err(AgentError::Link(error)) => {
            let help = error.help();
            return Err(Failure::from(error).help(format!(
                "{help}; `spykee run --wait` retries until it answers"
            )));
        }
        Err(error @ AgentError::Broken(_)) => return Err(Failure::new(Exit::Failed, error)),
    };
    let ended_by = |is: fn(EndReason) -> bool| {
        let mut exits = outcome.exits.iter();
        !is_service && exits.any(|(_, exit)| is(exit.reason))
    };
    let interrupted = outcome.interrupted && !is_service;
    Ok(if outcome.owes_stop {
        Exit::Unreachable
    } else if interrupted && outcome.safety {
        Exit::Safety
    } else if interrupted {
        Exit::Interrupted
    } else if ended_by(is_failure) {
        Exit::Failed
    } else if outcome.safety || ended_by(|reason| reason == EndReason::Safety) {
        Exit::Safety
    } else {
        Exit::Done
    })
}

/// The clock for scripts and for the journal: the computer's, unless `--date` sets that of a
/// simulation. A fast one has its own.
pub(super) fn clock(date: Option<Date>, fast: bool, config: &Config) -> Clock {
    match date {
        Some(date) if !fast => Clock::set_to(date.at(&config.zone())),
        _ => Clock::default(),
    }
}

/// The time zone. A fast run does not use the computer's, to be the same on every computer.
pub(super) fn zone(fast: bool, config: &Config) -> Zone {
    if fast {
        config.time_zone.clone().unwrap_or_else(Zone::utc)
    } else {
        config.zone()
    }
}
