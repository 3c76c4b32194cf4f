//! `spykee status`: lists the active runs and their states.

use std::time::Duration;

use super::running::RemoteArgs;
use super::settings::CommandSettings;
use super::startup::warn_of_unpaid_stop;
use super::status::charge;
use super::table::{aligned, or_dash};
use super::{Exit, Failure, block_on, print, print_json};
use crate::clock::{self, Zone};
use crate::control::{self, RunStatus};
use crate::pilot::LinkState;
use crate::robot::Battery;

const HEAD: &str = "ROBOT|STATE|BATTERY|PLACE|>DELAY|>RUNNING|>PROCESS|NEXT START|BEHAVIOURS";

/// List the active runs: robot, battery, dock state, behaviours, the timetable's next start
///
/// Asks every `spykee run` and `spykee serve` of this data folder through its private socket, or
/// with --url a service on another computer. `spykee robot battery`, `info`, `snapshot`, `dock`,
/// `undock`, `stop`, `led`, `play`, `volume` and `say` also go through the run.
///
/// DELAY is the time until the robot has executed a command and answered: its program's own and the
/// network's, which --json tells apart. `-`: its program does not answer.
#[derive(Debug, Clone, clap::Args)]
#[command(after_help = "Example: spykee status --json")]
pub(super) struct StatusArgs {
    /// Print a JSON array
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    remote: RemoteArgs,
}

pub(super) fn run(args: &StatusArgs, settings: &CommandSettings) -> Result<Exit, Failure> {
    let config = settings.config()?;
    let data = config.data_folder();
    let (runs, silent) = match args.remote.client(settings)? {
        Some(service) => (vec![service], 0),
        None => block_on(control::runs(data))?,
    };
    if silent > 0 {
        tracing::warn!(
            "runs that do not answer: {silent}; are they suspended by Ctrl-Z, or of another version?"
        );
    }
    warn_of_unpaid_stop(config);
    let runs: Vec<RunStatus> = runs.into_iter().map(|run| run.status).collect();
    if args.json {
        print_json(&runs)
    } else if runs.is_empty() {
        print(&format!("no run is active in {}\n", data.display()))
    } else {
        let zone = config.zone();
        print(&aligned(HEAD, runs.iter().map(|run| row(run, &zone))))
    }
}

fn row(run: &RunStatus, zone: &Zone) -> Vec<String> {
    let simulated = if run.simulated { " (simulated)" } else { "" };
    let behaviours = run.behaviours.iter().map(|one| one.name.as_str());
    // Out of reach, all that is known of the robot is as old as its level.
    let age = match run.battery_age {
        Some(age) if run.link != LinkState::Up => {
            format!(", {} ago", clock::hours(Duration::from_secs(age)))
        }
        _ => String::new(),
    };
    let battery = or_dash(run.battery.map(describe));
    let delay = run.delays.map(|delays| delays.robot + delays.network);
    vec![
        format!("{}{simulated}", run.target),
        run.state.clone(),
        format!("{battery}{age}"),
        format!("{}{age}", run.place),
        or_dash(delay.map(|seconds| format!("{seconds:.2} s"))),
        clock::hours(Duration::from_secs(run.running)),
        run.process.to_string(),
        next_start(run, zone),
        behaviours.collect::<Vec<_>>().join(" "),
    ]
}

/// The timetable's next start, and until when it is paused.
pub(super) fn next_start(run: &RunStatus, zone: &Zone) -> String {
    let next = or_dash(run.next.as_ref().map(|next| next.describe(zone)));
    let Some(until) = run.paused else { return next };
    let until = clock::describe(&zone.time(until));
    format!("{next} (paused until {until})")
}

pub(super) fn describe(battery: Battery) -> String {
    let left = battery.minutes_left.map_or_else(String::new, |minutes| {
        let plural = if minutes.round() == 1.0 { "" } else { "s" };
        format!(", {minutes:.0} minute{plural} left")
    });
    format!("{}{left}", charge(battery))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::robot::Percent;

    #[test]
    fn a_battery_in_words() {
        let battery = |charging, minutes_left| Battery {
            percent: Percent::new(42),
            charging,
            minutes_left,
        };
        assert_eq!(describe(battery(false, None)), "42 %");
        assert_eq!(describe(battery(true, None)), "42 %, charging");
        assert_eq!(
            describe(battery(false, Some(17.6))),
            "42 %, 18 minutes left"
        );
        assert_eq!(describe(battery(false, Some(1.2))), "42 %, 1 minute left");
        let unknown = Battery {
            percent: None,
            ..battery(true, None)
        };
        assert_eq!(describe(unknown), "unknown level, charging");
    }
}
