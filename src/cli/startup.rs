//! Starts the parts that every command with an agent needs: heartbeat and guardian, driving core,
//! rescue behaviour, journal, the control server for other commands, and the status line.

use std::convert::Infallible;
use std::io;
use std::time::Duration;

use tokio::runtime::{Builder, Runtime};
use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use super::status::StatusLine;
use super::{Console, Exit, Failure};
use crate::agent::{self, Bus, RESCUE_NAME};
use crate::behaviour::{Launch, Launcher};
use crate::clock::Clock;
use crate::config::Config;
use crate::control::{self, ControlServer, EmergencyStop};
use crate::guardian::Guardian;
use crate::journal::{self, Journal};
use crate::pilot::{DrivingCore, Heartbeat, Status};

/// Interval between redraws of the status line.
pub(super) const STATUS_PERIOD: Duration = Duration::from_millis(250);
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
pub(super) fn emergency_stop(config: &Config, simulated: bool) -> EmergencyStop {
    if simulated {
        EmergencyStop::default()
    } else {
        EmergencyStop::open(config.data_folder())
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

/// The heartbeat of a run, with a guardian unless the robot is simulated in this program and so
/// ends with it.
pub(super) fn heartbeat(simulated: bool) -> Heartbeat {
    if simulated {
        return Heartbeat::new(None);
    }
    let started = std::env::current_exe().and_then(|executable| Guardian::start(&executable));
    Heartbeat::new(match started {
        Ok(guardian) => Some(guardian),
        Err(error) => {
            tracing::warn!(
                "this run has no guardian ({error}): if this program is killed or suspended, \
                 nothing stops the robot"
            );
            None
        }
    })
}

/// The rescue behaviour that the config selects.
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

/// Shows the status, on a terminal or in a file.
pub(super) async fn show(
    mut line: StatusLine,
    status: watch::Receiver<Status>,
    console: &Console,
) -> Infallible {
    let mut ticks = interval(STATUS_PERIOD);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        let newest = *status.borrow();
        if console.has_status_line() {
            console.status(line.draw(&newest));
        } else if let Some(text) = line.plain_line(&newest) {
            console.status_line_plain(&text);
        }
    }
}
