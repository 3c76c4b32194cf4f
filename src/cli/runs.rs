//! `spykee status`: which runs are on, and how things stand with them.

use std::time::Duration;

use serde_json::{Value, json};

use super::settings::SettingsArgs;
use super::table::{Side, aligned};
use super::{Exit, Failure, block_on, print};
use crate::control::{self, Overview};
use crate::robot::Battery;

const HEAD: [(&str, Side); 7] = [
    ("ROBOT", Side::Left),
    ("STATE", Side::Left),
    ("BATTERY", Side::Left),
    ("PLACE", Side::Left),
    ("RUNNING", Side::Right),
    ("PROCESS", Side::Right),
    ("BEHAVIOURS", Side::Left),
];

/// Tell which runs are on: robot, battery, place, behaviours
///
/// Asks every `spykee run` of this data folder, by its private socket there. `spykee robot battery`,
/// `info`, `snapshot`, `dock`, `undock`, `stop`, `led`, `play`, `volume` and `say` go through a run that
/// has the robot, too.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee status --json")]
pub(super) struct StatusArgs {
    /// Print a JSON list
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    pub(super) settings: SettingsArgs,
}

/// Lists them.
///
/// # Errors
/// A config that cannot be used.
pub(super) fn run(args: &StatusArgs) -> Result<Exit, Failure> {
    let data = args.settings.config()?.data_folder();
    let (runs, silent) = block_on(control::runs(data))?;
    if silent > 0 {
        tracing::warn!(
            "runs that do not answer: {silent}; are they stopped by Ctrl-Z, or of another version?"
        );
    }
    let runs: Vec<Overview> = runs.into_iter().map(|run| run.overview).collect();
    if args.json {
        let runs: Vec<Value> = runs.iter().map(object).collect();
        print(&format!("{}\n", Value::Array(runs)))?;
    } else if runs.is_empty() {
        print(&format!("no run is on in {}\n", data.display()))?;
    } else {
        let rows: Vec<Vec<String>> = runs.iter().map(row).collect();
        print(&aligned(&HEAD, &rows))?;
    }
    Ok(Exit::Done)
}

fn row(run: &Overview) -> Vec<String> {
    let simulated = if run.simulated { " (simulated)" } else { "" };
    let behaviours = run.behaviours.iter().map(|one| one.name.as_str());
    vec![
        format!("{}{simulated}", run.target),
        run.state.clone(),
        run.battery.map_or_else(|| "-".to_owned(), words),
        run.place.clone(),
        clock(run.running),
        run.pid.to_string(),
        behaviours.collect::<Vec<_>>().join(" "),
    ]
}

/// As people read it.
pub(super) fn words(battery: Battery) -> String {
    let charging = if battery.charging { ", charging" } else { "" };
    let left = battery.minutes_left.map_or_else(String::new, |minutes| {
        format!(", {minutes:.0} minutes left")
    });
    format!("{}{charging}{left}", battery.percent)
}

/// Hours, minutes and seconds.
pub(super) fn clock(time: Duration) -> String {
    let seconds = time.as_secs();
    let (hours, minutes) = (seconds / 3600, seconds / 60 % 60);
    format!("{hours}:{minutes:02}:{:02}", seconds % 60)
}

fn object(run: &Overview) -> Value {
    let robot = run.robot.as_ref();
    let behaviours = run.behaviours.iter();
    let behaviours: Vec<Value> = behaviours
        .map(|one| json!({ "name": one.name, "priority": one.priority.0 }))
        .collect();
    let battery = run.battery.map(|battery| {
        json!({
            "percent": battery.percent.get(), "charging": battery.charging,
            "minutes_left": battery.minutes_left,
        })
    });
    json!({
        "process": run.pid, "robot": run.target, "simulated": run.simulated,
        "seconds": run.running.as_secs(), "online": run.online,
        "uid": robot.map(|robot| &robot.uid), "name": robot.map(|robot| &robot.name),
        "address": robot.map(|robot| &robot.address), "state": run.state, "place": run.place,
        "docked": run.docked, "low": run.low, "battery": battery, "behaviours": behaviours,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;

    #[test]
    fn a_battery_in_words() {
        let battery = |charging, minutes_left| Battery {
            percent: Percent::saturating(42),
            charging,
            minutes_left,
        };
        assert_eq!(words(battery(false, None)), "42 %");
        assert_eq!(words(battery(true, None)), "42 %, charging");
        assert_eq!(words(battery(false, Some(17.6))), "42 %, 18 minutes left");
        assert_eq!(clock(Duration::from_secs(3725)), "1:02:05");
    }
}
