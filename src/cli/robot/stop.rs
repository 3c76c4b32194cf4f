//! `spykee robot stop` and `reset-stop`: stops the tracks, with retries, and releases a STOP.

use std::time::Duration;

use tokio::time::{Instant, sleep};
use tokio_util::sync::CancellationToken;

use super::{RobotTarget, SharedTargetArgs, TargetArgs};
use crate::cli::interrupt::interruption;
use crate::cli::running::{REPLY_TIMEOUT, ask, unexpected_reply};
use crate::cli::{Exit, Failure, argument, block_on, print};
use crate::control::{Client, EmergencyStop, RunRequest, RunResponse};
use crate::link::{LinkError, close_gracefully};
use crate::pilot::{DELIVERY, Delivery};
use crate::safety::{Fact, Watchdog};
use crate::wire::{Command, Engage};

/// Pause between two tries.
const PAUSE: Duration = Duration::from_millis(200);

/// Stop the robot: tracks and the search for its station
///
/// Logs in, sends MOVE 0 0, ends a search for the station, sends MOVE 0 0 again, and exits when the
/// robot's side has acknowledged that. If the robot cannot be reached, or does not acknowledge
/// within 2 s, retries until --timeout; then the exit code is 3. A signal ends the retries, but not
/// a try that has connected. The robot stays where it is even if its battery is low: `spykee robot
/// dock` sends it home.
///
/// If a `spykee run` uses the robot, it stops the robot at once, whatever drives it, and ends.
/// While any other program is connected, the robot refuses further logins: that program must stop
/// it. With --url the service continues, and the robot stays stopped until a person releases it, at
/// the page or with `spykee robot reset-stop`.
///
/// Settings that cannot be used do not prevent a stop: those of the config file alone are used, or
/// else the defaults. Then name the robot with --robot, unless a run uses it.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot stop --robot 172.17.6.1")]
pub(super) struct StopArgs {
    /// Time limit for the retries, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 10,
          value_parser = argument::whole::<u64>(1..=600))]
    timeout: u64,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

pub(super) fn stop(args: &StopArgs) -> Result<Exit, Failure> {
    let mut args = args.clone();
    args.target.alone.settings = args.target.settings.or_defaults();
    let running = args.target.find_run()?;
    if let Some(run) = running.as_ref().filter(|run| run.is_remote()) {
        return stop_through_service(run);
    }
    let mut target = TargetArgs::clone(&args.target);
    if let Some(run) = &running {
        tracing::info!(
            "ending the run that uses the robot (process {})",
            run.overview.pid
        );
        let asked = ask(run, &RunRequest::Stop, REPLY_TIMEOUT);
        if run.overview.simulated {
            if asked?.is_none() {
                return Ok(Exit::Interrupted);
            }
            print("stopped: the simulated robot ends with its run\n")?;
            return Ok(Exit::Done);
        }
        // The steps below stop the robot in any case, once it accepts the login.
        if let Err(failure) = asked {
            tracing::warn!("{failure}");
        }
        // Without --robot, the run was found without an address: use that of its robot.
        target.connection.robot = run.overview.target.parse().ok();
    }
    let target = target.resolve(rand::random())?;
    let limit = Duration::from_secs(args.timeout);
    block_on(async {
        let interrupted = interruption()?;
        let ended = CancellationToken::new();
        let ending = ended.clone();
        tokio::spawn(async move {
            interrupted.await;
            ending.cancel();
        });
        match stop_with_retries(&target, limit, &ended).await? {
            Some(delivery @ (Delivery::Executed | Delivery::Acknowledged)) => {
                print(&format!("stopped: {delivery}\n"))?;
                Ok(Exit::Done)
            }
            Some(delivery) => {
                let help = "is the robot still in reach of its Wi-Fi? try again";
                Err(Failure::new(Exit::Unreachable, delivery).help(help))
            }
            None => Ok(Exit::Interrupted),
        }
    })?
}

/// Stops the robot through a service. The service continues, but the robot cannot move until the
/// stop is released.
fn stop_through_service(run: &Client) -> Result<Exit, Failure> {
    if ask(run, &RunRequest::Stop, REPLY_TIMEOUT)?.is_none() {
        return Ok(Exit::Interrupted);
    }
    print(
        "stopped: the robot does not move until it is released, at the page or with `spykee robot \
         reset-stop`\n",
    )?;
    Ok(Exit::Done)
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
    let mut watchdog = Watchdog::new(target.config.watchdog.clone(), Instant::now());
    let docked = session.accepted.docked;
    let power = session.power;
    watchdog.handle(Fact::LinkUp { docked, power }, Instant::now());
    if watchdog.low().is_some() && !watchdog.docked() {
        let percent = power.percent;
        tracing::warn!(
            "the battery is low ({percent} %): `spykee robot dock` sends the robot to its station"
        );
    }
    Ok(Some(
        close_gracefully(session.reader, session.writer, DELIVERY).await,
    ))
}

/// Release STOP, so that the robot may move again
///
/// STOP at the page, or through the API, holds until a person releases it, also in later programs of
/// the same data folder. If a run or service uses the robot, this releases it there, as the button
/// on the page does; otherwise it releases what an earlier one has left behind in the data folder.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot reset-stop")]
pub(super) struct ResetStopArgs {
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

pub(super) fn reset_stop(args: &ResetStopArgs) -> Result<Exit, Failure> {
    if args.target.connection.sim.is_some() {
        return Err(Failure::usage(
            "--sim starts a new simulated robot, which nobody has stopped",
        ));
    }
    if let Some(run) = args.target.find_run()? {
        return match ask(&run, &RunRequest::ResetStop, REPLY_TIMEOUT)? {
            None => Ok(Exit::Interrupted),
            Some(RunResponse::Done) => {
                print("released: the robot may move again\n")?;
                Ok(Exit::Done)
            }
            Some(_) => Err(unexpected_reply()),
        };
    }
    let data = args.target.settings.config()?.data_folder();
    match EmergencyStop::remove(data) {
        Ok(true) => print("released: the next program may move the robot again\n")?,
        Ok(false) => print("nothing to release: no STOP holds in this data folder\n")?,
        Err(error) => {
            let doing = format_args!("release STOP in {}", data.display());
            return Err(Failure::io(doing, error));
        }
    }
    Ok(Exit::Done)
}
