//! `spykee run`: behaviours on a robot, or on a simulated one inside this program.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use tokio::sync::watch;
use tokio_util::sync::CancellationToken;

use super::assembly::{Assembly, RunParts, RunSetup};
use super::behaviour_loader::{BehaviourLoader, LoadedBehaviours};
use super::fast::{EventFile, Fast, SimulationJournalOptions};
use super::interrupt::handle_signals;
use super::live::PageInputs;
use super::params::Param;
use super::robot_target::ChosenRobot;
use super::settings::SettingsArgs;
use super::sim::FirmwareArgs;
use super::startup::{serve, show};
use super::world::TraceFile;
use super::{ConnectionArgs, Console, Exit, Failure, broker, check};
use crate::agent::{AgentError, Behaviour, Outcome};
use crate::behaviour::{RestartPolicy, is_failure};
use crate::clock::{Clock, Date, Span, Zone};
use crate::config::{Config, Entry};
use crate::journal;
use crate::link::LinkError;
use crate::live::{RunDefinition, Script};
use crate::robot::EndReason;
use crate::sim;
use crate::simulation::{self, SimClock};
use crate::timetable::View;
use crate::wire::Login;

/// Run behaviours on a robot, or on a simulated one with --sim
#[derive(Debug, Clone, clap::Args)]
pub(super) struct RunArgs {
    /// Behaviour scripts; several run at the same time [default: the config's behaviours]
    #[arg(value_name = "FILE.lua")]
    files: Vec<PathBuf>,

    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Retry until the robot answers, instead of ending with exit code 3
    #[arg(long, conflicts_with = "fast")]
    wait: bool,

    /// Time limit of the run after the first connection, in seconds or such as 30m or 1h30m
    #[arg(long = "for", value_name = "TIME")]
    limit: Option<Span>,

    /// Seed for math.random and simulator noise [default: random]
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    /// Save the frames that the behaviours look at, with everything they find marked:
    /// DIR/BEHAVIOUR/00.jpg to 99.jpg, at most two per second, the newest hundred
    #[arg(long, value_name = "DIR")]
    annotate: Option<PathBuf>,

    /// Whether to restart a behaviour that failed, after growing pauses and a limited number of
    /// times; overrides the config for all behaviours
    #[arg(long, value_name = "POLICY", value_parser = restart_words())]
    restart: Option<RestartPolicy>,

    /// Reload a behaviour when its file is saved; Ctrl-C ends the run
    #[arg(long, conflicts_with = "fast")]
    watch: bool,

    /// With --sim: draw the robot's path and the events on the map of its world into this file
    #[arg(long, value_name = "FILE.png", value_parser = super::world::parse_png)]
    trace: Option<PathBuf>,

    /// With --sim: run in virtual time, as fast as possible; the same seed gives the same run
    #[arg(long)]
    fast: bool,

    /// With --sim: date and time at the start, in the config's time zone [default: now; with
    /// --fast: 2026-01-01 09:00 UTC]
    #[arg(long, value_name = "DATE")]
    date: Option<Date>,

    /// With --fast: write all events to this file, one JSON object per line
    #[arg(long, value_name = "FILE", requires = "fast")]
    events: Option<PathBuf>,

    /// Serve a web page that shows and controls the run, and print its address [default: the
    /// config's `live: listen`, or else 127.0.0.1:7788]. The run continues when its behaviours have
    /// ended; Ctrl-C ends it. With --fast the page controls the clock: pause, single steps, 1 to 100
    /// times real time
    #[arg(long, value_name = "IP:PORT", num_args = 0..=1, require_equals = true)]
    live: Option<Option<SocketAddr>>,

    /// Skip the check of the scripts before the start
    #[arg(long)]
    no_check: bool,

    /// Value of a parameter that the script declares; with several behaviours
    /// BEHAVIOUR.NAME=VALUE; may be repeated
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = Param::parse)]
    params: Vec<Param>,

    #[command(flatten)]
    firmware: FirmwareArgs,

    #[command(flatten)]
    connection: ConnectionArgs,
}

/// Parses a restart policy by the same words as the config; its other numbers have their defaults.
fn restart_words() -> impl TypedValueParser<Value = RestartPolicy> {
    PossibleValuesParser::new(RestartPolicy::WORDS)
        .try_map(|word| word.parse::<RestartPolicy>().map_err(std::io::Error::other))
}

/// Runs until the scripts have ended, the time limit is reached, or a signal arrives.
pub(super) fn run(args: &RunArgs, console: &Console) -> Result<Exit, Failure> {
    let mut args = args.clone();
    args.files
        .extend(args.connection.take_misplaced_behaviour());
    let mut config = args.settings.config()?.clone();
    if let Some(address) = args.live {
        config.live.listen = Some(address.unwrap_or(config.live.address()));
    }
    let robot = ChosenRobot::load(&args.connection, &mut config)?;
    args.settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let loaded = load(&args, &config, seed)?;
    // With --watch the agent checks each version: a mistake must not end the run.
    if !args.no_check && !args.watch {
        check::before_run(&loaded.behaviours, console)?;
    }
    let robot = ChosenRobot::required(robot)?;
    let simulated = robot.is_simulated();
    args.firmware.refuse_unless(simulated)?;
    if args.date.is_some() && !simulated {
        let what = "--date needs --sim: a real robot uses today's date";
        return Err(
            Failure::usage(what).help("spykee run FILE.lua --sim --date \"2026-03-29 01:30\"")
        );
    }
    let login = args.connection.login.login(args.settings.load()?)?;
    if console.is_json() {
        tracing::info!(seed, "starting");
    } else {
        tracing::debug!(seed, "starting");
    }
    if args.fast {
        return fast(
            &args,
            &config,
            robot,
            loaded.behaviours,
            login,
            seed,
            console,
        );
    }
    in_real_time(&args, &config, robot, loaded, login, seed, console)
}

/// Runs on a robot, or on a simulated one inside this program.
fn in_real_time(
    args: &RunArgs,
    config: &Config,
    robot: ChosenRobot,
    loaded: LoadedBehaviours,
    login: Login,
    seed: u64,
    console: &Console,
) -> Result<Exit, Failure> {
    let trace = trace_file(args, robot.is_simulated())?;
    let LoadedBehaviours {
        behaviours,
        specs,
        watches,
    } = loaded;
    let mut settings = args.settings.load()?.clone();
    settings.config = config.clone();
    let assembly = Assembly::new(RunSetup {
        settings: &settings,
        robot,
        login,
        seed,
        firmware: args.firmware.load()?,
        waits: args.wait,
        waits_for_reset: false,
        keeps_journal: config.journal.record == journal::When::On,
        clock: clock(args, config),
        names: names(&behaviours),
        page: args.live.map(|_| definition(&behaviours)),
        behaviours,
        specs,
        stays: args.live.is_some(),
        limit: args.limit.map(Span::get),
        beats: None,
    })?;
    let sim = assembly.sim();
    let outcome = assembly.run(async |parts| {
        for (watched, reloads) in watches {
            tokio::spawn(watched.run(reloads));
        }
        drive(parts, console).await
    });
    // Also drawn for a run that failed or was interrupted, where it is most useful.
    let drawn = match (trace, &sim) {
        (Some(trace), Some(sim)) => trace.write(sim),
        _ => Ok(()),
    };
    outcome.and_then(|exit| drawn.map(|()| exit))
}

fn trace_file(args: &RunArgs, simulated: bool) -> Result<Option<TraceFile>, Failure> {
    match args.trace.as_deref() {
        Some(_) if !simulated => {
            let failure = Failure::usage("--trace needs --sim: it draws a simulation");
            Err(failure.help("--sim [WORLD] runs on a simulated robot"))
        }
        path => path.map(TraceFile::create).transpose(),
    }
}

fn names(behaviours: &[Behaviour]) -> String {
    let names = behaviours
        .iter()
        .map(|behaviour| behaviour.launch.options.name.as_str());
    names.collect::<Vec<_>>().join(" ")
}

/// What the page shows of the behaviours.
fn definition(behaviours: &[Behaviour]) -> watch::Receiver<RunDefinition> {
    let scripts: Vec<Script> = behaviours.iter().map(super::live::script).collect();
    watch::channel(scripts.into()).1
}

/// Runs in virtual time, in this process.
fn fast(
    args: &RunArgs,
    config: &Config,
    robot: ChosenRobot,
    behaviours: Vec<Behaviour>,
    login: Login,
    seed: u64,
    console: &Console,
) -> Result<Exit, Failure> {
    let ChosenRobot::Sim(world) = robot else {
        let why = "--fast needs --sim: a real robot runs in real time";
        return Err(Failure::usage(why).help("spykee run FILE.lua --sim --fast"));
    };
    let trace = trace_file(args, true)?;
    let events = args.events.as_deref().map(EventFile::create).transpose()?;
    let options = simulation::Options {
        seed,
        sim: sim::Options {
            login,
            firmware: args.firmware.load()?,
            // A page lets people start faults.
            faults: args.live.map(|_| Vec::new()),
            ..sim::Options::default()
        },
        limits: config.watchdog.clone(),
        streams: config.streams,
        events: events.as_ref().map(EventFile::recorder),
        date: args
            .date
            .map(|date| date.at(&config.time_zone.clone().unwrap_or_else(Zone::utc))),
        sim_clock: args.live.map(|_| SimClock::default()),
        ..simulation::Options::default()
    };
    let names = names(&behaviours);
    let page = args.live.map(|_| definition(&behaviours));
    let page = page.map(|page| PageInputs::new(config, page, &options.bus));
    let fast = Fast {
        world: *world,
        behaviours,
        options,
        limit: args.limit.map(Span::get),
        trace,
        page,
        journal: SimulationJournalOptions::from_config(config),
    };
    let outcome = fast.run(names, console)?;
    events.map_or(Ok(()), EventFile::finish)?;
    exit(outcome)
}

async fn drive(parts: RunParts, console: &Console) -> Result<Exit, Failure> {
    let stop = CancellationToken::new();
    // A single run has no timetable.
    let view = View::channel().1;
    let started = parts.start(&stop, Some(stop.clone()), handle_signals, view, console)?;
    let showing = show(started.line, started.status, console);
    let outcome = tokio::select! {
        outcome = started.agent.run(stop) => exit(outcome),
        never = showing => match never {},
        never = serve(started.server, started.run) => match never {},
    };
    started
        .mqtt
        .map(|mqtt| mqtt.finish(broker::SHUTDOWN_TIMEOUT));
    outcome
}

fn load(args: &RunArgs, config: &Config, seed: u64) -> Result<LoadedBehaviours, Failure> {
    let named = |file: &PathBuf| Entry::new(file.clone());
    let entries: Vec<Entry> = if args.files.is_empty() {
        config.behaviours.clone()
    } else {
        args.files.iter().map(named).collect()
    };
    // With a page, a run without behaviours is useful for manual driving.
    if entries.is_empty() && args.live.is_none() {
        let failure = Failure::usage("no behaviour was named");
        return Err(failure.help("spykee run behaviours/patrol.lua --sim"));
    }
    BehaviourLoader {
        config,
        file: args.settings.file(),
        params: &args.params,
        annotate: args.annotate.as_deref(),
        restart: args.restart,
        checked: !args.no_check,
        watch: args.watch,
        seed,
        clock: clock(args, config),
        zone: zone(args, config),
    }
    .load(&entries)
}

/// The time zone. A fast run does not use the computer's zone, to be the same on every computer.
fn zone(args: &RunArgs, config: &Config) -> Zone {
    let fast = || config.time_zone.clone().unwrap_or_else(Zone::utc);
    if args.fast { fast() } else { config.zone() }
}

/// The clock for scripts and for the journal.
fn clock(args: &RunArgs, config: &Config) -> Clock {
    match args.date {
        Some(date) if !args.fast => Clock::set_to(date.at(&zone(args, config))),
        _ => Clock::default(),
    }
}

/// The exit code for the outcome of a run.
fn exit(outcome: Result<Outcome, AgentError>) -> Result<Exit, Failure> {
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(AgentError::Link(error)) => return Err(unreachable(error)),
        Err(error @ AgentError::Broken(_)) => return Err(Failure::new(Exit::Failed, error)),
    };
    let ended_by = |is: fn(EndReason) -> bool| {
        let mut exits = outcome.exits.iter();
        exits.any(|(_, exit)| is(exit.reason))
    };
    Ok(if outcome.owes_stop {
        Exit::Unreachable
    } else if outcome.interrupted && outcome.safety {
        Exit::Safety
    } else if outcome.interrupted {
        Exit::Interrupted
    } else if ended_by(is_failure) {
        Exit::Failed
    } else if outcome.safety || ended_by(|reason| reason == EndReason::Safety) {
        Exit::Safety
    } else {
        Exit::Done
    })
}

/// The failure of the first connection.
fn unreachable(error: LinkError) -> Failure {
    if error.is_final() {
        return error.into();
    }
    let help = error.help();
    Failure::from(error).help(format!(
        "{help}; `spykee run --wait` retries until it answers"
    ))
}
