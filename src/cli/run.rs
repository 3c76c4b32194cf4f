//! `spykee run`: behaviours on a robot, or on a simulated one inside this program.

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt::Display;
use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, MissedTickBehavior, interval};
use tokio_util::sync::CancellationToken;

use super::embedded::EmbeddedSim;
use super::fast::{EventFile, Fast};
use super::firmware::FirmwareArgs;
use super::interrupt::obey;
use super::params::{self, Param};
use super::settings::SettingsArgs;
use super::source::read_source;
use super::status::StatusLine;
use super::trace::TraceFile;
use super::waiting::{Tries, until_answered};
use super::{ConnectionArgs, Console, Exit, Failure, Place, check};
use crate::agent::{self, Agent, AgentError, Behaviour, Outcome, Plan, RESCUE_NAME};
use crate::behaviour::{Launch, Launcher, Library, Reload, RestartPolicy, Watched, is_failure};
use crate::config::{Config, Entry};
use crate::control::{self, Desk};
use crate::guardian::Guardian;
use crate::lab;
use crate::link::{self, LinkError, Target};
use crate::pilot::{Dial, DrivingCore, Pulse, Status};
use crate::robot::EndReason;
use crate::script::{self, GivenParam};
use crate::sim::{self, Firmware};
use crate::wire::Login;

/// How often the status line is drawn anew.
pub(super) const STATUS_PERIOD: Duration = Duration::from_millis(250);
/// The longest `--for`: a year.
const LONGEST_RUN: f64 = 366.0 * 86_400.0;

/// Run behaviours on a robot, or on a simulated one with --sim
#[derive(Debug, Clone, clap::Args)]
pub(super) struct RunArgs {
    /// Behaviour scripts; several run side by side. Without one: those of the config
    #[arg(value_name = "FILE.lua")]
    files: Vec<PathBuf>,

    #[command(flatten)]
    pub(super) settings: SettingsArgs,

    /// Dial until the robot answers, instead of ending with exit code 3 if it does not
    #[arg(long, conflicts_with = "fast")]
    wait: bool,

    /// End after so many seconds, from the first connection on
    #[arg(long = "for", value_name = "SECONDS", value_parser = parse_seconds)]
    limit: Option<Duration>,

    /// Of math.random and of the simulator's noise; without it a new one for each run
    #[arg(long, value_name = "NUMBER")]
    seed: Option<u64>,

    /// Keep copies of the frames that the behaviours look at, with all that they find drawn in:
    /// DIR/BEHAVIOUR/00.jpg to 99.jpg, at most two a second, the newest hundred
    #[arg(long, value_name = "DIR")]
    annotate: Option<PathBuf>,

    /// Start a behaviour that failed again, after growing pauses and not too often: never or
    /// on-failure. For all behaviours, whatever the config says
    #[arg(long, value_name = "POLICY", value_parser = restart_words())]
    restart: Option<RestartPolicy>,

    /// Load a behaviour anew whenever its file is saved; Ctrl-C ends the run
    #[arg(long, conflicts_with = "fast")]
    watch: bool,

    /// With --sim: draw the way that the robot went, and what happened, onto the map of its world
    #[arg(long, value_name = "FILE.png", value_parser = super::world::parse_png)]
    trace: Option<PathBuf>,

    /// With --sim: in virtual time, as fast as it goes. The same seed gives the same run
    #[arg(long)]
    fast: bool,

    /// With --fast: write all that happens to this file, one JSON object a line
    #[arg(long, value_name = "FILE", requires = "fast")]
    events: Option<PathBuf>,

    /// Run without looking for mistakes first
    #[arg(long)]
    no_check: bool,

    /// Set a parameter that the script declares; with several behaviours BEHAVIOUR.NAME=VALUE
    #[arg(long = "param", value_name = "NAME=VALUE", value_parser = Param::parse)]
    params: Vec<Param>,

    #[command(flatten)]
    firmware: FirmwareArgs,

    #[command(flatten)]
    connection: ConnectionArgs,
}

/// As the config has them; the numbers of a table are its usual ones.
fn restart_words() -> impl TypedValueParser<Value = RestartPolicy> {
    PossibleValuesParser::new(RestartPolicy::WORDS)
        .try_map(|word| word.parse::<RestartPolicy>().map_err(std::io::Error::other))
}

fn parse_seconds(text: &str) -> Result<Duration, String> {
    let seconds = text
        .parse()
        .ok()
        .filter(|seconds| (0.0..=LONGEST_RUN).contains(seconds));
    let duration = seconds.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
    duration.ok_or_else(|| format!("expected a number of seconds, at most {LONGEST_RUN}"))
}

/// Runs until the scripts have ended, the time is over, or a person interrupts.
///
/// # Errors
/// Whatever keeps the run from beginning: files, config, the robot.
pub(super) fn run(args: &RunArgs, console: &Console) -> Result<Exit, Failure> {
    let mut args = args.clone();
    args.files
        .extend(args.connection.take_misplaced_behaviour());
    let config = args.settings.config()?.clone();
    args.settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let (behaviours, watches) = behaviours(&args, &config, seed)?;
    // Under watch the keeper looks: a mistake does not end the run there.
    if !args.no_check && !args.watch {
        check::before_run(&behaviours, console)?;
    }
    let place = place(&args.connection, &config)?;
    let simulated = matches!(place, Place::Sim(_));
    let trace = trace_file(&args, simulated)?;
    args.firmware.refuse_unless(simulated)?;
    let login = args.connection.login.login(args.settings.load()?)?;
    if console.is_json() {
        tracing::info!(seed, "starting");
    } else {
        tracing::debug!(seed, "starting");
    }
    if args.fast {
        return fast(
            (&args, trace),
            &config,
            place,
            behaviours,
            login,
            seed,
            console,
        );
    }
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build();
    let runtime = runtime.map_err(|error| Failure::usage(format_args!("no runtime: {error}")))?;
    let (target, sim) = reach_with(place, &login, seed, args.firmware.load()?)?;
    let desk = Desk::open(config.data_folder());
    let about = (target.to_string(), sim.is_some());
    let settings = config.pilot(sim.is_some(), seed);
    let launcher = Launcher::this_executable().map_err(|error| {
        Failure::usage(format_args!("cannot find this program's own file: {error}"))
    })?;
    let names = names(&behaviours);
    let (link, tries) = (config.link.clone(), Tries::default());
    let dial = match args.wait {
        true => until_answered(target, login, link, seed, tries.clone()),
        false => dial(target, login, link),
    };
    let core = driving_core()?;
    let plan = Plan {
        behaviours,
        settings,
        dial,
        launcher,
        core: core.handle().clone(),
        pulse: Some(pulse(sim.is_some())),
        rescue: rescue(&config, seed)?,
        limit: args.limit,
    };
    let line = StatusLine::new(names, sim.as_ref().map(EmbeddedSim::handle), tries);
    let outcome = runtime.block_on(async {
        for (watched, reloads) in watches {
            tokio::spawn(watched.run(reloads));
        }
        drive(plan, line, (desk, about), console).await
    });
    drop(core);
    runtime.shutdown_timeout(super::RUNTIME_LIMIT);
    // Also of a run that failed or was interrupted: then people want to see it most.
    let drawn = match (trace, &sim) {
        (Some(trace), Some(sim)) => trace.write(&sim.handle()),
        _ => Ok(()),
    };
    drop(sim);
    outcome.and_then(|exit| drawn.map(|()| exit))
}

fn trace_file(args: &RunArgs, simulated: bool) -> Result<Option<TraceFile>, Failure> {
    match args.trace.as_deref() {
        Some(_) if !simulated => {
            let failure = Failure::usage("--trace draws what happens in a simulation only");
            Err(failure.help("--sim [WORLD.yaml] runs on a simulated robot"))
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

/// The whole run in virtual time, in this process.
fn fast(
    (args, trace): (&RunArgs, Option<TraceFile>),
    config: &Config,
    place: Place,
    behaviours: Vec<Behaviour>,
    login: Login,
    seed: u64,
    console: &Console,
) -> Result<Exit, Failure> {
    let Place::Sim(world) = place else {
        let why = "--fast goes with --sim only: a real robot's time cannot be hurried";
        return Err(Failure::usage(why).help("spykee run FILE.lua --sim --fast"));
    };
    let events = args.events.as_deref().map(EventFile::create).transpose()?;
    let options = lab::Options {
        seed,
        sim: sim::Options {
            login,
            firmware: args.firmware.load()?,
            ..sim::Options::default()
        },
        limits: config.watchdog.clone(),
        link: config.link.clone(),
        streams: config.streams,
        events: events.as_ref().map(EventFile::recorder),
        ..lab::Options::default()
    };
    let names = names(&behaviours);
    let fast = Fast {
        world: super::embedded::load(world.as_deref())?,
        behaviours,
        options,
        limit: args.limit,
        trace,
    };
    let outcome = fast.run(names, console)?;
    events.map_or(Ok(()), EventFile::finish)?;
    exit(outcome)
}

async fn drive(
    plan: Plan,
    line: StatusLine,
    (desk, (target, simulated)): (io::Result<Desk>, (String, bool)),
    console: &Console,
) -> Result<Exit, Failure> {
    let stop = CancellationToken::new();
    let (core, streams) = (plan.core.clone(), plan.settings.streams);
    let (agent, status) = Agent::new(plan);
    obey(&core, agent.requests(), stop.clone())?;
    let run = control::Run {
        requests: agent.requests(),
        status: status.clone(),
        pictures: agent.pictures(),
        stop: stop.clone(),
        streams,
        target,
        simulated,
        began: Instant::now(),
    };
    let showing = show(line, status, console);
    tokio::select! {
        outcome = agent.run(stop) => exit(outcome),
        never = showing => match never {},
        never = serve(desk, run) => match never {},
    }
}

/// A run without a desk drives all the same.
async fn serve(desk: io::Result<Desk>, run: control::Run) -> Infallible {
    let served = match desk {
        Ok(desk) => desk.serve(run).await,
        Err(error) => Err(error),
    };
    if let Err(error) = served {
        tracing::warn!(
            "`spykee status` and `spykee robot` cannot ask this run: no socket in its data folder: \
             {error}"
        );
    }
    std::future::pending().await
}

/// The heartbeat of a run, with a guardian unless the robot is simulated in this program and ends with
/// it.
pub(super) fn pulse(simulated: bool) -> Pulse {
    if simulated {
        return Pulse::new(None);
    }
    let started = std::env::current_exe().and_then(|executable| Guardian::start(&executable));
    Pulse::new(match started {
        Ok(guardian) => Some(guardian),
        Err(error) => {
            tracing::warn!(
                "this run has no guardian ({error}): if this program is killed or stopped, nobody \
                 stops the robot"
            );
            None
        }
    })
}

/// The rescue behaviour that the config wants.
pub(super) fn rescue(config: &Config, seed: u64) -> Result<Option<Launch>, Failure> {
    let choice = &config.watchdog.rescue;
    let options = config.script(RESCUE_NAME, choice.to_string(), seed);
    agent::rescue(choice, options).map_err(|error| {
        Failure::usage(format_args!(
            "cannot read the rescue behaviour {choice}: {error}"
        ))
        .help("watchdog: { rescue: builtin } uses the one that comes along")
    })
}

/// The thread on which the pilot runs.
pub(super) fn driving_core() -> Result<DrivingCore, Failure> {
    DrivingCore::start()
        .map_err(|error| Failure::usage(format_args!("no thread to drive on: {error}")))
}

fn exit(outcome: Result<Outcome, AgentError>) -> Result<Exit, Failure> {
    let outcome = match outcome {
        Ok(outcome) => outcome,
        Err(AgentError::Link(error)) => return Err(unreachable(error)),
        Err(error @ AgentError::Broken(_)) => return Err(Failure::new(Exit::Script, error)),
    };
    let ended_by = |is: fn(EndReason) -> bool| {
        let mut endings = outcome.endings.iter();
        endings.any(|(_, ending)| is(ending.reason))
    };
    Ok(if outcome.interrupted && outcome.safety {
        Exit::Safety
    } else if outcome.interrupted {
        Exit::Interrupted
    } else if ended_by(is_failure) {
        Exit::Script
    } else if outcome.safety || ended_by(|reason| reason == EndReason::Safety) {
        Exit::Safety
    } else {
        Exit::Done
    })
}

/// Of the first connection.
fn unreachable(error: LinkError) -> Failure {
    if error.is_final() {
        return error.into();
    }
    let help = error.help();
    Failure::from(error).help(format!(
        "{help}; `spykee run --wait` dials until it answers"
    ))
}

async fn show(
    mut line: StatusLine,
    status: watch::Receiver<Status>,
    console: &Console,
) -> Infallible {
    let mut beat = interval(STATUS_PERIOD);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        beat.tick().await;
        let newest = *status.borrow();
        if console.has_status_line() {
            console.status(line.draw(&newest));
        } else if let Some(text) = line.news(&newest) {
            console.status_line_plain(&text);
        }
    }
}

pub(super) fn place(connection: &ConnectionArgs, config: &Config) -> Result<Place, Failure> {
    let from_config = || config.robot.clone().map(Place::Robot);
    connection.place().or_else(from_config).ok_or_else(|| {
        Failure::usage("which robot? neither --robot nor --sim was given").help(
            "--sim runs on a simulated robot; --robot HOST[:PORT] on yours \
             (spykee discover finds it)",
        )
    })
}

pub(super) fn reach(
    place: Place,
    login: &Login,
    seed: u64,
) -> Result<(Target, Option<EmbeddedSim>), Failure> {
    reach_with(place, login, seed, Firmware::default())
}

/// As [`reach`]; a simulated robot has this firmware.
fn reach_with(
    place: Place,
    login: &Login,
    seed: u64,
    firmware: Firmware,
) -> Result<(Target, Option<EmbeddedSim>), Failure> {
    match place {
        Place::Robot(target) => Ok((target, None)),
        Place::Sim(world) => {
            let sim = EmbeddedSim::start(world.as_deref(), login, seed, firmware)?;
            let address = sim.address();
            let target = Target {
                host: address.ip().to_string(),
                port: address.port(),
            };
            Ok((target, Some(sim)))
        }
    }
}

pub(super) fn dial(target: Target, login: Login, options: link::Options) -> Dial {
    Box::new(move |last_words| {
        let (target, login, options) = (target.clone(), login.clone(), options.clone());
        Box::pin(async move { link::connect(&target, &login, last_words, &options).await })
    })
}

/// A behaviour's file under watch, and who is told.
type Watch = (Watched, mpsc::Sender<Reload>);

fn behaviours(
    args: &RunArgs,
    config: &Config,
    seed: u64,
) -> Result<(Vec<Behaviour>, Vec<Watch>), Failure> {
    let named = |file: &PathBuf| Entry::of(file.clone());
    let entries: Vec<Entry> = match args.files.is_empty() {
        true => config.behaviours.clone(),
        false => args.files.iter().map(named).collect(),
    };
    if entries.is_empty() {
        let failure = Failure::usage("what to run? no behaviour was named");
        return Err(failure.help("spykee run behaviours/patrol.lua --sim"));
    }
    let (mut names, mut watches, mut behaviours) = (Vec::new(), Vec::new(), Vec::new());
    for (entry, seed) in entries.iter().zip(seed..) {
        // Before the file is read, so that no save is missed.
        let watched = args.watch.then(|| Watched::new(entry.file.clone()));
        let mut behaviour = behaviour(entry, args, config, seed, &mut names)?;
        if let Some(watched) = watched {
            let (reloads, received) = mpsc::channel(1);
            behaviour.reloads = Some(received);
            let watched = watched.with_modules(behaviour.launch.library.clone());
            watches.push((watched, reloads));
        }
        behaviours.push(behaviour);
    }
    let options = behaviours.iter_mut().map(|one| &mut one.launch.options);
    params::give(&args.params, options.collect())?;
    Ok((behaviours, watches))
}

fn behaviour(
    entry: &Entry,
    args: &RunArgs,
    config: &Config,
    seed: u64,
    names: &mut Vec<String>,
) -> Result<Behaviour, Failure> {
    let source = read_source(&entry.file)?;
    let name = unique(entry.name().map_err(Failure::usage)?, names);
    let data = config.data_folder().join(&name);
    let data = std::path::absolute(data).map_err(Failure::usage)?;
    let options = script::Options {
        params: params(entry, args.settings.file()),
        annotate_dir: marked_folder(args.annotate.as_deref(), &name, &data)?,
        data_dir: Some(data),
        ..config.script(name, entry.file.display().to_string(), seed)
    };
    let folder = entry.file.parent().unwrap_or(Path::new(""));
    let library = Library::new(folder.to_owned());
    Ok(Behaviour {
        priority: entry.priority,
        launch: Launch {
            source,
            options,
            library,
        },
        restart: args.restart.unwrap_or(entry.restart),
        checked: args.watch && !args.no_check,
        reloads: None,
    })
}

/// What the config says for what the script declares.
pub(super) fn params(entry: &Entry, config: Option<&Path>) -> BTreeMap<String, GivenParam> {
    entry.given(&config.map_or_else(String::new, |config| config.display().to_string()))
}

/// The private folder for a behaviour's marked frames, made here so that a wrong one is told before
/// the robot moves.
fn marked_folder(
    annotate: Option<&Path>,
    name: &str,
    data: &Path,
) -> Result<Option<PathBuf>, Failure> {
    let Some(folder) = annotate else {
        return Ok(None);
    };
    let folder = std::path::absolute(folder.join(name)).map_err(Failure::usage)?;
    let refused = |why: &dyn Display| {
        let what = format_args!(
            "--annotate cannot keep frames in {}: {why}",
            folder.display()
        );
        Failure::usage(what).help("name a folder that is only for marked frames")
    };
    if folder == data {
        return Err(refused(&"the behaviour's own pictures are there"));
    }
    let made = DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(&folder);
    made.map_err(|error| refused(&error))?;
    Ok(Some(folder))
}

/// Two behaviours of one name would share a data folder.
fn unique(name: String, names: &mut Vec<String>) -> String {
    let mut candidate = name.clone();
    for number in 2.. {
        if !names.contains(&candidate) {
            break;
        }
        candidate = format!("{name}-{number}");
    }
    names.push(candidate.clone());
    candidate
}
