//! `spykee serve`: runs a robot permanently, by timetable and on request.

mod fast;
mod service_plan;

use std::path::PathBuf;
use std::sync::Arc;

use jiff::Timestamp;
use tokio::sync::{Notify, mpsc, watch};
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use self::service_plan::{LoadedPlan, PlanLoader};
use super::embedded::{EmbeddedSim, Simulated};
use super::interrupt::{handle_service_signals, listen};
use super::live::PageInputs;
use super::privileges::drop_root;
use super::robot_target::{connector, resolve_or_simulate_with, robot_choice};
use super::settings::SettingsArgs;
use super::startup::{self, driving_core, heartbeat, rescue, show};
use super::status::StatusLine;
use super::{ConnectionArgs, Console, Exit, Failure, RobotChoice, broker, notify};
use crate::agent::{Agent, AgentError, Bus, ConnectAttempts, Outcome, Plan, retry_until_connected};
use crate::clock::{Clock, Date, Span, Zone};
use crate::config::Config;
use crate::control::{self, ControlServer, EmergencyStop};
use crate::journal::When;
use crate::link::Target;
use crate::live::{RunDefinition, SimulatedRobot};
use crate::mqtt::Account;
use crate::service::{ManagerNotifier, RecordFile, Service, View};
use crate::sim::Handle;
use crate::timetable::Record;

/// Run a robot permanently: behaviours always on, by timetable or on request
///
/// Waits for a robot that does not answer, or that another program uses. The config's behaviours
/// start at once, except those in the timetable and those with `start: asked`; `spykee behaviour
/// start` starts any of them. An idle robot is sent to its station. SIGHUP reloads the config;
/// unchanged behaviours continue. SIGTERM shuts the service down; a scheduled run that this
/// interrupts resumes when the service starts again.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee serve --config /etc/spykee/spykee.yaml\n  \
                        spykee serve --sim --date \"2026-03-29 01:59\"\n\n\
                  `spykee config schedule` lists the coming starts, `spykee service` creates a systemd unit."
)]
pub(super) struct ServeArgs {
    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// With --sim: date and time at the start, in the config's time zone [default: now; with
    /// --fast: 2026-01-01 09:00 UTC]
    #[arg(long, value_name = "DATE")]
    date: Option<Date>,

    /// Seed for math.random and simulator noise [default: random]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    /// With --sim and --for: run in virtual time, as fast as possible; the same seed gives the same
    /// days. An interrupted scheduled run is not resumed later, and a journal is kept only with
    /// `journal: { record: on }`
    #[arg(long, requires = "limit")]
    fast: bool,

    /// Time limit of the service, in seconds or such as 30m or 7d
    #[arg(long = "for", value_name = "TIME")]
    limit: Option<Span>,

    /// With --fast: write all events to this file, one JSON object per line
    #[arg(long, value_name = "FILE", requires = "fast")]
    events: Option<PathBuf>,

    /// Skip the check of the scripts before the start
    #[arg(long)]
    no_check: bool,

    #[command(flatten)]
    connection: ConnectionArgs,
}

/// Serves until a signal ends it.
///
/// # Errors
/// Anything that prevents the service from starting: files, config; a login that the robot refuses.
pub(super) fn run(args: &ServeArgs, console: &Console) -> Result<Exit, Failure> {
    let config = args.settings.config()?.clone();
    let choice = robot_choice(&args.connection, &config)?;
    let login = args.connection.login.login(args.settings.load()?)?;
    let simulated = matches!(choice, RobotChoice::Sim(_));
    let clock = clock(args, &config, simulated)?;
    if !simulated || config.service.user.is_some() {
        drop_root(config.service.user.as_deref(), config.data_folder())?;
    }
    args.settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let loader = PlanLoader {
        settings: args.settings.clone(),
        checked: !args.no_check,
        seed,
        console: console.clone(),
        clock,
        zone: if args.fast {
            Zone::utc()
        } else {
            Zone::system()
        },
    };
    let loaded = loader.load(&config)?;
    if args.fast {
        return fast::serve(args, choice, login, &config, loaded, seed, console);
    }
    let runtime = startup::runtime()?;
    let kind = Simulated {
        faults: config.live.listen.is_some(),
        ..Simulated::default()
    };
    let (target, sim) = resolve_or_simulate_with(choice, &login, seed, kind)?;
    let server = ControlServer::open(config.data_folder());
    let emergency_stop = startup::emergency_stop(&config, simulated);
    let record = RecordFile::open(config.data_folder());
    let core = driving_core()?;
    let bus = Bus::default();
    let attempts = ConnectAttempts::default();
    let beats = Arc::new(Notify::new());
    let plan = Plan {
        behaviours: Vec::new(),
        specs: loaded.service_plan.specs.clone(),
        stays: true,
        settings: config.pilot(simulated, seed),
        connector: retry_until_connected(
            connector(target.clone(), login, config.link.clone()),
            config.link.clone(),
            seed,
            attempts.clone(),
        ),
        launcher: startup::launcher()?,
        core: core.handle().clone(),
        heartbeat: Some(heartbeat(simulated).notify_beats(beats.clone())),
        rescue: rescue(&config, seed)?,
        limit: args.limit.map(Span::get),
        bus: bus.clone(),
    };
    let journal = match config.journal.record {
        When::Off => None,
        _ => startup::journal(&config, &bus, &(target.to_string(), simulated), clock),
    };
    let account = broker::of_run(args.settings.load()?)?;
    let (definition, shown) = watch::channel(loaded.definition.clone());
    let page = config
        .live
        .listen
        .map(|_| PageInputs::new(&config, shown, &bus));
    let page = page.map(|page| (page, sim.as_ref().map(EmbeddedSim::handle)));
    let notifier = notify::start(args.settings.load()?, &bus)?;
    let line = StatusLine::new(
        "serves".to_owned(),
        sim.as_ref().map(EmbeddedSim::handle),
        attempts,
    );
    let outcome = runtime.block_on(serve(
        ServiceParts {
            plan,
            clock,
            record,
            server,
            emergency_stop: emergency_stop.clone(),
            target,
            beats,
            loader,
            config,
            loaded,
            page,
            definition,
            account,
            line,
        },
        console,
    ));
    drop(core);
    runtime.shutdown_timeout(super::RUNTIME_LIMIT);
    emergency_stop.finish(startup::JOURNAL_END);
    journal.map(|journal| journal.finish(startup::JOURNAL_END));
    notifier.map(|notifier| notifier.finish(notify::SHUTDOWN_TIMEOUT));
    drop(sim);
    exit(outcome?)
}

/// The parts needed to run a service.
struct ServiceParts {
    plan: Plan,
    clock: Clock,
    record: (Record, Option<RecordFile>),
    server: std::io::Result<ControlServer>,
    emergency_stop: EmergencyStop,
    target: Target,
    /// Heartbeats of the driving core.
    beats: Arc<Notify>,
    loader: PlanLoader,
    config: Config,
    loaded: LoadedPlan,
    page: Option<(PageInputs, Option<Handle>)>,
    /// What the page knows of the behaviours.
    definition: watch::Sender<RunDefinition>,
    account: Option<Account>,
    line: StatusLine,
}

async fn serve(
    parts: ServiceParts,
    console: &Console,
) -> Result<Result<Outcome, AgentError>, Failure> {
    let ended_by_person = CancellationToken::new();
    let stop = ended_by_person.child_token();
    let core = parts.plan.core.clone();
    let settings = parts.plan.settings.clone();
    let bus = parts.plan.bus.clone();
    let (agent, status) = Agent::new(parts.plan);
    parts.emergency_stop.restore(&agent.requests());
    let hangup = listen(libc::SIGHUP)?;
    handle_service_signals(&core, agent.requests(), stop.clone())?;
    let (view, seen) = View::channel();
    let run_handle = control::Run {
        requests: agent.requests(),
        roster: agent.roster(),
        status: status.clone(),
        pictures: agent.pictures(),
        reactions: agent.reactions(),
        stop: ended_by_person.clone(),
        emergency_stop: parts.emergency_stop,
        streams: settings.streams,
        target: parts.target.to_string(),
        simulated: settings.simulated,
        began: Instant::now(),
        view: seen,
    };
    let (reload, reloads) = mpsc::channel(1);
    let page = parts
        .page
        .map(|(page, sim)| page.serve(run_handle.clone(), sim.map(SimulatedRobot::from), console));
    let _page = page.transpose()?;
    let mqtt = broker::start(&bus, &run_handle, parts.account);
    let notifier = ManagerNotifier::of_environment();
    let service = Service {
        agent,
        status: status.clone(),
        clock: parts.clock,
        service_plan: parts.loaded.service_plan.clone(),
        record: parts.record,
        notifier: notifier.clone(),
        bus,
        view,
        reloads,
        ended_by_person,
    };
    let line = parts.line;
    let showing = async {
        match console.has_status_line() {
            true => show(line, status, console).await,
            // Status lines would flood a log file that covers weeks.
            false => std::future::pending().await,
        }
    };
    let now = (parts.config, parts.loaded);
    let reloading = parts
        .loader
        .reload_on_hangup(hangup, reload, parts.definition, now);
    let outcome = tokio::select! {
        outcome = service.run(stop) => outcome,
        never = showing => match never {},
        never = startup::serve(parts.server, run_handle) => match never {},
        never = notifier.pass_on(parts.beats) => match never {},
        never = reloading => match never {},
    };
    mqtt.map(|mqtt| mqtt.finish(broker::SHUTDOWN_TIMEOUT));
    Ok(outcome)
}

fn exit(outcome: Result<Outcome, AgentError>) -> Result<Exit, Failure> {
    match outcome {
        Ok(outcome) if outcome.safety => Ok(Exit::Safety),
        Ok(_) => Ok(Exit::Done),
        Err(AgentError::Link(error)) => Err(error.into()),
        Err(error @ AgentError::Broken(_)) => Err(Failure::new(Exit::Failed, error)),
    }
}

/// The computer's clock, unless `--date` sets the clock of a simulation.
fn clock(args: &ServeArgs, config: &Config, simulated: bool) -> Result<Clock, Failure> {
    match args.date {
        None => Ok(Clock::default()),
        Some(_) if args.fast && simulated => Ok(Clock::default()),
        Some(date) if simulated => Ok(Clock::set_to(date.at(&config.zone()))),
        Some(_) => Err(Failure::usage(
            "--date needs --sim: a real robot uses today's date",
        )),
    }
}

/// The time from which to list the schedule: the given date, or now.
#[must_use]
pub(super) fn or_now(date: Option<Date>, config: &Config) -> Timestamp {
    date.map_or_else(|| Clock::default().now(), |date| date.at(&config.zone()))
}
