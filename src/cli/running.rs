//! Finds the active run of this data folder, or the service elsewhere, that uses the chosen robot,
//! and sends requests to it.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use super::interrupt::unless_interrupted;
use super::settings::CommandSettings;
use super::{ConnectionArgs, Exit, Failure, block_on, secret};
use crate::config::ServiceUrl;
use crate::control::{self, AskError, Client, Remote, RunRequest, RunResponse, RunStatus};
use crate::link::Target;
use crate::robot::STOP_HOLDS;

/// Timeout for requests that a run carries out immediately.
pub(super) const REPLY_TIMEOUT: Duration = Duration::from_secs(5);

/// Selects a service on another computer, instead of a run on this one.
#[derive(Debug, Clone, Default, clap::Args)]
pub(super) struct RemoteArgs {
    /// Address of a service, http://HOST:PORT, to use through its JSON API instead of a local run
    /// [default: the config's `remote: url`]
    #[arg(long, value_name = "URL")]
    url: Option<ServiceUrl>,

    /// With --url: file with a token of that service in its first line; `spykee token new` on its
    /// computer creates one
    #[arg(long, value_name = "FILE", requires = "url")]
    token_file: Option<PathBuf>,
}

impl RemoteArgs {
    /// A client of the service that the command line or else the config names, if any.
    pub(super) fn client(&self, settings: &CommandSettings) -> Result<Option<Client>, Failure> {
        let effective = settings.load()?;
        let options = &effective.config.remote;
        let (url, token) = match (&self.url, &options.url) {
            (Some(url), _) => {
                let read = |path: &PathBuf| secret::from_chosen_file(path);
                (url, self.token_file.as_ref().map(read).transpose()?)
            }
            (None, Some(url)) => {
                let file = options.token_file.as_deref();
                (
                    url,
                    secret::from_optional_file(file, effective.found_file())?,
                )
            }
            (None, None) => return Ok(None),
        };
        let remote = Remote::new(url.clone(), token.as_deref()).map_err(Failure::usage)?;
        let asked = block_on(Client::of_service(remote))?;
        asked.map(Some).map_err(|error| unreachable(url, &error))
    }

    fn refuse_with(&self, other: &str) -> Result<(), Failure> {
        if self.url.is_none() {
            return Ok(());
        }
        Err(Failure::usage(format_args!(
            "--url and {other} cannot be combined: a service has its own robot"
        )))
    }
}

fn unreachable(url: &ServiceUrl, error: &AskError) -> Failure {
    let help = match error {
        AskError::Denied(_) => {
            "name a file with a token, --token-file FILE; `spykee token new NAME` there creates one"
        }
        _ => "is the service running there, with `live: { listen: IP:PORT }` in its config?",
    };
    Failure::unreachable(format_args!("{url}: {error}")).help(help)
}

/// The robot, and how to reach it: directly, or through a run or service that uses it.
#[derive(Debug, Clone, clap::Args)]
pub(super) struct SharedTargetArgs {
    #[command(flatten)]
    pub(super) connection: ConnectionArgs,

    #[command(flatten)]
    remote: RemoteArgs,
}

impl SharedTargetArgs {
    /// The active run or the service that uses the chosen robot: see [`find_run_of_target`]. `None`
    /// with `--sim`, which starts its own robot.
    pub(super) fn find_run(&self, settings: &CommandSettings) -> Result<Option<Client>, Failure> {
        find_run(&self.connection, settings, &self.remote)
    }

    /// The service on another computer that the command line or the config names. `None` with
    /// `--sim` or a robot.
    pub(super) fn find_service(
        &self,
        settings: &CommandSettings,
    ) -> Result<Option<Client>, Failure> {
        match self.connection.sim {
            Some(_) => self.remote.refuse_with("--sim").map(|()| None),
            None => service_of(settings, self.connection.robot.as_ref(), &self.remote),
        }
    }
}

/// Refuses a robot that a run or service uses, for commands that need it to themselves.
pub(super) fn refuse_if_in_use(
    connection: &ConnectionArgs,
    settings: &CommandSettings,
) -> Result<(), Failure> {
    let Some(run) = find_run(connection, settings, &RemoteArgs::default())? else {
        return Ok(());
    };
    let what = format!(
        "a run uses the robot {} ({}), but this command needs it to itself",
        run.status.target,
        run.name()
    );
    let failure = Failure::unreachable(what);
    Err(failure.help(
        "end it first: Ctrl-C in its terminal, or `systemctl stop spykee` for a service of systemd",
    ))
}

fn find_run(
    connection: &ConnectionArgs,
    settings: &CommandSettings,
    remote: &RemoteArgs,
) -> Result<Option<Client>, Failure> {
    match connection.sim {
        Some(_) => remote.refuse_with("--sim").map(|()| None),
        None => find_run_of_target(settings, connection.robot.as_ref(), remote, false),
    }
}

fn service_of(
    settings: &CommandSettings,
    robot: Option<&Target>,
    remote: &RemoteArgs,
) -> Result<Option<Client>, Failure> {
    match robot {
        Some(_) => remote.refuse_with("--robot").map(|()| None),
        None => remote.client(settings),
    }
}

/// The run that uses this robot; without one, the service that the command line or the config
/// names, the run that uses the config's robot, or else the only run: that of a simulated robot only
/// if the command is for `any` robot.
pub(super) fn find_run_of_target(
    settings: &CommandSettings,
    robot: Option<&Target>,
    remote: &RemoteArgs,
    any: bool,
) -> Result<Option<Client>, Failure> {
    if let Some(service) = service_of(settings, robot, remote)? {
        return Ok(Some(service));
    }
    let config = settings.config()?;
    let (mut runs, silent) = block_on(control::runs(config.data_folder()))?;
    if silent > 0 {
        tracing::warn!("a run does not answer: is it suspended by Ctrl-Z, or of another version?");
    }
    let is_meant = |run: &Client, target| uses_robot(&run.status, target);
    let own = config.robot.as_ref();
    let own = own.filter(|own| !any || runs.iter().any(|run| is_meant(run, own)));
    if let Some(target) = robot.or(own) {
        runs.retain(|run| is_meant(run, target));
    } else if runs.len() > 1 {
        let robots: Vec<&str> = runs.iter().map(|run| &*run.status.target).collect();
        let failure = Failure::usage("several runs are active: which one?");
        return Err(failure.help(format!("--robot selects one: {}", robots.join(", "))));
    }
    Ok(runs.into_iter().next())
}

/// Whether the run uses this robot: compares the name given to the run, and the connected address.
pub(super) fn uses_robot(run: &RunStatus, target: &Target) -> bool {
    let target = target.to_string();
    let address = |text: &str| text.parse::<SocketAddr>().ok();
    let connected = run.robot.as_ref();
    let connected = connected.and_then(|robot| address(&robot.address));
    run.target == target || (connected.is_some() && connected == address(&target))
}

/// Sends a request to a run and waits for its reply, at most `limit`. If interrupted, the run
/// cancels the request.
pub(super) fn ask(
    run: &Client,
    request: &RunRequest,
    limit: Duration,
) -> Result<RunResponse, Failure> {
    let name = run.name();
    let answer = block_on(unless_interrupted(run.ask(request, limit)))??;
    let answer = answer.ok_or_else(Failure::interrupted)?.map_err(|error| {
        Failure::unreachable(format_args!("{error} ({name})"))
            .help("`spykee status` lists the active runs")
    })?;
    match answer {
        RunResponse::Offline => {
            let what = format!("the run ({name}) has lost the robot and is reconnecting");
            let failure = Failure::unreachable(what);
            Err(failure.help("is the robot still in reach of its Wi-Fi?"))
        }
        RunResponse::Refused { error: why } => {
            let what = format!("the run ({name}) refused the request: {why}");
            if why == STOP_HOLDS {
                return Err(Failure::new(Exit::Safety, what));
            }
            Err(Failure::new(Exit::Failed, what)
                .help("`spykee status` shows its state, `spykee behaviour list` its behaviours"))
        }
        answer => Ok(answer),
    }
}

/// Like [`ask`], for a request to which the run replies only that it has carried it out.
pub(super) fn order(run: &Client, request: &RunRequest, limit: Duration) -> Result<Exit, Failure> {
    match ask(run, request, limit)? {
        RunResponse::Done => Ok(Exit::Done),
        _ => Err(unexpected_reply()),
    }
}

/// The failure for a reply that does not match the request, which only a run of another version
/// sends.
pub(super) fn unexpected_reply() -> Failure {
    Failure::unreachable("the run sent an unexpected reply")
        .help("was it started by another version of this program?")
}
