//! `spykee behaviour`: starts, stops and lists the behaviours of an active run.

use std::time::Duration;

use clap::Subcommand;

use super::running::{RemoteArgs, ask, find_run_of_target, order, unexpected_reply};
use super::runs::next_start;
use super::settings::CommandSettings;
use super::table::{aligned, or_dash};
use super::{Exit, Failure, print, print_json};
use crate::agent::Change;
use crate::clock::{self, Span};
use crate::control::{BehaviourListing, Client, RunRequest, RunResponse};
use crate::link::Target;
use crate::timetable::TimetableChange;

/// Timeout of a request: the old script's end handlers, loading the new script, and a margin.
const CHANGE_TIMEOUT: Duration = Duration::from_secs(15);

const HEAD: &str = "BEHAVIOUR|STATE|>RUNNING|>PRIORITY|LAST ENDED";

#[derive(Debug, Clone, Subcommand)]
pub(super) enum BehaviourCommand {
    /// List the behaviours of the run with their states
    List {
        /// Print a JSON array
        #[arg(long)]
        json: bool,
        /// Print only the names, one per line, for shells; omits names with characters other than
        /// letters, digits, `.`, `_` and `-`
        #[arg(long, conflicts_with = "json")]
        names: bool,
        #[command(flatten)]
        which: WhichArgs,
    },
    /// Start a behaviour that is not running
    Start {
        /// End the behaviour after this time, in seconds or such as 30m or 1h30m, if it has not
        /// ended before
        #[arg(long = "for", value_name = "TIME", value_parser = parse_duration)]
        lasts: Option<Span>,
        #[command(flatten)]
        name: NameArgs,
    },
    /// End a behaviour; it is not restarted
    Stop(NameArgs),
    /// End a behaviour if it is running, then start it from the current version of its file
    Restart(NameArgs),
    /// Leave out the timetable's next start, or start nothing until a time
    ///
    /// Holds also after a restart of the service. `spykee status` shows it.
    #[command(after_help = "Example: spykee behaviour timetable pause \"2026-05-04 18:00\"")]
    Timetable {
        /// What to change
        change: TimetableChange,
        /// With `pause`: its end, in the service's time zone
        #[arg(required_if_eq("change", "pause"))]
        until: Option<String>,
        #[command(flatten)]
        which: WhichArgs,
    },
}

#[derive(Debug, Clone, clap::Args)]
pub(super) struct NameArgs {
    /// The behaviour's name, as in `spykee behaviour list`
    name: String,
    #[command(flatten)]
    which: WhichArgs,
}

fn parse_duration(text: &str) -> Result<Span, String> {
    match text.parse::<Span>() {
        Ok(span) if span.get().is_zero() => Err("expected a duration above zero".to_owned()),
        span => span.map_err(|error| error.to_string()),
    }
}

#[derive(Debug, Clone, clap::Args)]
pub(super) struct WhichArgs {
    /// Address of the robot whose run to use [default: the only active run]
    #[arg(long, value_name = "HOST[:PORT]")]
    robot: Option<Target>,
    #[command(flatten)]
    remote: RemoteArgs,
}

/// Sends the request to the run and prints the reply.
pub(super) fn run(command: &BehaviourCommand, settings: &CommandSettings) -> Result<Exit, Failure> {
    let (args, change, lasts) = match command {
        BehaviourCommand::List { json, names, which } => {
            return list(*json, *names, &which.client(settings)?);
        }
        BehaviourCommand::Timetable {
            change,
            until,
            which,
        } => return change_timetable(*change, until.clone(), &which.client(settings)?, settings),
        BehaviourCommand::Start { lasts, name } => (name, Change::Start, *lasts),
        BehaviourCommand::Stop(args) => (args, Change::Stop, None),
        BehaviourCommand::Restart(args) => (args, Change::Restart, None),
    };
    let request = RunRequest::Behaviour {
        name: args.name.clone(),
        change,
        lasts,
    };
    let exit = order(&args.which.client(settings)?, &request, CHANGE_TIMEOUT)?;
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
    Ok(exit)
}

fn change_timetable(
    change: TimetableChange,
    until: Option<String>,
    run: &Client,
    settings: &CommandSettings,
) -> Result<Exit, Failure> {
    let request = RunRequest::Timetable {
        change,
        until,
        start: None,
    };
    order(run, &request, CHANGE_TIMEOUT)?;
    let RunResponse::Status(status) = ask(run, &RunRequest::Status, CHANGE_TIMEOUT)? else {
        return Err(unexpected_reply());
    };
    let next = next_start(&status, &settings.config()?.zone());
    print(&format!("next start: {next}\n"))
}

fn list(json: bool, only_names: bool, run: &Client) -> Result<Exit, Failure> {
    let RunResponse::Behaviours { behaviours } = ask(run, &RunRequest::Behaviours, CHANGE_TIMEOUT)?
    else {
        return Err(unexpected_reply());
    };
    if json {
        print_json(&behaviours)
    } else if only_names {
        let names = behaviours.iter().map(|one| one.name.as_str());
        let plain = names.filter(|name| is_plain(name));
        print(&plain.map(|name| format!("{name}\n")).collect::<String>())
    } else {
        print(&aligned(HEAD, behaviours.iter().map(row)))
    }
}

impl WhichArgs {
    fn client(&self, settings: &CommandSettings) -> Result<Client, Failure> {
        let found = find_run_of_target(settings, self.robot.as_ref(), &self.remote, true)?;
        let data = settings.config()?.data_folder().display();
        found.ok_or_else(|| {
            Failure::unreachable(format_args!("no run is active in {data}"))
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
    let running = one.running.map(Duration::from_secs);
    let exit = one.exit.as_ref();
    vec![
        one.name.clone(),
        one.state.clone(),
        or_dash(running.map(clock::hours)),
        one.priority.0.to_string(),
        or_dash(exit.map(|exit| format!("{}: {}", exit.reason, exit.text))),
    ]
}
