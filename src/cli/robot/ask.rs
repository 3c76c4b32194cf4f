//! `spykee robot info`, `battery`, `log`: what the robot tells and nothing else.

use serde_json::json;

use super::AimArgs;
use super::talk::talk;
use crate::clean;
use crate::cli::{Exit, Failure, print};
use crate::robot::Battery;
use crate::wire::{Command, Report, latin1};

/// Tell who the robot is: id, names, firmware, battery, station
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot info --robot 172.17.6.1 --json")]
pub(super) struct InfoArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) aim: AimArgs,
}

/// Tell the battery's level, and whether it charges
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot battery --robot 172.17.6.1")]
pub(super) struct BatteryArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) aim: AimArgs,
}

/// Print the robot's own log
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot log --robot 172.17.6.1 | tail\n\n\
                        What the robot writes into its log is not documented.")]
pub(super) struct LogArgs {
    /// Print a JSON object with the lines
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) aim: AimArgs,
}

pub(super) fn info(args: &InfoArgs) -> Result<Exit, Failure> {
    talk(&args.aim, async |talk| {
        let robot = &talk.session.accepted;
        let battery = Battery::reported(talk.session.power);
        let address = talk.session.peer.to_string();
        let text = if args.json {
            let object = json!({
                "uid": robot.uid, "name": robot.name, "third_name": robot.place,
                "firmware": robot.firmware, "address": address, "docked": robot.docked,
                "battery": battery.percent.get(), "charging": battery.charging,
                "simulated": talk.simulated,
            });
            format!("{object}\n")
        } else {
            let docked = if robot.docked { "yes" } else { "no" };
            let lines = format!(
                "id          {}\nname        {}\nthird name  {} (its meaning is not known)\n\
                 firmware    {}\naddress     {address}\nbattery     {}\non station  {docked}\n",
                robot.uid,
                robot.name,
                robot.place,
                robot.firmware,
                words(battery),
            );
            clean::text(&lines, false)
        };
        print(&text)?;
        Ok(Exit::Done)
    })
}

pub(super) fn battery(args: &BatteryArgs) -> Result<Exit, Failure> {
    talk(&args.aim, async |talk| {
        let battery = Battery::reported(talk.session.power);
        if args.json {
            let object = json!({ "percent": battery.percent.get(), "charging": battery.charging });
            print(&format!("{object}\n"))?;
        } else {
            print(&format!("{}\n", words(battery)))?;
        }
        Ok(Exit::Done)
    })
}

pub(super) fn log(args: &LogArgs) -> Result<Exit, Failure> {
    talk(&args.aim, async |talk| {
        let pick = |report| match report {
            Report::Log(text) => Some(text),
            _ => None,
        };
        let text = talk.text(Command::LogQuery, "its log", pick).await?;
        let text = latin1(&text);
        let text = text.trim_end_matches(['\0', '\r', '\n']);
        if args.json {
            let lines: Vec<&str> = text.lines().collect();
            print(&format!("{}\n", json!({ "lines": lines })))?;
        } else if !text.is_empty() {
            print(&format!("{}\n", clean::text(text, false)))?;
        }
        Ok(Exit::Done)
    })
}

/// As people read it.
pub(super) fn words(battery: Battery) -> String {
    let charging = if battery.charging { ", charging" } else { "" };
    format!("{}{charging}", battery.percent)
}
