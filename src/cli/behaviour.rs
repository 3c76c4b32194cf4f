//! `spykee behaviour`: starts and stops the behaviours of a run that is on.

use std::time::Duration;

use clap::Subcommand;
use serde_json::{Value, json};

use super::running::{ask, nonsense, run_of};
use super::runs::clock;
use super::settings::SettingsArgs;
use super::table::{Side, aligned};
use super::{Exit, Failure, print};
use crate::control::{Answer, Change, Client, Errand, Listed};
use crate::link::Target;

/// A farewell of the old script, the loading of the new one, and some patience.
const CHANGED: Duration = Duration::from_secs(15);

const HEAD: [(&str, Side); 5] = [
    ("BEHAVIOUR", Side::Left),
    ("STATE", Side::Left),
    ("RUNNING", Side::Right),
    ("PRIORITY", Side::Right),
    ("LAST ENDED", Side::Left),
];

/// Start, stop and restart the behaviours of a run that is on, or list them
///
/// Asks the `spykee run` or `spykee serve` of this data folder, by its private socket there. A script is
/// read from its file when it starts; one with a mistake is refused.
#[derive(Debug, Clone, clap::Args)]
#[command(
    subcommand_required = true,
    arg_required_else_help = true,
    after_help = "Examples:\n  spykee behaviour list\n  spykee behaviour start patrol\n  spykee behaviour restart guard"
)]
pub(super) struct BehaviourArgs {
    #[command(subcommand)]
    command: BehaviourCommand,
}

#[derive(Debug, Clone, Subcommand)]
enum BehaviourCommand {
    /// List the behaviours of the run and what each does
    List(ListArgs),
    /// Start a behaviour that does not run
    Start(NameArgs),
    /// End a behaviour; it is not restarted
    Stop(NameArgs),
    /// End a behaviour if it runs, and start it from its file as that is now
    Restart(NameArgs),
}

#[derive(Debug, Clone, clap::Args)]
struct ListArgs {
    /// Print a JSON list
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    which: WhichArgs,
}

#[derive(Debug, Clone, clap::Args)]
struct NameArgs {
    /// The behaviour, as `spykee behaviour list` shows it
    name: String,
    #[command(flatten)]
    which: WhichArgs,
}

/// Which run.
#[derive(Debug, Clone, clap::Args)]
struct WhichArgs {
    /// The run that has this robot; without it the only run that is on
    #[arg(long, value_name = "HOST[:PORT]")]
    robot: Option<Target>,
    #[command(flatten)]
    settings: SettingsArgs,
}

impl BehaviourArgs {
    /// Which settings count.
    pub(super) fn settings(&self) -> &SettingsArgs {
        match &self.command {
            BehaviourCommand::List(args) => &args.which.settings,
            BehaviourCommand::Start(args)
            | BehaviourCommand::Stop(args)
            | BehaviourCommand::Restart(args) => &args.which.settings,
        }
    }
}

/// Asks the run.
///
/// # Errors
/// No run is on, several are and none was named, or it refuses.
pub(super) fn run(args: &BehaviourArgs) -> Result<Exit, Failure> {
    match &args.command {
        BehaviourCommand::List(args) => list(args),
        BehaviourCommand::Start(args) => change(args, Change::Start),
        BehaviourCommand::Stop(args) => change(args, Change::Stop),
        BehaviourCommand::Restart(args) => change(args, Change::Restart),
    }
}

fn list(args: &ListArgs) -> Result<Exit, Failure> {
    match ask(&args.which.client()?, &Errand::Behaviours, CHANGED)? {
        None => Ok(Exit::Interrupted),
        Some(Answer::Behaviours(behaviours)) => {
            if args.json {
                let behaviours = behaviours.iter().map(object).collect();
                print(&format!("{}\n", Value::Array(behaviours)))?;
            } else {
                let rows: Vec<Vec<String>> = behaviours.iter().map(row).collect();
                print(&aligned(&HEAD, &rows))?;
            }
            Ok(Exit::Done)
        }
        Some(_) => Err(nonsense()),
    }
}

fn change(args: &NameArgs, change: Change) -> Result<Exit, Failure> {
    let name = args.name.clone();
    let errand = Errand::Behaviour { name, change };
    match ask(&args.which.client()?, &errand, CHANGED)? {
        None => Ok(Exit::Interrupted),
        Some(Answer::Done) => {
            let done = match change {
                Change::Start => "runs",
                Change::Stop => "has ended",
                Change::Restart => "runs anew",
            };
            print(&format!("{} {done}\n", args.name))?;
            Ok(Exit::Done)
        }
        Some(_) => Err(nonsense()),
    }
}

impl WhichArgs {
    fn client(&self) -> Result<Client, Failure> {
        let found = run_of(&self.settings, self.robot.as_ref())?;
        let data = self.settings.config()?.data_folder().display();
        found.ok_or_else(|| {
            Failure::new(Exit::Unreachable, format_args!("no run is on in {data}"))
                .help("`spykee run` and `spykee serve` begin one; `spykee status` lists them")
        })
    }
}

fn row(one: &Listed) -> Vec<String> {
    vec![
        one.name.clone(),
        one.state.clone(),
        one.running.map_or_else(|| "-".to_owned(), clock),
        one.priority.0.to_string(),
        one.ending.as_ref().map_or_else(
            || "-".to_owned(),
            |(reason, words)| format!("{reason}: {words}"),
        ),
    ]
}

fn object(one: &Listed) -> Value {
    let ending = one.ending.as_ref();
    json!({
        "name": one.name, "priority": one.priority.0, "state": one.state,
        "seconds": one.running.map(|time| time.as_secs()),
        "ended": ending.map(|(reason, _)| reason.to_string()),
        "message": ending.map(|(_, words)| words),
    })
}
