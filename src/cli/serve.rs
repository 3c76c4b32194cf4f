//! `spykee serve`: runs a robot permanently, by timetable and on request.

mod service_plan;

use std::ffi::CString;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, chown};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use nix::unistd::{Gid, Uid, User, initgroups, setgid, setuid};
use tokio::sync::{Notify, mpsc, watch};

use self::service_plan::{LoadedPlan, PlanLoader};
use super::assembly::{RunSetup, ServiceSetup, clock, exit_of};
use super::connection::{RobotTarget, no_robot};
use super::fast::FastSetup;
use super::interrupt::listen;
use super::settings::CommandSettings;
use super::{ConnectionArgs, Console, Exit, Failure};
use crate::clock::{Date, Span};
use crate::config::{Config, Effective};
use crate::journal::When;
use crate::service::{ManagerNotifier, RecordFile, Service, View};
use crate::sim::{self, World};
use crate::simulation;

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

pub(super) fn run(
    args: &ServeArgs,
    settings: &CommandSettings,
    console: &Console,
) -> Result<Exit, Failure> {
    let mut config = settings.config()?.clone();
    let robot = args.connection.choose(&mut config)?.ok_or_else(no_robot)?;
    let login = args.connection.login.login(settings.load()?)?;
    let simulated = robot.is_simulated();
    let why = "--date needs --sim: a real robot uses today's date";
    robot.refuse_if_real(args.date.is_some(), why)?;
    // A service of a simulated robot keeps its user, unless the config names one.
    let user = config.service.user.as_deref();
    if !simulated || user.is_some() {
        drop_root(user, config.data_folder())?;
    }
    settings.announce();
    let seed = args.seed.unwrap_or_else(rand::random);
    let loader = PlanLoader {
        settings: settings.clone(),
        checked: !args.no_check,
        seed,
        console: console.clone(),
        clock: clock(args.date, args.fast, &config),
        camera: if simulated { Some(config.camera) } else { None },
        fast: args.fast,
    };
    let loaded = loader.load(&config)?;
    let sim_options = sim::Options {
        login,
        seed,
        ..sim::Options::default()
    };
    if args.fast {
        return fast(
            args,
            &config,
            robot.into_world()?,
            loaded,
            sim_options,
            console,
        );
    }
    let robot = robot.start(config, sim_options)?;
    in_real_time(args, settings.load()?, robot, loader, loaded, console)
}

fn in_real_time(
    args: &ServeArgs,
    settings: &Effective,
    robot: RobotTarget,
    loader: PlanLoader,
    loaded: LoadedPlan,
    console: &Console,
) -> Result<Exit, Failure> {
    let config = robot.config.clone();
    let clock = loader.clock;
    let record = RecordFile::open(config.data_folder());
    let beats = Arc::new(Notify::new());
    let (view, seen) = View::channel();
    let (definition, shown) = watch::channel(loaded.definition.clone());
    let setup = RunSetup {
        settings,
        robot,
        seed: loader.seed,
        waits: true,
        keeps_journal: config.journal.record != When::Off,
        clock,
        names: "serves".to_owned(),
        behaviours: Vec::new(),
        specs: loaded.service_plan.specs.clone(),
        limit: args.limit.map(Span::get),
        page: config.live.listen.map(|_| shown),
        trace: None,
        service: Some(ServiceSetup {
            beats: beats.clone(),
            view: seen,
        }),
    };
    setup.run(console, async |started| {
        let hangup = listen(libc::SIGHUP)?;
        let (reload, reloads) = mpsc::channel(1);
        let notifier = ManagerNotifier::of_environment();
        let service = Service {
            agent: started.agent,
            status: started.status,
            clock,
            service_plan: loaded.service_plan.clone(),
            record,
            notifier: notifier.clone(),
            bus: started.bus,
            view,
            reloads,
        };
        let reloading = loader.reload_on_hangup(hangup, reload, definition, config, loaded);
        tokio::select! {
            outcome = service.run(started.stop) => exit_of(outcome, true),
            never = notifier.pass_on(beats) => match never {},
            never = reloading => match never {},
        }
    })
}

/// Serves days and weeks in a simulation, until the time limit or the first signal.
fn fast(
    args: &ServeArgs,
    config: &Config,
    world: World,
    loaded: LoadedPlan,
    sim_options: sim::Options,
    console: &Console,
) -> Result<Exit, Failure> {
    let seed = sim_options.seed;
    let options = simulation::Options {
        seed,
        sim: sim_options,
        ..simulation::Options::default()
    };
    let stop = options.stop.clone();
    let limit = args.limit.map(Span::get);
    let setup = FastSetup {
        config,
        world,
        options,
        date: args.date,
        events: args.events.as_deref(),
        names: "serves".to_owned(),
        is_service: true,
    };
    setup.run(console, async move |simulation, opened| {
        let mut plan = simulation.plan(Vec::new());
        plan.limit = limit;
        let no_record = RecordFile::default();
        let service = Service::in_simulation(plan, loaded.service_plan, no_record);
        let _ = opened.send((service.status.clone(), simulation.sim().clone()));
        exit_of(service.run(stop).await, true)
    })
}

/// If started as root, permanently switches to this user; `root` itself keeps the privileges. Does
/// nothing if not started as root. Creates the data folder for the user if it is missing.
fn drop_root(user: Option<&str>, data: &Path) -> Result<(), Failure> {
    if !Uid::effective().is_root() {
        return Ok(());
    }
    let Some(name) = user else {
        let failure =
            Failure::usage("a service must not run as root, and the config names no user");
        return Err(failure.help(
            "name one in the config, `service: { user: NAME }`; `user: root` stays root; \
             `spykee service install` creates a unit with its own user",
        ));
    };
    if name == "root" {
        tracing::warn!("the service continues as root, as the config requests");
        return Ok(());
    }
    let found = User::from_name(name).ok().flatten();
    let user = found.ok_or_else(|| {
        let failure = Failure::usage(format_args!("this computer has no user `{name}`"));
        failure.help("name an existing user in the config, `service: { user: ... }`")
    })?;
    create_folder(data, &user).map_err(|error| {
        let data = data.display();
        Failure::io(format_args!("create {data} for `{name}`"), error)
    })?;
    switch_to(&user).map_err(|why| Failure::io(format_args!("continue as `{name}`"), why))?;
    tracing::info!("started as root, now running as {name}");
    Ok(())
}

/// Creates the folder for this user. Does not change an existing one.
fn create_folder(data: &Path, user: &User) -> io::Result<()> {
    if data.exists() {
        return Ok(());
    }
    std::fs::DirBuilder::new()
        .recursive(true)
        .mode(0o700)
        .create(data)?;
    chown(data, Some(user.uid.as_raw()), Some(user.gid.as_raw()))
}

fn switch_to(user: &User) -> io::Result<()> {
    let name = CString::new(user.name.as_str())?;
    initgroups(&name, user.gid)?;
    setgid(user.gid)?;
    setuid(user.uid)?;
    if Uid::effective() != user.uid
        || Gid::effective() != user.gid
        || setuid(Uid::from_raw(0)).is_ok()
    {
        let kept = "the process still has root's privileges";
        return Err(io::Error::other(kept));
    }
    Ok(())
}
