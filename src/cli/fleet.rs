//! The MQTT broker that the config names: its secrets and certificates, and `spykee fleet`, with
//! commands for all agents on it.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Duration;

use clap::Subcommand;
use serde_json::Value;

use super::settings::CommandSettings;
use super::table::{aligned, or_dash};
use super::token::address_for_others;
use super::{Exit, Failure, block_on, print, print_json, secret};
use crate::config::Effective;
use crate::files;
use crate::mqtt::{Account, Fleet, Found, Presence};

/// Timeout for an agent's reply, which includes loading or ending behaviours.
const REPLY_TIMEOUT: Duration = Duration::from_secs(15);
/// Maximum size of a certificate file, bytes.
const LONGEST_CERTIFICATES: u64 = 1 << 20;
/// Time limit for sending the last words to the broker.
pub(super) const BROKER_END: Duration = Duration::from_secs(2);
const ALL: &str = "all";

const HEAD: &str = "ROBOT|CONNECTION|STATE|>BATTERY|RUNNING|PROBLEM";

#[derive(Debug, Clone, Subcommand)]
pub(super) enum Action {
    /// List the robots with their connections (ONLINE, OFFLINE if logged off, CONNECTIONBROKEN if
    /// lost) and states
    List {
        /// Print a JSON array
        #[arg(long)]
        json: bool,
    },
    /// Start a behaviour
    Run {
        /// Name of the behaviour in the robots' configs
        #[arg(value_name = "NAME")]
        behaviour: String,
        /// Uids of the robots, or `all` for every robot that is online
        #[arg(long, value_name = "UID", required = true, num_args = 1..)]
        on: Vec<String>,
    },
    /// Press STOP at robots: they stand until they are released; also ends their behaviours
    Stop {
        /// Uids of the robots, or `all` for every robot that is online
        #[arg(value_name = "UID", required = true)]
        robots: Vec<String>,
    },
    /// Release STOP at robots, so that they may move again
    ResetStop {
        /// Uids of the robots, or `all` for every robot that is online
        #[arg(value_name = "UID", required = true)]
        robots: Vec<String>,
    },
}

/// Connects to the broker and carries out the command.
pub(super) fn run(action: &Action, settings: &CommandSettings) -> Result<Exit, Failure> {
    let account = account(settings.load()?)?.ok_or_else(|| {
        Failure::usage("the config names no broker").help(
            "add mqtt: { host: broker.local }; see the book's chapter MQTT and Home Assistant",
        )
    })?;
    let visit = async {
        let mut fleet = Fleet::connect(account).await.map_err(unreachable)?;
        let exit = act(&mut fleet, action).await;
        fleet.disconnect().await;
        exit
    };
    block_on(visit)?
}

async fn act(fleet: &mut Fleet, action: &Action) -> Result<Exit, Failure> {
    match action {
        Action::List { json } => list(fleet, *json),
        Action::Run { behaviour, on } => send_command(fleet, &format!("run {behaviour}"), on).await,
        Action::Stop { robots } => send_command(fleet, "stop", robots).await,
        Action::ResetStop { robots } => send_command(fleet, "reset_stop", robots).await,
    }
}

fn unreachable(error: String) -> Failure {
    Failure::unreachable(error)
        .help("is `mqtt` in `spykee config show --origin` right, and is the broker running?")
}

fn list(fleet: &Fleet, as_json: bool) -> Result<Exit, Failure> {
    let found: Vec<&Found> = fleet.found().collect();
    if as_json {
        print_json(&found)
    } else if found.is_empty() {
        print("no robot has ever connected to this broker\n")
    } else {
        print(&aligned(HEAD, found.into_iter().map(row)))
    }
}

/// A table row. Shows the state only of online robots: the last state of others may be out of date.
fn row(found: &Found) -> Vec<String> {
    let mut row = vec![found.robot.clone(), found.presence.name().to_owned()];
    if found.presence == Presence::Online {
        let text = |key: &str| found.state[key].as_str().unwrap_or("-").to_owned();
        let battery = found.state["battery"].as_u64();
        let running = found.state["running"].as_array();
        let names = running.into_iter().flatten().filter_map(Value::as_str);
        row.push(text("state"));
        row.push(or_dash(battery.map(|percent| format!("{percent} %"))));
        row.push(names.collect::<Vec<_>>().join(" "));
        row.push(found.state["reason"].as_str().unwrap_or("").to_owned());
    }
    row
}

/// Sends the command to all chosen robots at once and prints the outcome of each.
async fn send_command(fleet: &mut Fleet, command: &str, named: &[String]) -> Result<Exit, Failure> {
    let chosen = choose(fleet, named)?;
    let online = chosen
        .iter()
        .filter(|(_, presence)| *presence == Presence::Online);
    let online: Vec<String> = online.map(|(robot, _)| robot.clone()).collect();
    let answers = fleet.ask(&online, command, REPLY_TIMEOUT).await;
    let answers = answers.map_err(unreachable)?;
    let mut exit = Exit::Done;
    let mut text = String::new();
    for (robot, presence) in chosen {
        let problem = match answers.get(&robot) {
            Some(answer) if answer.done => None,
            Some(answer) => {
                let why = answer.text.as_deref().unwrap_or("no reason");
                Some(format!("not done: {why}"))
            }
            None if presence == Presence::Online => {
                Some(format!("no answer within {} s", REPLY_TIMEOUT.as_secs()))
            }
            None => Some(format!("not asked, it is {}", presence.name())),
        };
        if problem.is_some() {
            exit = Exit::Check;
        }
        text += &format!("{robot}: {}\n", problem.as_deref().unwrap_or("done"));
    }
    print(&text)?;
    Ok(exit)
}

/// The robots that are meant, with their presence. An agent that lost its connection may still be driving
/// without the broker, so `all` means it too; one that logged off is not meant.
fn choose(fleet: &Fleet, named: &[String]) -> Result<Vec<(String, Presence)>, Failure> {
    let all = named.iter().any(|name| name == ALL);
    let names: BTreeSet<&str> = named.iter().map(String::as_str).collect();
    let is_known = |name: &str| name == ALL || fleet.found().any(|found| found.robot == name);
    if let Some(unknown) = names.iter().find(|name| !is_known(name)) {
        let failure = Failure::usage(format_args!("no robot {unknown} at this broker"));
        return Err(failure.help("`spykee fleet list` lists the robots"));
    }
    let is_meant = |found: &&Found| {
        let is_here = all && found.presence != Presence::Offline;
        is_here || names.contains(found.robot.as_str())
    };
    let meant = fleet.found().filter(is_meant);
    let chosen: Vec<_> = meant
        .map(|found| (found.robot.clone(), found.presence))
        .collect();
    if chosen.is_empty() {
        return Err(Failure::unreachable("no robot is online at this broker")
            .help("a run appears there if its config names the same broker"));
    }
    Ok(chosen)
}

/// The broker's account, if the config names a broker.
pub(super) fn account(settings: &Effective) -> Result<Option<Account>, Failure> {
    let options = settings.config.mqtt.clone();
    if options.host.is_none() {
        return Ok(None);
    }
    let file = options.password_file.as_deref();
    let password = secret::from_optional_file(file, settings.found_file())?;
    let certificates = |path: &PathBuf| {
        files::read(path, LONGEST_CERTIFICATES).map_err(|error| {
            Failure::unreadable_file("the certificates (mqtt.ca_file)", path, error)
        })
    };
    let ca = options.ca_file.as_ref().map(certificates).transpose()?;
    let listen = settings.config.live.listen.map(address_for_others);
    let listen = listen.filter(|address| !address.ip().is_loopback());
    Ok(Some(Account {
        options,
        password,
        ca,
        page: listen.map(|address| format!("http://{address}/")),
    }))
}

/// The account of the broker that serves requests to a run, if the config names a broker. A config
/// that was found in the current folder may have come from anywhere: it must not hand the robot and
/// its camera to a stranger's broker, nor to whoever has a token that came with it.
pub(super) fn account_of_run(settings: &Effective) -> Result<Option<Account>, Failure> {
    let account = account(settings)?;
    let Some(config) = settings.found_file() else {
        return Ok(account);
    };
    let listen = settings.config.live.listen;
    let would = if account.is_some() {
        "connect the robot to a broker"
    } else if listen.is_some_and(|address| !address.ip().is_loopback()) {
        "open the page to other computers"
    } else {
        return Ok(account);
    };
    let what = format_args!(
        "the config {} would {would}, but was found in the current folder, not named",
        config.display()
    );
    Err(secret::refuse_found(config, what))
}
