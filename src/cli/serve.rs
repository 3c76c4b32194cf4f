//! `spykee serve`: runs a robot permanently, by timetable and on request.

mod fast;
mod service_plan;

use std::path::PathBuf;
use std::sync::Arc;

use jiff::Timestamp;
use tokio::sync::{Notify, mpsc, watch};
use tokio_util::sync::CancellationToken;

use self::service_plan::{LoadedPlan, PlanLoader};
use super::assembly::{Assembly, RunParts, RunSetup};
use super::interrupt::{handle_service_signals, listen};
use super::privileges::drop_root;
use super::robot_target::ChosenRobot;
use super::settings::SettingsArgs;
use super::startup::{self, show};
use super::{ConnectionArgs, Console, Exit, Failure, broker};
use crate::agent::{AgentError, Outcome};
use crate::clock::{Clock, Date, Span, Zone};
use crate::config::Config;
use crate::journal::When;
use crate::live::RunDefinition;
use crate::service::{ManagerNotifier, RecordFile, Service, View};
use crate::sim::Firmware;
use crate::vision::Camera;

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

pub(super) fn run(args: &ServeArgs, console: &Console) -> Result<Exit, Failure> {
    let mut config = args.settings.config()?.clone();
    let robot = ChosenRobot::required(ChosenRobot::load(&args.connection, &mut config)?)?;
    let login = args.connection.login.login(args.settings.load()?)?;
    let simulated = robot.is_simulated();
    let clock = clock(args, &config, simulated)?;
    become_user(&config, simulated)?;
    args.settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let camera = if simulated { Some(config.camera) } else { None };
    let loader = plan_loader(args, console, seed, clock, camera);
    let loaded = loader.load(&config)?;
    if args.fast {
        return fast::serve(args, robot, login, &config, loaded, seed, console);
    }
    let record = RecordFile::open(config.data_folder());
    let beats = Arc::new(Notify::new());
    let (definition, shown) = watch::channel(loaded.definition.clone());
    let mut settings = args.settings.load()?.clone();
    settings.config = config.clone();
    let assembly = Assembly::new(RunSetup {
        settings: &settings,
        robot,
        login,
        seed,
        firmware: Firmware::default(),
        waits: true,
        waits_for_reset: true,
        keeps_journal: config.journal.record != When::Off,
        clock,
        names: "serves".to_owned(),
        behaviours: Vec::new(),
        specs: loaded.service_plan.specs.clone(),
        stays: true,
        limit: args.limit.map(Span::get),
        page: config.live.listen.map(|_| shown),
        beats: Some(beats.clone()),
    })?;
    let outcome = assembly.run(async |parts| {
        let parts = ServiceParts {
            parts,
            clock,
            record,
            beats,
            loader,
            config,
            loaded,
            definition,
        };
        serve(parts, console).await
    });
    exit(outcome?)
}

/// A service of a simulated robot keeps its user, unless the config names one.
fn become_user(config: &Config, simulated: bool) -> Result<(), Failure> {
    let user = config.service.user.as_deref();
    if simulated && user.is_none() {
        return Ok(());
    }
    drop_root(user, config.data_folder())
}

fn plan_loader(
    args: &ServeArgs,
    console: &Console,
    seed: u64,
    clock: Clock,
    camera: Option<Camera>,
) -> PlanLoader {
    PlanLoader {
        settings: args.settings.clone(),
        checked: !args.no_check,
        seed,
        console: console.clone(),
        clock,
        camera,
        zone: if args.fast {
            Zone::utc()
        } else {
            Zone::system()
        },
    }
}

struct ServiceParts {
    parts: RunParts,
    clock: Clock,
    record: RecordFile,
    /// Heartbeats of the driving core.
    beats: Arc<Notify>,
    loader: PlanLoader,
    config: Config,
    loaded: LoadedPlan,
    /// What the page knows of the behaviours.
    definition: watch::Sender<RunDefinition>,
}

async fn serve(
    service: ServiceParts,
    console: &Console,
) -> Result<Result<Outcome, AgentError>, Failure> {
    let stop = CancellationToken::new();
    let hangup = listen(libc::SIGHUP)?;
    let (view, seen) = View::channel();
    let started = (service.parts).start(&stop, None, handle_service_signals, seen, console)?;
    let (reload, reloads) = mpsc::channel(1);
    let notifier = ManagerNotifier::of_environment();
    let running = Service {
        agent: started.agent,
        status: started.status.clone(),
        clock: service.clock,
        service_plan: service.loaded.service_plan.clone(),
        record: service.record,
        notifier: notifier.clone(),
        bus: started.bus,
        view,
        reloads,
    };
    let line = started.line;
    let status = started.status;
    let showing = async {
        match console.has_status_line() {
            true => show(line, status, console).await,
            // Status lines would flood a log file that covers weeks.
            false => std::future::pending().await,
        }
    };
    let definition = service.definition;
    let reloading = (service.loader).reload_on_hangup(
        hangup,
        reload,
        definition,
        service.config,
        service.loaded,
    );
    let outcome = tokio::select! {
        outcome = running.run(stop) => outcome,
        never = showing => match never {},
        never = startup::serve(started.server, started.run) => match never {},
        never = notifier.pass_on(service.beats) => match never {},
        never = reloading => match never {},
    };
    started
        .mqtt
        .map(|mqtt| mqtt.finish(broker::SHUTDOWN_TIMEOUT));
    Ok(outcome)
}

fn exit(outcome: Result<Outcome, AgentError>) -> Result<Exit, Failure> {
    match outcome {
        Ok(outcome) if outcome.owes_stop => Ok(Exit::Unreachable),
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
