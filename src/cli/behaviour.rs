//! `spykee behaviour`: starts, stops and lists the behaviours of an active run.

use std::time::Duration;

use clap::Subcommand;

use super::argument::ArgumentError;
use super::running::RemoteArgs;
use super::running::{ask, find_run_of_target, unexpected_reply};
use super::settings::SettingsArgs;
use super::table::{Side, aligned};
use super::{Exit, Failure, print};
use crate::clock::{self, Span};
use crate::control::{BehaviourListing, Change, Client, RunRequest, RunResponse};
use crate::link::Target;

/// Timeout of a request: the old script's end handlers, loading the new script, and a margin.
const CHANGE_TIMEOUT: Duration = Duration::from_secs(15);

const HEAD: [(&str, Side); 5] = [
    ("BEHAVIOUR", Side::Left),
    ("STATE", Side::Left),
    ("RUNNING", Side::Right),
    ("PRIORITY", Side::Right),
    ("LAST ENDED", Side::Left),
];

/// Start, stop, restart or list the behaviours of an active run
///
/// Asks the `spykee run` or `spykee serve` of this data folder through its private socket, or with
/// --url a service on another computer. Each start reads the script from its file; a script with a
/// mistake is refused.
#[derive(Debug, Clone, clap::Args)]
#[command(
    subcommand_required = true,
    arg_required_else_help = true,
    after_help = "Examples:\n  spykee behaviour list\n  spykee behaviour start patrol --for 30m\n  spykee behaviour restart guard"
)]
pub(super) struct BehaviourArgs {
    #[command(subcommand)]
    command: BehaviourCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum BehaviourCommand {
    /// List the behaviours of the run with their states
    List(ListArgs),
    /// Start a behaviour that is not running
    Start(StartArgs),
    /// End a behaviour; it is not restarted
    Stop(NameArgs),
    /// End a behaviour if it is running, then start it from the current version of its file
    Restart(NameArgs),
}

#[derive(Debug, Clone, clap::Args)]
struct ListArgs {
    /// Print a JSON array
    #[arg(long)]
    json: bool,
    /// Print only the names, one per line, for shells; omits names with characters other than
    /// letters, digits, `.`, `_` and `-`
    #[arg(long, conflicts_with = "json")]
    names: bool,
    #[command(flatten)]
    which: WhichArgs,
}

#[derive(Debug, Clone, clap::Args)]
struct NameArgs {
    /// The behaviour's name, as in `spykee behaviour list`
    name: String,
    #[command(flatten)]
    which: WhichArgs,
}

#[derive(Debug, Clone, clap::Args)]
struct StartArgs {
    /// End the behaviour after this time, in seconds or such as 30m or 1h30m, if it has not ended
    /// before
    #[arg(long = "for", value_name = "TIME", value_parser = parse_duration)]
    lasts: Option<Span>,
    #[command(flatten)]
    name: NameArgs,
}

/// Parses a duration above zero.
fn parse_duration(text: &str) -> Result<Span, ArgumentError> {
    let span: Span = text.parse()?;
    if span.get().is_zero() {
        return Err(ArgumentError::NoTime);
    }
    Ok(span)
}

/// Selects the run.
#[derive(Debug, Clone, clap::Args)]
struct WhichArgs {
    /// Address of the robot whose run to use [default: the only active run]
    #[arg(long, value_name = "HOST[:PORT]")]
    robot: Option<Target>,
    #[command(flatten)]
    remote: RemoteArgs,
    #[command(flatten)]
    settings: SettingsArgs,
}

impl BehaviourArgs {
    /// The settings of the chosen subcommand.
    pub(super) fn settings(&self) -> &SettingsArgs {
        match &self.command {
            BehaviourCommand::List(args) => &args.which.settings,
            BehaviourCommand::Start(args) => &args.name.which.settings,
            BehaviourCommand::Stop(args) | BehaviourCommand::Restart(args) => &args.which.settings,
        }
    }
}

/// Sends the request to the run and prints the reply.
pub(super) fn run(args: &BehaviourArgs) -> Result<Exit, Failure> {
    match &args.command {
        BehaviourCommand::List(args) => list(args),
        BehaviourCommand::Start(StartArgs { lasts, name }) => change(name, Change::Start, *lasts),
        BehaviourCommand::Stop(args) => change(args, Change::Stop, None),
        BehaviourCommand::Restart(args) => change(args, Change::Restart, None),
    }
}

fn list(args: &ListArgs) -> Result<Exit, Failure> {
    match ask(
        &args.which.client()?,
        &RunRequest::Behaviours,
        CHANGE_TIMEOUT,
    )? {
        None => Ok(Exit::Interrupted),
        Some(RunResponse::Behaviours { behaviours }) => {
            if args.json {
                let text = serde_json::to_string(&behaviours).map_err(Failure::internal)?;
                print(&format!("{text}\n"))?;
            } else if args.names {
                let names = behaviours.iter().map(|one| one.name.as_str());
                let plain = names.filter(|name| is_plain(name));
                print(&plain.map(|name| format!("{name}\n")).collect::<String>())?;
            } else {
                let rows: Vec<Vec<String>> = behaviours.iter().map(row).collect();
                print(&aligned(&HEAD, &rows))?;
            }
            Ok(Exit::Done)
        }
        Some(_) => Err(unexpected_reply()),
    }
}

fn change(args: &NameArgs, change: Change, lasts: Option<Span>) -> Result<Exit, Failure> {
    let request = RunRequest::Behaviour {
        name: args.name.clone(),
        change,
        lasts,
    };
    match ask(&args.which.client()?, &request, CHANGE_TIMEOUT)? {
        None => Ok(Exit::Interrupted),
        Some(RunResponse::Done) => {
            let done = match (change, lasts) {
                (Change::Start, None) => "runs".to_owned(),
                (Change::Start, Some(lasts)) => {
                    let whole = Duration::from_secs(lasts.get().as_secs_f64().ceil() as u64);
                    format!("runs, for {} at most", clock::hours(whole))
                }
                (Change::Stop, _) => "has ended".to_owned(),
                (Change::Restart, _) => "restarted".to_owned(),
            };
            print(&format!("{} {done}\n", args.name))?;
            Ok(Exit::Done)
        }
        Some(_) => Err(unexpected_reply()),
    }
}

impl WhichArgs {
    fn client(&self) -> Result<Client, Failure> {
        let found = find_run_of_target(&self.settings, self.robot.as_ref(), &self.remote)?;
        let data = self.settings.config()?.data_folder().display();
        found.ok_or_else(|| {
            Failure::new(
                Exit::Unreachable,
                format_args!("no run is active in {data}"),
            )
            .help("`spykee run` and `spykee serve` start one; `spykee status` lists them")
        })
    }
}

/// Whether this name is safe in shell completion: bash expands completion words, including command
/// substitutions in them.
fn is_plain(name: &str) -> bool {
    let plain = |letter: char| letter.is_alphanumeric() || "._-".contains(letter);
    !name.starts_with('-') && name.chars().all(plain)
}

fn row(one: &BehaviourListing) -> Vec<String> {
    vec![
        one.name.clone(),
        one.state.clone(),
        one.running.map_or_else(
            || "-".to_owned(),
            |seconds| clock::hours(Duration::from_secs(seconds)),
        ),
        one.priority.0.to_string(),
        one.exit.as_ref().map_or_else(
            || "-".to_owned(),
            |exit| format!("{}: {}", exit.reason, exit.text),
        ),
    ]
}
