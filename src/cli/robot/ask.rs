//! `spykee robot info`, `battery` and `log`: print what the robot reports.

use serde_json::json;

use super::session::{with_exclusive_session, with_session};
use super::{SharedTargetArgs, TargetArgs};
use crate::cli::runs::describe;
use crate::cli::{Exit, Failure, print};
use crate::control::RunStatus;
use crate::robot::Battery;
use crate::sanitize;
use crate::wire::{Command, Report, latin1};

/// Print the robot's id, names, firmware, battery and station
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot info --robot 172.17.6.1 --json")]
pub(super) struct InfoArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

/// Print the battery level and whether it charges
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot battery --robot 172.17.6.1")]
pub(super) struct BatteryArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) target: SharedTargetArgs,
}

/// Print the robot's own log
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot log --robot 172.17.6.1 | tail\n\n\
                        The contents of the robot's log are not documented.")]
pub(super) struct LogArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) target: TargetArgs,
}

/// The facts about a robot, from a run or from the robot itself.
struct Facts {
    uid: String,
    name: String,
    /// `None` if the facts come from a run, which does not store it.
    third_name: Option<String>,
    firmware: String,
    address: String,
    docked: bool,
    battery: Option<Battery>,
    simulated: bool,
}

pub(super) fn info(args: &InfoArgs) -> Result<Exit, Failure> {
    if let Some(run) = args.target.find_run()? {
        let RunStatus {
            robot,
            docked,
            battery,
            ..
        } = run.status;
        let Some(robot) = robot else {
            return Err(never_connected());
        };
        return show_info(
            args.json,
            &Facts {
                uid: robot.uid,
                name: robot.name,
                third_name: None,
                firmware: robot.firmware,
                address: robot.address,
                docked,
                battery,
                simulated: robot.simulated,
            },
        );
    }
    with_session(&args.target, async |session| {
        let robot = &session.link.accepted;
        let facts = Facts {
            uid: robot.uid.clone(),
            name: robot.name.clone(),
            third_name: Some(robot.place.clone()),
            firmware: robot.firmware.clone(),
            address: session.link.peer.to_string(),
            docked: robot.docked,
            battery: Some(Battery::reported(session.link.power)),
            simulated: session.simulated,
        };
        show_info(args.json, &facts)
    })
}

fn show_info(as_json: bool, facts: &Facts) -> Result<Exit, Failure> {
    let text = if as_json {
        let battery = facts.battery.and_then(|battery| battery.percent);
        let charging = facts.battery.map(|battery| battery.charging);
        let object = json!({
            "uid": facts.uid, "name": facts.name, "third_name": facts.third_name,
            "firmware": facts.firmware, "address": facts.address, "docked": facts.docked,
            "battery": battery, "charging": charging, "simulated": facts.simulated,
        });
        format!("{object}\n")
    } else {
        let third = facts.third_name.as_ref().map_or_else(String::new, |name| {
            format!("third name  {name} (meaning unknown)\n")
        });
        let lines = format!(
            "id          {}\nname        {}\n{third}firmware    {}\naddress     {}\n\
             battery     {}\non station  {}\n",
            facts.uid,
            facts.name,
            facts.firmware,
            facts.address,
            facts.battery.map_or_else(|| "-".to_owned(), describe),
            if facts.docked { "yes" } else { "no" },
        );
        sanitize::text(&lines, false)
    };
    print(&text)?;
    Ok(Exit::Done)
}

pub(super) fn battery(args: &BatteryArgs) -> Result<Exit, Failure> {
    if let Some(run) = args.target.find_run()? {
        let battery = run.status.battery.ok_or_else(never_connected)?;
        return show_battery(args.json, battery);
    }
    with_session(&args.target, async |session| {
        show_battery(args.json, Battery::reported(session.link.power))
    })
}

fn show_battery(as_json: bool, battery: Battery) -> Result<Exit, Failure> {
    if as_json {
        let object = json!({
            "percent": battery.percent, "charging": battery.charging,
            "minutes_left": battery.minutes_left,
        });
        print(&format!("{object}\n"))?;
    } else {
        print(&format!("{}\n", describe(battery)))?;
    }
    Ok(Exit::Done)
}

fn never_connected() -> Failure {
    let what = "the active run has not reached its robot yet";
    Failure::new(Exit::Unreachable, what).help("`spykee status` shows its state")
}

pub(super) fn log(args: &LogArgs) -> Result<Exit, Failure> {
    with_exclusive_session(&args.target, async |session| {
        let pick = |report| match report {
            Report::Log(text) => Some(text),
            _ => None,
        };
        let text = session.text(Command::LogQuery, "its log", pick).await?;
        let text = latin1(&text);
        let text = text.trim_end_matches(['\0', '\r', '\n']);
        if args.json {
            let lines: Vec<&str> = text.lines().collect();
            print(&format!("{}\n", json!({ "lines": lines })))?;
        } else if !text.is_empty() {
            print(&format!("{}\n", sanitize::text(text, false)))?;
        }
        Ok(Exit::Done)
    })
}
