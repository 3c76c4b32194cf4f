//! The one assembly of a run, of `spykee run` and of `spykee serve`: driving core, agent, page,
//! broker, journal, notifications and the socket for other commands. With `--fast` all of it but
//! the last three runs in a simulation: see [`fast`].

use std::io;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Notify, mpsc, watch};
use tokio_util::sync::CancellationToken;

use super::connection::{ChosenRobot, RobotTarget};
use super::interrupt::handle_signals;
use super::startup::{
    JOURNAL_END, driving_core, emergency_stop, guardian_files, journal, refuse_if_stopped, runtime,
    serve, warn_of_unpaid_stop,
};
use super::status::{StatusLine, show};
use super::world::{EmbeddedSim, TraceFile};
use super::{Console, Exit, Failure, RUNTIME_LIMIT, fast, fleet, live, notify};
use crate::agent::{Agent, AgentError, Behaviour, BehaviourSpec, Bus, Outcome, PilotPlan, Plan};
use crate::behaviour::is_failure;
use crate::clock::{Clock, Date, Zone};
use crate::config::{Config, Effective};
use crate::control::{self, ControlServer, EmergencyStop, SimulatedRobot};
use crate::journal::When;
use crate::live::{Live, RunDefinition};
use crate::mqtt;
use crate::pilot::{Settings, Status};
use crate::robot::EndReason;
use crate::sim::{self, Handle};
use crate::timetable::{TimetableOrder, View};

/// Maximum number of waiting changes of the timetable.
const MAX_CHANGES: usize = 8;

/// A run or a service, on whatever robot.
pub(super) struct RunSetup {
    /// The config in effect: flags may change that of the settings.
    pub(super) config: Config,
    /// The login, the seed, and what else a simulated robot needs.
    pub(super) sim_options: sim::Options,
    /// Runs in virtual time, as fast as possible.
    pub(super) fast: bool,
    /// The date and time at the start of a simulation, if it is not the present or usual one.
    pub(super) date: Option<Date>,
    /// Whether the first connection is repeated until it succeeds.
    pub(super) waits: bool,
    /// The beginning of the status line.
    pub(super) names: String,
    pub(super) behaviours: Vec<Behaviour>,
    pub(super) specs: Vec<BehaviourSpec>,
    pub(super) limit: Option<Duration>,
    /// What the page knows of the behaviours, if the run has a page.
    pub(super) page: Option<watch::Receiver<RunDefinition>>,
    /// The picture of a simulated robot's path, drawn at the end.
    pub(super) trace: Option<TraceFile>,
    /// With `fast`: the file for all events.
    pub(super) events: Option<PathBuf>,
    /// A service handles SIGHUP itself, also starts while a person's STOP holds, and goes on when
    /// no behaviour runs.
    pub(super) is_service: bool,
}

/// The robot of a run: a real one, one that a simulator beside the run serves, or that of a
/// simulation.
pub(super) struct RunRobot {
    pub(super) pilot: PilotPlan,
    /// Its address as given to the run.
    pub(super) target: String,
    pub(super) sim: Option<SimulatedRobot>,
    pub(super) emergency_stop: EmergencyStop,
    pub(super) stop: CancellationToken,
}

/// A run that has been assembled, for its `drive`.
pub(super) struct StartedRun {
    pub(super) agent: Agent,
    /// The handles through which persons control it.
    pub(super) control: control::Run,
    pub(super) status: watch::Receiver<Status>,
    pub(super) bus: Bus,
    /// Told of each heartbeat of the driving core.
    pub(super) beats: Arc<Notify>,
    /// For the next start of a timetable.
    pub(super) view: watch::Sender<View>,
    /// What people change of a timetable.
    pub(super) changes: mpsc::Receiver<TimetableOrder>,
    /// Cancelled by signals; ends the run.
    pub(super) stop: CancellationToken,
}

impl RunSetup {
    /// Starts everything that a run of this robot needs, has `drive` run the agent, and ends the
    /// rest.
    pub(super) fn run(
        self,
        robot: ChosenRobot,
        settings: &Effective,
        console: &Console,
        drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure> + Send + 'static,
    ) -> Result<Exit, Failure> {
        if self.fast {
            return fast::run(self, robot.into_world()?, console, drive);
        }
        let robot = robot.start(self.config.clone(), self.sim_options.clone())?;
        self.run_in_real_time(&robot, settings, console, drive)
    }

    fn run_in_real_time(
        mut self,
        robot: &RobotTarget,
        settings: &Effective,
        console: &Console,
        drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure>,
    ) -> Result<Exit, Failure> {
        let config = &self.config;
        let simulated = robot.sim.is_some();
        let target = robot.address.to_string();
        let runtime = runtime()?;
        // A person can release a STOP that holds at a page, and a service waits for that.
        if self.page.is_none() && !self.is_service {
            refuse_if_stopped(config, simulated)?;
        }
        warn_of_unpaid_stop(config);
        let core = driving_core()?;
        let server = ControlServer::open(config.data_folder());
        let files = guardian_files(config, server.as_ref().ok());
        let pilot = robot.pilot_plan(&core, files, self.sim_options.seed)?;
        let bus = pilot.bus.clone();
        let emergency_stop = emergency_stop(config, simulated, &bus);
        let journal = if self.keeps_journal() {
            let clock = clock(self.date, false, config);
            journal(config, &bus, &target, simulated, clock)
        } else {
            None
        };
        let notifier = notify::start(settings, &bus)?;
        let trace = self.trace.take();
        let sim = robot.sim.as_ref().map(EmbeddedSim::handle);
        let run_robot = RunRobot {
            pilot,
            target,
            sim: sim.clone().map(SimulatedRobot::from),
            emergency_stop: emergency_stop.clone(),
            stop: CancellationToken::new(),
        };
        let outcome = self.serve(server, run_robot, settings, console, drive);
        let outcome = runtime.block_on(outcome);
        drop(core);
        runtime.shutdown_timeout(RUNTIME_LIMIT);
        emergency_stop.finish(JOURNAL_END);
        journal.map(|journal| journal.finish(JOURNAL_END));
        notifier.map(|notifier| notifier.finish(notify::SHUTDOWN_TIMEOUT));
        with_trace(outcome, trace, sim)
    }

    /// Whether the journal is kept: by default only that of a service in real time.
    pub(super) fn keeps_journal(&self) -> bool {
        match self.config.journal.record {
            When::On => true,
            When::Auto => self.is_service && !self.fast,
            When::Off => false,
        }
    }

    fn plan(&mut self, pilot: PilotPlan, beats: Arc<Notify>) -> Plan {
        Plan {
            behaviours: std::mem::take(&mut self.behaviours),
            specs: std::mem::take(&mut self.specs),
            stays: self.page.is_some() || self.is_service,
            limit: self.limit,
            pilot: PilotPlan {
                settings: Settings {
                    waits: self.waits,
                    ..pilot.settings
                },
                heartbeat: pilot.heartbeat.map(|one| one.notify_beats(beats)),
                ..pilot
            },
        }
    }

    /// Builds the agent of this robot, and serves its page. In real time, signals end the run from
    /// now on. Also returns the handles through which persons control the run.
    pub(super) fn assemble(
        &mut self,
        robot: RunRobot,
        console: &Console,
    ) -> Result<(StartedRun, control::Run, Option<Live>), Failure> {
        let pilot = robot.pilot;
        let bus = pilot.bus.clone();
        let listener = bus.subscribe();
        let beats = Arc::new(Notify::new());
        let signals_on = pilot.heartbeat.as_ref().map(|_| pilot.core.clone());
        let (agent, status) = Agent::new(self.plan(pilot, beats.clone()));
        robot.emergency_stop.restore(&agent.requests());
        if let Some(core) = signals_on {
            let hangup = [libc::SIGHUP];
            let others = if self.is_service { &hangup[..] } else { &[] };
            handle_signals(&core, agent.requests(), robot.stop.clone(), others, None)?;
        }
        let (view, seen) = View::channel();
        let (timetable, changes) = mpsc::channel(MAX_CHANGES);
        let control = control::Run {
            streams: self.config.streams,
            simulated: robot.sim.is_some(),
            sim: self.page.as_ref().and(robot.sim),
            view: seen,
            timetable,
            ..control::Run::new(&agent, &robot.target, robot.emergency_stop, status.clone())
        };
        let page = self.page.take();
        let page =
            page.map(|page| live::serve(&self.config, control.clone(), page, listener, console));
        let started = StartedRun {
            agent,
            control: control.clone(),
            status,
            bus,
            beats,
            view,
            changes,
            stop: robot.stop,
        };
        Ok((started, control, page.transpose()?))
    }

    /// Runs the agent, and serves page, broker and other commands meanwhile.
    async fn serve(
        mut self,
        server: io::Result<ControlServer>,
        robot: RunRobot,
        settings: &Effective,
        console: &Console,
        drive: impl AsyncFnOnce(StartedRun) -> Result<Exit, Failure>,
    ) -> Result<Exit, Failure> {
        let account = fleet::account_of_run(settings)?;
        let sim = robot.sim.as_ref().map(|sim| sim.robot.clone());
        let (started, control, _page) = self.assemble(robot, console)?;
        // Only the command line ends a run: a person at the page could not release its STOP.
        let run = control::Run {
            end: if self.is_service {
                None
            } else {
                Some(started.stop.clone())
            },
            ..control.clone()
        };
        let mqtt = account.and_then(|account| {
            let started = mqtt::start(&started.bus, control, account);
            // Without it, the run continues.
            started.map_err(|error| tracing::warn!("{error}")).ok()
        });
        let line = StatusLine::new(self.names, sim);
        let status = started.status.clone();
        let exit = tokio::select! {
            exit = drive(started) => exit,
            never = show(line, status, console, self.is_service, String::new) => match never {},
            never = serve(server, run) => match never {},
        };
        mqtt.map(|mqtt| mqtt.finish(fleet::BROKER_END));
        exit
    }
}

/// Draws the path of a simulated robot, also of a run that failed or was interrupted, where it is
/// most useful.
pub(super) fn with_trace(
    outcome: Result<Exit, Failure>,
    trace: Option<TraceFile>,
    sim: Option<Handle>,
) -> Result<Exit, Failure> {
    let drawn = match (trace, sim) {
        (Some(trace), Some(sim)) => trace.write(&sim),
        _ => Ok(()),
    };
    outcome.and_then(|exit| drawn.map(|()| exit))
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
