//! Starts the parts that every command with an agent needs: heartbeat and guardian, driving core,
//! rescue behaviour, journal, and the control server for other commands.

use std::convert::Infallible;
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};

use super::{Exit, Failure};
use crate::agent::{self, Bus, RESCUE_NAME};
use crate::behaviour::{Launch, Launcher};
use crate::clock::Clock;
use crate::config::Config;
use crate::control::{self, ControlServer, EmergencyStop};
use crate::guardian::{self, Guardian, GuardianFiles};
use crate::journal::{self, Journal};
use crate::pilot::{DrivingCore, Heartbeat};

/// Time limit for the journal to write its queue at the end.
pub(super) const JOURNAL_END: Duration = Duration::from_secs(2);

pub(super) fn runtime() -> Result<Runtime, Failure> {
    let runtime = Builder::new_current_thread().enable_all().build();
    runtime.map_err(|error| Failure::io("start the runtime", error))
}

/// The launcher of hosts, which run this program's own file.
pub(super) fn launcher() -> Result<Launcher, Failure> {
    Launcher::this_executable().map_err(|error| Failure::io("find this program's own file", error))
}

/// Starts the journal. On an error logs a warning: the run continues without it.
pub(super) fn journal(
    config: &Config,
    bus: &Bus,
    target: &str,
    simulated: bool,
    clock: Clock,
) -> Option<Journal> {
    let about = journal::RunInfo {
        target: target.to_owned(),
        simulated,
    };
    let started = Journal::start(bus, config.data_folder(), config.journal, about, clock);
    started.map_err(|error| tracing::warn!("{error}")).ok()
}

/// A person's STOP, kept in the data folder unless the robot is simulated in this program.
pub(super) fn emergency_stop(config: &Config, simulated: bool, bus: &Bus) -> EmergencyStop {
    if simulated {
        EmergencyStop::simulated(bus)
    } else {
        EmergencyStop::open(config.data_folder(), bus)
    }
}

/// Whether an earlier program has left a person's STOP behind; not for a robot that is simulated in
/// this program.
pub(super) fn is_stopped(config: &Config, simulated: bool) -> bool {
    !simulated && EmergencyStop::is_kept(config.data_folder())
}

/// Refuses to drive while a person's STOP holds.
pub(super) fn refuse_if_stopped(config: &Config, simulated: bool) -> Result<(), Failure> {
    if !is_stopped(config, simulated) {
        return Ok(());
    }
    let failure = Failure::new(
        Exit::Safety,
        "a person has stopped the robot: it may not drive",
    );
    Err(failure.help("`spykee robot reset-stop` releases it"))
}

/// Runs the control server. On an error logs a warning: the run continues without it.
pub(super) async fn serve(server: io::Result<ControlServer>, run: control::Run) -> Infallible {
    let served = match server {
        Ok(server) => server.serve(run).await,
        Err(error) => Err(error),
    };
    if let Err(error) = served {
        tracing::warn!(
            "`spykee status` and `spykee robot` cannot reach this run: no socket in its data \
             folder: {error}"
        );
    }
    std::future::pending().await
}

/// This program's own file, even if an upgrade has put another one in its place.
const THIS_PROGRAM: &str = "/proc/self/exe";

/// The heartbeat of a run, with a guardian unless the robot is simulated in this program and so
/// ends with it.
///
/// # Errors
/// The guardian cannot be started, and nothing may drive without one.
pub(super) fn heartbeat(simulated: bool, files: GuardianFiles) -> Result<Heartbeat, Failure> {
    if simulated {
        return Ok(Heartbeat::new(None));
    }
    let guardian = Guardian::start(Path::new(THIS_PROGRAM), files)
        .map_err(|error| Failure::io("start the guardian process", error))?;
    Ok(Heartbeat::new(Some(guardian)))
}

/// The files of the guardian of a run, which serves a person's STOP if the run serves requests.
pub(super) fn guardian_files(config: &Config, server: Option<&ControlServer>) -> GuardianFiles {
    let absolute = |path| std::path::absolute::<PathBuf>(path).ok();
    GuardianFiles {
        record: absolute(guardian::record_path(config.data_folder())),
        stop_socket: server.and_then(|server| absolute(server.guardian_socket())),
    }
}

/// Says what the guardian of an earlier run has left: a stop that the robot may not have executed.
pub(super) fn warn_of_unpaid_stop(config: &Config) {
    if let Some(line) = guardian::unpaid_stop(config.data_folder(), Clock::default().now()) {
        tracing::warn!("the guardian of an earlier run: {line}");
    }
}

pub(super) fn rescue(config: &Config, seed: u64) -> Result<Option<Launch>, Failure> {
    let choice = &config.watchdog.rescue;
    let options = config.script(RESCUE_NAME, choice.to_string(), seed);
    agent::rescue(choice, options).map_err(|error| {
        Failure::usage(format_args!(
            "cannot read the rescue behaviour {choice}: {error}"
        ))
        .help("watchdog: { rescue: builtin } uses the built-in one")
    })
}

/// Starts the thread on which the pilot runs.
pub(super) fn driving_core() -> Result<DrivingCore, Failure> {
    DrivingCore::start().map_err(|error| Failure::io("start the driving thread", error))
}
