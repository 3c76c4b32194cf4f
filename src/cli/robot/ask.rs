//! `spykee robot info`, `battery` and `log`: print what the robot reports.

use std::time::Duration;

use serde_json::json;

use super::session::{with_exclusive_session, with_session};
use crate::cli::running::SharedTargetArgs;
use crate::cli::runs::describe;
use crate::cli::settings::CommandSettings;
use crate::cli::table::or_dash;
use crate::cli::{ConnectionArgs, Exit, Failure, print, print_json};
use crate::clock;
use crate::robot::{Battery, RobotInfo};
use crate::wire::{Command, latin1};

#[derive(Debug, Clone, clap::Args)]
pub(in crate::cli) struct ReportArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    target: SharedTargetArgs,
}

/// Print the robot's own log
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee robot log --robot 172.17.6.1 | tail\n\n\
                        The contents of the robot's log are not documented.")]
pub(in crate::cli) struct LogArgs {
    /// Print a JSON object
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    connection: ConnectionArgs,
}

pub(super) fn info(args: &ReportArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    if let Some(run) = args.target.find_run(settings)? {
        let status = run.status;
        let robot = status.robot.ok_or_else(never_connected)?;
        return show_info(args.json, &robot, None, status.docked, status.battery);
    }
    with_session(&args.target.connection, settings, async |session| {
        let accepted = &session.link.accepted;
        let robot = RobotInfo {
            uid: accepted.uid.clone(),
            name: accepted.name.clone(),
            firmware: accepted.firmware.clone(),
            address: session.link.peer.to_string(),
            simulated: session.simulated,
        };
        let battery = Some(Battery::reported(session.link.power));
        let third_name = Some(accepted.place.as_str());
        show_info(args.json, &robot, third_name, accepted.docked, battery)
    })
}

/// A run does not keep the third name.
fn show_info(
    as_json: bool,
    robot: &RobotInfo,
    third_name: Option<&str>,
    docked: bool,
    battery: Option<Battery>,
) -> Result<Exit, Failure> {
    if as_json {
        let percent = battery.and_then(|battery| battery.percent);
        let charging = battery.map(|battery| battery.charging);
        print_json(&json!({
            "uid": robot.uid, "name": robot.name, "third_name": third_name,
            "firmware": robot.firmware, "address": robot.address, "docked": docked,
            "battery": percent, "charging": charging, "simulated": robot.simulated,
        }))
    } else {
        let third = third_name.map_or_else(String::new, |name| {
            format!("third name  {name} (meaning unknown)\n")
        });
        print(&format!(
            "id          {}\nname        {}\n{third}firmware    {}\naddress     {}\n\
             battery     {}\non station  {}\n",
            robot.uid,
            robot.name,
            robot.firmware,
            robot.address,
            or_dash(battery.map(describe)),
            if docked { "yes" } else { "no" },
        ))
    }
}

pub(super) fn battery(args: &ReportArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    if let Some(run) = args.target.find_run(settings)? {
        let battery = run.status.battery.ok_or_else(never_connected)?;
        return show_battery(args.json, battery, run.status.battery_age.unwrap_or(0));
    }
    with_session(&args.target.connection, settings, async |session| {
        show_battery(args.json, Battery::reported(session.link.power), 0)
    })
}

/// A level that is older than this is printed with its age, seconds.
const OLD: u64 = 60;

/// `age`: the seconds since the robot told it.
fn show_battery(as_json: bool, battery: Battery, age: u64) -> Result<Exit, Failure> {
    if as_json {
        print_json(&json!({
            "percent": battery.percent, "charging": battery.charging,
            "minutes_left": battery.minutes_left, "age": age,
        }))
    } else {
        print(&format!("{}\n", aged(battery, age)))
    }
}

fn aged(battery: Battery, age: u64) -> String {
    let told = clock::hours(Duration::from_secs(age));
    match age {
        ..=OLD => describe(battery),
        _ => format!("{}, as the robot told {told} ago", describe(battery)),
    }
}

fn never_connected() -> Failure {
    let what = "the active run has not reached its robot yet";
    Failure::unreachable(what).help("`spykee status` shows its state")
}

pub(super) fn log(args: &LogArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    with_exclusive_session(&args.connection, settings, async |session| {
        let text = session.text(Command::LogQuery, "its log").await?;
        let text = latin1(&text);
        let text = text.trim_end_matches(['\0', '\r', '\n']);
        if args.json {
            let lines: Vec<&str> = text.lines().collect();
            return print_json(&json!({ "lines": lines }));
        }
        print(
            &text
                .lines()
                .map(|line| format!("{line}\n"))
                .collect::<String>(),
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;

    #[test]
    fn an_old_level_has_its_age() {
        let battery = Battery {
            percent: Percent::new(64),
            charging: false,
            minutes_left: None,
        };
        assert_eq!(aged(battery, 5), "64 %");
        let told = "64 %, as the robot told 2:03:00 ago";
        assert_eq!(aged(battery, 2 * 3600 + 180), told);
    }
}
