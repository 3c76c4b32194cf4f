//! `spykee robot stop` and `reset-stop`: presses STOP and releases it, with or without a run.

use std::path::Path;
use std::time::Duration;

use futures_util::future::join_all;
use tokio::time::{Instant, sleep, timeout};
use tokio_util::sync::CancellationToken;

use super::session::watchdog_after_login;
use crate::cli::connection::RobotTarget;
use crate::cli::interrupt::interruption;
use crate::cli::running::{
    REPLY_TIMEOUT, SharedTargetArgs, ask, order, unexpected_reply, uses_robot,
};
use crate::cli::settings::CommandSettings;
use crate::cli::startup::{self, JOURNAL_END};
use crate::cli::{ConnectionArgs, Exit, Failure, argument, block_on, print};
use crate::clock::Clock;
use crate::config::Config;
use crate::control::{
    self, Client, EmergencyStop, RunRequest, RunResponse, StopAnswer, StoppedRun,
};
use crate::guardian;
use crate::journal::{Journal, JournalReader};
use crate::link::{LinkError, close_gracefully};
use crate::pilot::{DELIVERY, Delivery};
use crate::robot::{AgentEvent, Battery, Bus, StopConfirmation, StopKept};
use crate::wire::{Command, Engage};

const PAUSE: Duration = Duration::from_millis(200);
/// Longest wait until STOP is kept in the data folder.
const KEEP_TIMEOUT: Duration = Duration::from_secs(2);

/// Press STOP: the robot stands until a person releases it
///
/// Stops the robot at once, whatever drives it, its own way home on a low battery included. It then
/// stands until a person releases it, at the page or with `spykee robot reset-stop`: also in later
/// programs of the same data folder. A `spykee run` ends, a service goes on. Without --robot, all
/// runs of the data folder are stopped; with --url, the service there.
///
/// Says whether the robot has executed the stop, or its system has only acknowledged it. The exit
/// code is 3 if it has not confirmed it. A run that does not answer is stopped by its guardian.
///
/// Without a run, it logs in, sends MOVE 0 0, ends a search for the station, sends MOVE 0 0 again,
/// and exits when the robot's side has acknowledged that. If the robot cannot be reached, or does
/// not acknowledge within 2 s, retries until --timeout. A signal ends the retries, but not a try
/// that has connected. While any other program is connected, the robot refuses further logins: that
/// program must stop it.
///
/// Settings that cannot be used do not prevent a stop: those of the config file alone are used, or
/// else the defaults. Then name the robot with --robot, unless a run uses it.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot stop --robot 172.17.6.1")]
pub(in crate::cli) struct StopArgs {
    /// Time limit for the retries, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
          value_parser = argument::whole::<u64>(1..=600))]
    timeout: u64,
    #[command(flatten)]
    target: SharedTargetArgs,
}

pub(super) fn stop(args: &StopArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let settings = &settings.or_defaults();
    if let Some(service) = args.target.find_service(settings)? {
        return stop_service(&service);
    }
    let connection = &args.target.connection;
    let limit = Duration::from_secs(args.timeout);
    if connection.sim.is_some() {
        return stop_directly(std::slice::from_ref(connection), settings, limit);
    }
    let config = settings.config()?;
    let robot = connection.robot.as_ref();
    let chosen = |run: &control::RunStatus| robot.is_none_or(|robot| uses_robot(run, robot));
    let stopped = block_on(async {
        let stopped = control::stop_runs(config.data_folder(), chosen).await;
        let answered = |run: &StoppedRun| matches!(run.answer, StopAnswer::Run { .. });
        if stopped.is_empty() || !stopped.iter().all(answered) {
            warn_of(&keep_stop(config).await);
        }
        stopped
    })?;
    if stopped.is_empty() {
        return stop_directly(std::slice::from_ref(connection), settings, limit);
    }
    let mut unconfirmed = Vec::new();
    let mut direct = Vec::new();
    for run in &stopped {
        match tell(run)? {
            Told::Stopped => {}
            Told::NotConfirmed(why) => unconfirmed.push(why),
            Told::Nothing => {
                let status = run.status.as_ref();
                let mut connection = connection.clone();
                connection.robot = status.and_then(|status| status.target.parse().ok());
                direct.push(connection);
            }
        }
    }
    if !direct.is_empty() {
        stop_directly(&direct, settings, limit)?;
    }
    if unconfirmed.is_empty() {
        return Ok(Exit::Done);
    }
    let failure = Failure::unreachable(unconfirmed.join("; "));
    Err(failure.help(
        "is the robot still in reach of its Wi-Fi? a program that hangs can be ended with `kill \
         -KILL PROCESS`: its guardian then stops the robot",
    ))
}

/// What a run that was stopped has said of its robot.
enum Told {
    Stopped,
    NotConfirmed(String),
    /// The run ends: stop the robot directly, once it accepts the login.
    Nothing,
}

fn tell(run: &StoppedRun) -> Result<Told, Failure> {
    let pid = run.pid;
    let (outcome, ends) = match &run.answer {
        StopAnswer::Run { outcome, ends } => (outcome, *ends),
        StopAnswer::Guardian(guardian::StopAnswer::Written) => {
            print(&format!(
                "stopped: the run hangs (process {pid}); its guardian has stopped the robot\n"
            ))?;
            return Ok(Told::Stopped);
        }
        StopAnswer::Guardian(_) => {
            return Ok(Told::NotConfirmed(format!(
                "the run hangs (process {pid}), and its guardian does not reach the robot; it keeps \
                 trying"
            )));
        }
        StopAnswer::Nobody(why) => {
            return Ok(Told::NotConfirmed(format!(
                "NOT CONFIRMED: {why}, nor does its guardian (process {pid}). Switch the robot off \
                 by hand if it drives"
            )));
        }
    };
    warn_of(&outcome.kept);
    let status = run.status.as_ref();
    if status.is_some_and(|status| status.low && !status.docked) {
        tracing::warn!(
            "the battery is low: `spykee robot reset-stop`, then `spykee robot dock` sends the \
             robot to its station"
        );
    }
    let words = outcome.confirmation;
    if ends && status.is_some_and(|status| status.simulated) {
        print("stopped: the simulated robot ends with its run\n")?;
    } else if words == StopConfirmation::NotConfirmed {
        return Ok(Told::NotConfirmed(format!("process {pid}: {words}")));
    } else if ends && words == StopConfirmation::None {
        tracing::info!("the run that uses the robot ends (process {pid})");
        return Ok(Told::Nothing);
    } else {
        let end = if ends {
            "the run ends"
        } else {
            "the service goes on"
        };
        print(&format!("stopped: {words}; {end} (process {pid})\n"))?;
    }
    Ok(Told::Stopped)
}

fn warn_of(kept: &StopKept) {
    if let Some(warning) = kept.warning() {
        tracing::warn!("{warning}");
    }
}

/// Who presses STOP here, for the journal.
fn this_user() -> String {
    let user = rustix::process::getuid().as_raw();
    format!("the command line, user ID {user}")
}

/// Keeps STOP in the data folder for the next program, and records it, when no run does.
async fn keep_stop(config: &Config) -> StopKept {
    let config = config.clone();
    let runtime = tokio::runtime::Handle::current();
    let keeping = tokio::task::spawn_blocking(move || {
        let bus = Bus::default();
        let journal = journal(&config, &bus);
        let stop = EmergencyStop::open(config.data_folder(), &bus);
        let kept = runtime.block_on(stop.engage(&this_user(), || ()));
        stop.finish(JOURNAL_END);
        journal.map(|journal| journal.finish(JOURNAL_END));
        kept
    });
    match timeout(KEEP_TIMEOUT, keeping).await {
        Ok(kept) => kept.unwrap_or_else(|error| StopKept::No {
            why: error.to_string(),
        }),
        Err(_) => StopKept::NotYet,
    }
}

fn journal(config: &Config, bus: &Bus) -> Option<Journal> {
    JournalReader::open(config.data_folder()).ok().flatten()?;
    startup::journal(config, bus, "", false, Clock::default())
}

/// Stops robots over connections of our own, at the same time.
fn stop_directly(
    connections: &[ConnectionArgs],
    settings: &CommandSettings,
    limit: Duration,
) -> Result<Exit, Failure> {
    let targets: Result<Vec<_>, _> = connections
        .iter()
        .map(|connection| connection.resolve(settings, rand::random()))
        .collect();
    let targets = targets?;
    block_on(async {
        let interrupted = interruption()?;
        let ended = CancellationToken::new();
        let ending = ended.clone();
        tokio::spawn(async move {
            interrupted.await;
            ending.cancel();
        });
        let tries = targets
            .iter()
            .map(|target| stop_with_retries(target, limit, &ended));
        for tried in join_all(tries).await {
            match tried? {
                Some(delivery @ (Delivery::Executed | Delivery::Acknowledged)) => {
                    print(&format!("stopped: {delivery}\n"))?;
                }
                Some(delivery) => {
                    let help = "is the robot still in reach of its Wi-Fi? try again";
                    return Err(Failure::unreachable(delivery).help(help));
                }
                None => return Ok(Exit::Interrupted),
            }
        }
        Ok(Exit::Done)
    })?
}

fn stop_service(service: &Client) -> Result<Exit, Failure> {
    let RunResponse::Stopped { outcome, .. } = ask(service, &RunRequest::Stop, REPLY_TIMEOUT)?
    else {
        return Err(unexpected_reply());
    };
    warn_of(&outcome.kept);
    let words = outcome.confirmation;
    if words == StopConfirmation::NotConfirmed {
        return Err(Failure::unreachable(words));
    }
    print(&format!(
        "stopped: {words}; the robot does not move until it is released, at the page or with `spykee \
         robot reset-stop`\n"
    ))
}

/// Retries until a stop is acknowledged or the time is up. Returns the outcome of the last try that
/// connected; `None` if interrupted before one did.
async fn stop_with_retries(
    target: &RobotTarget,
    limit: Duration,
    ended: &CancellationToken,
) -> Result<Option<Delivery>, LinkError> {
    let until = Instant::now() + limit;
    loop {
        let tried = try_stop(target, ended).await;
        let again = Instant::now() + PAUSE < until && !ended.is_cancelled();
        match tried {
            Ok(Some(delivery)) if delivery.is_owed() && again => {
                tracing::warn!("{delivery}; trying again");
            }
            Err(error) if !error.is_final() && again => {
                tracing::warn!("not stopped yet: {error}; trying again");
            }
            tried => return tried,
        }
        sleep(PAUSE).await;
    }
}

/// Tries once. The login already sends MOVE 0 0; the second stop ends any motion left by the
/// cancelled search.
async fn try_stop(
    target: &RobotTarget,
    ended: &CancellationToken,
) -> Result<Option<Delivery>, LinkError> {
    let mut session = tokio::select! {
        biased;
        () = ended.cancelled() => return Ok(None),
        session = target.connect() => session?,
    };
    let commands = [Command::Engine(Engage::CancelDock), Command::STOP];
    session.writer.write(&commands).await?;
    let (watchdog, _) = watchdog_after_login(&session, &target.config);
    if watchdog.low().is_some() && !watchdog.docked() {
        let level = Battery::reported(session.power).level();
        tracing::warn!(
            "the battery is low ({level}): `spykee robot dock` sends the robot to its station"
        );
    }
    Ok(Some(
        close_gracefully(session.reader, session.writer, DELIVERY).await,
    ))
}

/// Releases STOP in all runs and services that are meant, or else in the data folder.
pub(super) fn reset_stop(
    target: &SharedTargetArgs,
    settings: &CommandSettings,
) -> Result<Exit, Failure> {
    if target.connection.sim.is_some() {
        return Err(Failure::usage(
            "--sim starts a new simulated robot, which nobody has stopped",
        ));
    }
    let config = settings.config()?;
    let runs = match target.find_service(settings)? {
        Some(service) => vec![service],
        None => runs(config.data_folder(), &target.connection)?,
    };
    for run in &runs {
        order(run, &RunRequest::ResetStop, REPLY_TIMEOUT)?;
        print("released: the robot may move again\n")?;
    }
    if runs.is_empty() {
        return reset_in_folder(config);
    }
    Ok(Exit::Done)
}

fn runs(data: &Path, connection: &ConnectionArgs) -> Result<Vec<Client>, Failure> {
    let (mut runs, silent) = block_on(control::runs(data))?;
    if silent > 0 {
        tracing::warn!("a run does not answer: STOP holds there until it is released");
    }
    if let Some(robot) = &connection.robot {
        runs.retain(|run| uses_robot(&run.status, robot));
    }
    Ok(runs)
}

/// Releases what an earlier program has left behind.
fn reset_in_folder(config: &Config) -> Result<Exit, Failure> {
    let data = config.data_folder();
    match EmergencyStop::remove(data) {
        Ok(true) => {
            let bus = Bus::default();
            let journal = journal(config, &bus);
            bus.publish(AgentEvent::StopReset { by: this_user() });
            journal.map(|journal| journal.finish(JOURNAL_END));
            print("released: the next program may move the robot again\n")
        }
        Ok(false) => print("nothing to release: no STOP holds in this data folder\n"),
        Err(error) => {
            let doing = format_args!("release STOP in {}", data.display());
            Err(Failure::io(doing, error))
        }
    }
}
