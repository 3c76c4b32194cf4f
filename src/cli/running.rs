//! Runs that are on in this data folder: which of them has the robot that is meant, and what becomes of
//! an errand that it is sent.

use std::net::SocketAddr;
use std::time::Duration;

use super::interrupt::interruption;
use super::remote::RemoteArgs;
use super::settings::SettingsArgs;
use super::{ConnectionArgs, Exit, Failure, block_on};
use crate::control::{self, Answer, Client, Errand};
use crate::link::Target;

/// How long a run may take for what is done at once.
pub(super) const AT_ONCE: Duration = Duration::from_secs(5);

/// The run that has the named robot, else the config's robot, or else the only run. With --sim there is
/// no such run: the robot is started here.
///
/// # Errors
/// A config that cannot be used; several runs, and none was named.
pub(super) fn run_on(
    settings: &SettingsArgs,
    connection: &ConnectionArgs,
    remote: &RemoteArgs,
) -> Result<Option<Client>, Failure> {
    match connection.sim {
        Some(_) if remote.is_named() => Err(Failure::usage(
            "--url and --sim cannot be combined: a service has its own robot",
        )),
        Some(_) => Ok(None),
        None => run_of(settings, connection.robot.as_ref(), remote),
    }
}

/// The run that has this robot; without one, the service of the command line or the config, the run
/// that has the config's robot, or else the only run.
///
/// # Errors
/// As [`run_on`].
pub(super) fn run_of(
    settings: &SettingsArgs,
    robot: Option<&Target>,
    remote: &RemoteArgs,
) -> Result<Option<Client>, Failure> {
    if robot.is_some() && remote.is_named() {
        return Err(Failure::usage(
            "--url and --robot cannot be combined: a service has its own robot",
        ));
    }
    if robot.is_none()
        && let Some(service) = remote.client(settings)?
    {
        return Ok(Some(service));
    }
    let config = settings.config()?;
    let (mut runs, silent) = block_on(control::runs(config.data_folder()))?;
    if silent > 0 {
        tracing::warn!("a run does not answer: is it stopped by Ctrl-Z, or of another version?");
    }
    if let Some(target) = robot.or(config.robot.as_ref()) {
        runs.retain(|run| has(run, target));
    } else if runs.len() > 1 {
        let robots: Vec<&str> = runs.iter().map(|run| &*run.overview.target).collect();
        let failure = Failure::usage("several runs are active: which one?");
        return Err(failure.help(format!("--robot selects one: {}", robots.join(", "))));
    }
    Ok(runs.into_iter().next())
}

/// By name as the run was given it, or by address.
fn has(run: &Client, target: &Target) -> bool {
    let target = target.to_string();
    let address = |text: &str| text.parse::<SocketAddr>().ok();
    let connected = run.overview.robot.as_ref();
    let connected = connected.and_then(|robot| address(&robot.address));
    run.overview.target == target || (connected.is_some() && connected == address(&target))
}

/// Asks a run, and waits so long. `None`: interrupted; then the run gives the errand up.
///
/// # Errors
/// It does not answer, its robot is out of reach, or it refuses.
pub(super) fn ask(
    run: &Client,
    errand: &Errand,
    limit: Duration,
) -> Result<Option<Answer>, Failure> {
    let name = run.name();
    let answer = block_on(async {
        let interrupted = interruption()?;
        tokio::select! {
            biased;
            () = interrupted => Ok(None),
            answer = run.ask(errand, limit) => answer.map(Some).map_err(|error| {
                Failure::new(Exit::Unreachable, format_args!("{error} ({name})"))
                    .help("`spykee status` lists the active runs")
            }),
        }
    })??;
    match answer {
        Some(Answer::Offline) => {
            let what = format!("the run ({name}) has lost the robot and is reconnecting");
            let failure = Failure::new(Exit::Unreachable, what);
            Err(failure.help("is the robot still in reach of its Wi-Fi?"))
        }
        Some(Answer::Refused(why)) => {
            let what = format!("the run ({name}) refuses it: {why}");
            Err(Failure::new(Exit::Script, what).help("`spykee status` shows its state"))
        }
        answer => Ok(answer),
    }
}

/// An answer to another question: only a run of another version gives such a one.
pub(super) fn nonsense() -> Failure {
    Failure::new(Exit::Unreachable, "the run gave an unexpected answer")
        .help("was it started by another version of this program?")
}

/// The run has the robot, and this needs it alone.
pub(super) fn taken(run: &Client) -> Failure {
    let overview = &run.overview;
    let what = format!(
        "a run has the robot {} ({}), and this needs it alone",
        overview.target,
        run.name()
    );
    Failure::new(Exit::Unreachable, what).help("end the run first: `spykee robot stop` does")
}
