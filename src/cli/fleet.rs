//! `spykee fleet`: all agents of a broker.

use std::collections::BTreeSet;
use std::time::Duration;

use clap::Subcommand;
use serde_json::{Value, json};

use super::broker;
use super::settings::SettingsArgs;
use super::table::{Side, aligned};
use super::{Exit, Failure, block_on, print};
use crate::mqtt::{BrokerCommand, Fleet, FleetError, Found, Presence};

/// How long an agent may take to answer: behaviours are loaded and ended meanwhile.
const ANSWER: Duration = Duration::from_secs(15);
/// Everybody.
const ALL: &str = "all";

const HEAD: [(&str, Side); 6] = [
    ("ROBOT", Side::Left),
    ("CONNECTION", Side::Left),
    ("STATE", Side::Left),
    ("BATTERY", Side::Right),
    ("RUNNING", Side::Left),
    ("PROBLEM", Side::Left),
];

/// Address all robots of an MQTT broker: list them, run a behaviour, stop
///
/// The config names the broker (`mqtt: { host: ... }`); every run whose config names the same
/// broker appears there under its robot's uid. The exit code is 4 if any robot did not do what was
/// asked.
#[derive(Debug, Clone, clap::Args)]
#[command(
    after_help = "Examples:\n  spykee fleet list\n  spykee fleet run patrol --on all\n  \
                        spykee fleet stop SPYKEE0001 SPYKEE0007\n  spykee fleet stop all"
)]
pub(super) struct FleetArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Clone, Subcommand)]
enum Action {
    /// List the robots and the state of each: ONLINE, OFFLINE (logged off),
    /// CONNECTIONBROKEN (lost its connection)
    List {
        /// Print a JSON list
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        settings: SettingsArgs,
    },
    /// Start a behaviour
    Run {
        /// The behaviour's name in the robots' configs
        #[arg(value_name = "NAME")]
        behaviour: String,
        /// The robots' uids, or `all`: every robot that is online
        #[arg(long, value_name = "UID", required = true, num_args = 1..)]
        on: Vec<String>,
        #[command(flatten)]
        settings: SettingsArgs,
    },
    /// Stop robots: their tracks stop, and their behaviours end
    Stop {
        /// The robots' uids, or `all`: every robot that is online
        #[arg(value_name = "UID", required = true)]
        robots: Vec<String>,
        #[command(flatten)]
        settings: SettingsArgs,
    },
}

impl FleetArgs {
    pub(super) fn settings(&self) -> &SettingsArgs {
        match &self.action {
            Action::List { settings, .. }
            | Action::Run { settings, .. }
            | Action::Stop { settings, .. } => settings,
        }
    }
}

/// Goes to the broker.
///
/// # Errors
/// No broker in the config, or none in reach.
pub(super) fn run(args: &FleetArgs) -> Result<Exit, Failure> {
    let account = broker::account(args.settings().load()?)?.ok_or_else(|| {
        Failure::usage("the config names no broker")
            .help("mqtt: { host: broker.local }; README.md, \"MQTT\", has more")
    })?;
    let visit = async {
        let mut fleet = Fleet::visit(account).await.map_err(unreachable)?;
        let exit = act(&mut fleet, &args.action).await;
        fleet.leave().await;
        exit
    };
    block_on(visit)?
}

async fn act(fleet: &mut Fleet, action: &Action) -> Result<Exit, Failure> {
    match action {
        Action::List { json, .. } => list(fleet, *json),
        Action::Run { behaviour, on, .. } => {
            order(fleet, &BrokerCommand::Run(behaviour.clone()), on).await
        }
        Action::Stop { robots, .. } => order(fleet, &BrokerCommand::Stop, robots).await,
    }
}

fn unreachable(error: FleetError) -> Failure {
    Failure::new(Exit::Unreachable, error)
        .help("is it the broker that `spykee config show --origin` names, and does it run?")
}

fn list(fleet: &Fleet, as_json: bool) -> Result<Exit, Failure> {
    let found: Vec<&Found> = fleet.found().collect();
    if as_json {
        let list: Vec<Value> = found.into_iter().map(object).collect();
        print(&format!("{}\n", Value::Array(list)))?;
    } else if found.is_empty() {
        print("no robot has been at this broker\n")?;
    } else {
        let rows: Vec<Vec<String>> = found.into_iter().map(row).collect();
        print(&aligned(&HEAD, &rows))?;
    }
    Ok(Exit::Done)
}

fn object(found: &Found) -> Value {
    let Found {
        robot,
        presence,
        state,
    } = found;
    json!({ "robot": robot, "connection": presence, "state": state })
}

/// What one that is not there said last may no longer be so.
fn row(found: &Found) -> Vec<String> {
    let mut row = vec![found.robot.clone(), found.presence.word().to_owned()];
    if found.presence == Presence::Online {
        let text = |key: &str| found.state[key].as_str().unwrap_or("-").to_owned();
        let battery = found.state["battery"].as_u64();
        let running = found.state["running"].as_array();
        let names = running.into_iter().flatten().filter_map(Value::as_str);
        row.push(text("state"));
        row.push(battery.map_or_else(|| "-".to_owned(), |percent| format!("{percent} %")));
        row.push(names.collect::<Vec<_>>().join(" "));
        row.push(found.state["reason"].as_str().unwrap_or("").to_owned());
    }
    row
}

/// Asks them all at once, and tells of each how it went.
async fn order(
    fleet: &mut Fleet,
    order: &BrokerCommand,
    named: &[String],
) -> Result<Exit, Failure> {
    let (chosen, absent) = choose(fleet, named)?;
    let answers = fleet.ask(&chosen, order, ANSWER).await;
    let answers = answers.map_err(unreachable)?;
    let mut exit = if absent.is_empty() {
        Exit::Done
    } else {
        Exit::Check
    };
    let mut text = String::new();
    for (robot, presence) in absent {
        text += &format!("{robot}: not asked, it is {}\n", presence.word());
    }
    for robot in chosen {
        let outcome = match answers.get(&robot) {
            Some(answer) if answer.done => "done".to_owned(),
            Some(answer) => {
                exit = Exit::Check;
                format!(
                    "not done: {}",
                    answer.text.as_deref().unwrap_or("no reason")
                )
            }
            None => {
                exit = Exit::Check;
                format!("no answer within {} s", ANSWER.as_secs())
            }
        };
        text += &format!("{robot}: {outcome}\n");
    }
    print(&text)?;
    Ok(exit)
}

/// The robots that are asked, and those that are not there.
type Chosen = (Vec<String>, Vec<(String, Presence)>);

/// Who is asked, and of those who are meant and are not there how it is with them. An agent whose
/// connection broke may drive on without its broker: also `all` tells that it was not asked.
fn choose(fleet: &Fleet, named: &[String]) -> Result<Chosen, Failure> {
    let all = named.iter().any(|name| name == ALL);
    let names: BTreeSet<&str> = named.iter().map(String::as_str).collect();
    let unknown = names
        .iter()
        .find(|name| **name != ALL && fleet.found().all(|found| found.robot != **name));
    if let Some(unknown) = unknown {
        let failure = Failure::usage(format_args!("no robot {unknown} has been at this broker"));
        return Err(failure.help("`spykee fleet list` shows which have"));
    }
    let (mut chosen, mut absent) = (Vec::new(), Vec::new());
    for found in fleet.found() {
        let wanted = names.contains(found.robot.as_str());
        match found.presence {
            Presence::Online if all || wanted => chosen.push(found.robot.clone()),
            // An agent that logged off is no failure where all are meant.
            Presence::Offline if !wanted => {}
            presence if all || wanted => absent.push((found.robot.clone(), presence)),
            _ => {}
        }
    }
    if chosen.is_empty() && absent.is_empty() {
        return Err(
            Failure::new(Exit::Unreachable, "no robot is online at this broker")
                .help("a run appears there if its config names the same broker"),
        );
    }
    Ok((chosen, absent))
}
