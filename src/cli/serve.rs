//! `spykee serve`: runs a robot permanently, by timetable and on request.

mod service_plan;

use std::ffi::CString;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, chown};
use std::path::{Path, PathBuf};

use nix::unistd::{Gid, Uid, User, initgroups, setgid, setuid};
use tokio::sync::{mpsc, watch};

use self::service_plan::PlanLoader;
use super::assembly::{RunSetup, StartedRun, clock, exit_of};
use super::connection::no_robot;
use super::interrupt::listen;
use super::settings::CommandSettings;
use super::{ConnectionArgs, Console, Exit, Failure};
use crate::clock::{Date, Span};
use crate::config::Config;
use crate::live::RunDefinition;
use crate::service::{ManagerNotifier, RecordFile, Service, ServicePlan};
use crate::sim;

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
    let loader = PlanLoader {
        camera: if simulated { Some(config.camera) } else { None },
        ..plan_loader(args, settings, &config, console)
    };
    let (service_plan, definition) = loader.load(&config)?;
    let (definition, shown) = watch::channel(definition);
    let setup = RunSetup {
        config: config.clone(),
        sim_options: sim::Options {
            login,
            seed: loader.seed,
            ..sim::Options::default()
        },
        fast: args.fast,
        date: args.date,
        waits: true,
        names: "serves".to_owned(),
        behaviours: Vec::new(),
        specs: service_plan.specs.clone(),
        limit: args.limit.map(Span::get),
        page: if args.fast {
            None
        } else {
            config.live.listen.map(|_| shown)
        },
        trace: None,
        events: args.events.clone(),
        is_service: true,
    };
    setup.run(robot, settings.load()?, console, async move |started| {
        serve(started, loader, service_plan, definition, config).await
    })
}

/// The loader of the plan for a real robot.
fn plan_loader(
    args: &ServeArgs,
    settings: &CommandSettings,
    config: &Config,
    console: &Console,
) -> PlanLoader {
    PlanLoader {
        settings: settings.clone(),
        checked: !args.no_check,
        seed: args.seed.unwrap_or_else(rand::random),
        console: console.clone(),
        clock: clock(args.date, args.fast, config),
        camera: None,
        fast: args.fast,
    }
}

/// Runs the service; in real time with a record for the next one, a manager and reloads.
async fn serve(
    started: StartedRun,
    loader: PlanLoader,
    service_plan: ServicePlan,
    definition: watch::Sender<RunDefinition>,
    config: Config,
) -> Result<Exit, Failure> {
    let (reload, reloads) = mpsc::channel(1);
    let service = Service {
        agent: started.agent,
        status: started.status,
        clock: loader.clock,
        service_plan,
        record: RecordFile::default(),
        notifier: ManagerNotifier::default(),
        bus: started.bus,
        view: started.view,
        reloads,
        changes: started.changes,
    };
    if loader.fast {
        return exit_of(service.run(started.stop).await, true);
    }
    let hangup = listen(libc::SIGHUP)?;
    let notifier = ManagerNotifier::of_environment();
    let service = Service {
        record: RecordFile::open(config.data_folder()),
        notifier: notifier.clone(),
        ..service
    };
    let reloading = loader.reload_on_hangup(hangup, reload, definition, config);
    tokio::select! {
        outcome = service.run(started.stop) => exit_of(outcome, true),
        never = notifier.pass_on(started.beats) => match never {},
        never = reloading => match never {},
    }
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
