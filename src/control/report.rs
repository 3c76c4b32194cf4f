//! The state of a run as JSON: the output of `spykee status --json` and the answer of `/api/run`.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::request::{Next, Overview};
use crate::robot::channel::RunningBehaviour;
use crate::robot::{
    Battery, Percent, Priority, RobotInfo, StopConfirmation, StopKept, StopOutcome,
};

/// The state of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Report {
    /// The process ID of the run.
    pub process: u32,
    /// The robot's address as given to the run.
    pub robot: String,
    /// Whether the robot is simulated in the run's own program.
    pub simulated: bool,
    /// How long the run has been active, in whole seconds.
    pub seconds: u64,
    /// Whether the link is up.
    pub online: bool,
    /// The robot's own ID, such as `SPYKEE0001`, if it was ever connected.
    pub uid: Option<String>,
    /// The robot's name.
    pub name: Option<String>,
    /// The robot's firmware version, such as `1.0.22`.
    pub firmware: Option<String>,
    /// `host:port` of the connection.
    pub address: Option<String>,
    /// The state of the watchdog, in words.
    pub state: String,
    /// The robot's dock state, in words.
    pub dock_state: String,
    /// Whether the robot is on its station, as far as is known.
    pub docked: bool,
    /// Whether the battery is low and the watchdog therefore controls the robot.
    pub low: bool,
    /// Whether a person's STOP holds.
    pub emergency_stop: bool,
    /// What is known of that STOP at the robot.
    pub stop_confirmation: StopConfirmation,
    /// The battery level, if a plausible one is known.
    pub battery: Option<Level>,
    /// The running behaviours.
    pub behaviours: Vec<RunningBehaviourReport>,
    /// The next start of the timetable, if there is one.
    pub next: Option<Start>,
    /// Whether it is a quiet hour.
    pub quiet: bool,
}

/// The answer to a STOP.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct StopReport {
    /// Always true: STOP holds.
    pub ok: bool,
    /// What is known of it, for people.
    pub text: String,
    /// What is known of it at the robot.
    pub stop_confirmation: StopConfirmation,
    /// Whether the next program of the data folder would hold it, too.
    pub kept: bool,
    /// Why not; null for a robot that is simulated in the run's own program.
    pub why_not_kept: Option<String>,
}

impl From<StopOutcome> for StopReport {
    fn from(outcome: StopOutcome) -> StopReport {
        StopReport {
            ok: true,
            text: outcome.to_string(),
            stop_confirmation: outcome.confirmation,
            kept: outcome.kept == StopKept::Yes,
            why_not_kept: match outcome.kept {
                StopKept::Yes | StopKept::WithProgram => None,
                StopKept::NotYet => Some("the disk does not answer".to_owned()),
                StopKept::No(why) => Some(why),
            },
        }
    }
}

impl From<StopReport> for StopOutcome {
    fn from(report: StopReport) -> StopOutcome {
        let kept = match (report.kept, report.why_not_kept) {
            (true, _) => StopKept::Yes,
            (false, None) => StopKept::WithProgram,
            (false, Some(why)) => StopKept::No(why),
        };
        StopOutcome {
            confirmation: report.stop_confirmation,
            kept,
        }
    }
}

/// The battery's level.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Level {
    /// 0..=100.
    pub percent: u8,
    /// Whether the battery is being charged.
    pub charging: bool,
    /// Estimated time until it is empty, at the recent consumption.
    pub minutes_left: Option<f32>,
}

/// A running behaviour.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct RunningBehaviourReport {
    /// The behaviour's name.
    pub name: String,
    /// Its priority when several behaviours want to drive.
    pub priority: i16,
}

/// A start of the timetable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Start {
    /// The time in UTC, in RFC 3339 format: `2026-05-04T07:00:00Z`.
    #[schemars(extend("format" = "date-time"))]
    pub at: String,
    /// The behaviour.
    pub behaviour: String,
}

impl From<&Next> for Start {
    fn from(next: &Next) -> Start {
        Start {
            at: next.time().to_string(),
            behaviour: next.behaviour.clone(),
        }
    }
}

impl From<Battery> for Level {
    fn from(battery: Battery) -> Level {
        Level {
            percent: battery.percent.get(),
            charging: battery.charging,
            minutes_left: battery.minutes_left,
        }
    }
}

impl From<&Overview> for Report {
    fn from(run: &Overview) -> Report {
        let robot = run.robot.as_ref();
        let of = |text: fn(&RobotInfo) -> &String| robot.map(|robot| text(robot).clone());
        let behaviours = run.behaviours.iter().map(|one| RunningBehaviourReport {
            name: one.name.clone(),
            priority: one.priority.0,
        });
        Report {
            process: run.pid,
            robot: run.target.clone(),
            simulated: run.simulated,
            seconds: run.running.as_secs(),
            online: run.online,
            uid: of(|robot| &robot.uid),
            name: of(|robot| &robot.name),
            firmware: of(|robot| &robot.firmware),
            address: of(|robot| &robot.address),
            state: run.state.clone(),
            dock_state: run.dock_state.clone(),
            docked: run.docked,
            low: run.low,
            emergency_stop: run.emergency_stop,
            stop_confirmation: run.stop_confirmation,
            battery: run.battery.map(Level::from),
            behaviours: behaviours.collect(),
            next: run.next.as_ref().map(Start::from),
            quiet: run.quiet,
        }
    }
}

/// Converts the report of a run that was reached through its API.
impl From<Report> for Overview {
    fn from(report: Report) -> Overview {
        let simulated = report.simulated;
        let robot = report.uid.map(|uid| RobotInfo {
            uid,
            name: report.name.unwrap_or_default(),
            firmware: report.firmware.unwrap_or_default(),
            address: report.address.unwrap_or_default(),
            simulated,
        });
        let next = report.next.and_then(|next| {
            let at: jiff::Timestamp = next.at.parse().ok()?;
            Some(Next {
                at: at.as_second(),
                behaviour: next.behaviour,
            })
        });
        let battery = report.battery.map(|level| Battery {
            percent: Percent::saturating(level.percent),
            charging: level.charging,
            minutes_left: level.minutes_left,
        });
        let behaviours = report.behaviours.into_iter().map(|one| RunningBehaviour {
            name: one.name,
            priority: Priority(one.priority),
        });
        Overview {
            pid: report.process,
            target: report.robot,
            simulated,
            running: Duration::from_secs(report.seconds),
            online: report.online,
            robot,
            state: report.state,
            dock_state: report.dock_state,
            docked: report.docked,
            low: report.low,
            emergency_stop: report.emergency_stop,
            stop_confirmation: report.stop_confirmation,
            battery,
            behaviours: behaviours.collect(),
            next,
            quiet: report.quiet,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_survives_json_unchanged() {
        let overview = Overview {
            pid: 7,
            target: "10.0.0.2".to_owned(),
            simulated: true,
            running: Duration::from_secs(61),
            online: true,
            robot: Some(RobotInfo {
                uid: "SPYKEE7".to_owned(),
                name: "Rover".to_owned(),
                firmware: "1.0.22".to_owned(),
                address: "10.0.0.2:9000".to_owned(),
                simulated: true,
            }),
            state: "docked".to_owned(),
            dock_state: "on its station".to_owned(),
            docked: true,
            low: false,
            emergency_stop: true,
            stop_confirmation: StopConfirmation::NotConfirmed,
            battery: Some(Battery {
                percent: Percent::saturating(71),
                charging: true,
                minutes_left: None,
            }),
            behaviours: vec![RunningBehaviour {
                name: "patrol".to_owned(),
                priority: Priority(-3),
            }],
            next: Some(Next {
                at: 1_790_000_000,
                behaviour: "patrol".to_owned(),
            }),
            quiet: true,
        };
        let report = Report::from(&overview);
        assert_eq!(report.next.as_ref().unwrap().at, "2026-09-21T14:13:20Z");
        let json = serde_json::to_string(&report).unwrap();
        let back: Report = serde_json::from_str(&json).unwrap();
        assert_eq!(Overview::from(back), overview);
    }
}
