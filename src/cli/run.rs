//! `spykee run`: behaviours on a robot, or on a simulated one inside this program.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use tokio::sync::watch;

use super::assembly::{RunSetup, clock, exit_of, zone};
use super::behaviour_loader::{BehaviourLoader, LoadedBehaviours, Param};
use super::connection::{ChosenRobot, no_robot};
use super::settings::CommandSettings;
use super::sim::FirmwareArgs;
use super::world::TraceFile;
use super::{ConnectionArgs, Console, Exit, Failure, argument, check, live};
use crate::agent::Behaviour;
use crate::behaviour::RestartPolicy;
use crate::clock::{Date, Span};
use crate::config::{Config, Entry};
use crate::live::RunDefinition;
use crate::sim;

/// Run behaviours on a robot, or on a simulated one with --sim
#[derive(Debug, Clone, clap::Args)]
pub(super) struct RunArgs {
    /// Behaviour scripts; several run at the same time [default: the config's behaviours]
    #[arg(value_name = "FILE.lua")]
    files: Vec<PathBuf>,

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
    #[arg(long, value_name = "FILE.png", value_parser = argument::png)]
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
    /// ended; Ctrl-C ends it. With --fast the page controls the clock: pause, single steps, 1 to
    /// 100 times real time
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
pub(super) fn run(
    mut args: RunArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    args.files
        .extend(args.connection.take_misplaced_behaviour());
    let mut config = settings.config()?.clone();
    if let Some(address) = args.live {
        config.live.listen = Some(address.unwrap_or(config.live.address()));
    }
    let robot = args.connection.choose(&mut config)?;
    settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let loaded = load(&args, settings, &config, seed, console)?;
    let robot = robot.ok_or_else(no_robot)?;
    refuse_flags_of_simulations(&args, &robot)?;
    let sim_options = sim::Options {
        login: args.connection.login.login(settings.load()?)?,
        seed,
        firmware: args.firmware.load()?,
        // A page lets people start faults.
        faults: args.live.map(|_| Vec::new()),
        ..sim::Options::default()
    };
    announce_seed(seed, console);
    let setup = RunSetup {
        config,
        sim_options,
        fast: args.fast,
        date: args.date,
        waits: args.wait,
        names: names(&loaded.behaviours),
        page: args.live.map(|_| definition(&loaded.behaviours)),
        behaviours: loaded.behaviours,
        specs: loaded.specs,
        limit: args.limit.map(Span::get),
        trace: args.trace.as_deref().map(TraceFile::create).transpose()?,
        events: args.events,
        is_service: false,
    };
    setup.run(robot, settings.load()?, console, async move |started| {
        for (watched, reloads) in loaded.watches {
            tokio::spawn(watched.run(reloads));
        }
        // A run has no timetable: who wants to change it is told so.
        drop(started.changes);
        exit_of(started.agent.run(started.stop).await, false)
    })
}

fn announce_seed(seed: u64, console: &Console) {
    if console.is_json() {
        tracing::info!(seed, "starting");
    } else {
        tracing::debug!(seed, "starting");
    }
}

fn refuse_flags_of_simulations(args: &RunArgs, robot: &ChosenRobot) -> Result<(), Failure> {
    let why = "--firmware needs --sim: it describes a simulated robot";
    robot.refuse_if_real(args.firmware.firmware.is_some(), why)?;
    let why = "--date needs --sim: a real robot uses today's date";
    robot.refuse_if_real(args.date.is_some(), why)?;
    let why = "--trace needs --sim: it draws a simulation";
    robot.refuse_if_real(args.trace.is_some(), why)
}

fn names(behaviours: &[Behaviour]) -> String {
    let names = behaviours
        .iter()
        .map(|behaviour| behaviour.launch.options.name.as_str());
    names.collect::<Vec<_>>().join(" ")
}

fn definition(behaviours: &[Behaviour]) -> watch::Receiver<RunDefinition> {
    let scripts = behaviours.iter().map(live::script).collect();
    let timetable = None;
    watch::channel(RunDefinition { scripts, timetable }).1
}

fn load(
    args: &RunArgs,
    settings: &CommandSettings,
    config: &Config,
    seed: u64,
    console: &Console,
) -> Result<LoadedBehaviours, Failure> {
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
    let loader = BehaviourLoader {
        config,
        file: settings.file(),
        params: &args.params,
        annotate: args.annotate.as_deref(),
        restart: args.restart,
        checked: !args.no_check,
        is_service: false,
        watch: args.watch,
        seed,
        clock: clock(args.date, args.fast, config),
        zone: zone(args.fast, config),
    };
    let loaded = loader.load(&entries)?;
    // With --watch the agent checks each version: a mistake must not end the run.
    if !args.no_check && !args.watch {
        check::before_run(&loaded.behaviours, console)?;
    }
    Ok(loaded)
}
