//! The state of a run: the output of `spykee status --json`, the answer of `/api/status`, and what
//! the page shows.

use jiff::Timestamp;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::agent::{BehaviourState, BehaviourStatus};
use crate::link::Delays;
use crate::pilot::{LinkState, Status};
use crate::robot::channel::RunningBehaviour;
use crate::robot::{Battery, EndReason, Priority, RobotInfo, StopConfirmation, WatchdogState};
use crate::safety::DockState;
use crate::timetable::NextStart;

/// The state of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RunStatus {
    /// The process ID of the run.
    pub process: u32,
    /// The robot's address as given to the run.
    pub target: String,
    /// Whether the robot is simulated in the run's own program.
    pub simulated: bool,
    /// Whole seconds since the start of the run.
    pub running: u64,
    /// The state of link and watchdog, in words.
    pub state: String,
    /// Where the robot is, in words.
    pub place: String,
    pub link: LinkState,
    /// The watchdog's state.
    pub safety: WatchdogState,
    pub dock_state: DockState,
    /// Whether the robot is on its station, as far as is known.
    pub docked: bool,
    /// Whether the battery is low and the watchdog therefore controls the robot.
    pub low: bool,
    /// Whether a person's STOP holds.
    pub emergency_stop: bool,
    /// What is known of that STOP at the robot; `sending` also until the disk has kept it.
    pub stop_confirmation: StopConfirmation,
    /// The battery, if a plausible level is known.
    pub battery: Option<Battery>,
    /// Whole seconds since the robot told that level.
    pub battery_age: Option<u64>,
    /// How late the robot executes what it is sent, if its program answers.
    pub delays: Option<DelayReport>,
    /// The power of the left and the right track, percent.
    pub tracks: [i8; 2],
    /// The headlight, the left and the right light; null: unknown.
    pub lights: [Option<bool>; 3],
    /// The last sound that the robot was told to play.
    pub sound: Option<String>,
    /// The number of sounds so far.
    pub sounds: u32,
    /// The robot's identity, if it was ever connected.
    pub robot: Option<RobotInfo>,
    /// The running behaviours.
    pub behaviours: Vec<RunningBehaviour>,
    /// The next start of the timetable, if there is one.
    pub next: Option<NextStart>,
    /// Until when the timetable starts nothing, if a person has paused it: UTC, in RFC 3339 format.
    #[schemars(with = "Option<String>", extend("format" = "date-time"))]
    pub paused: Option<Timestamp>,
    /// Whether it is a quiet hour.
    pub quiet: bool,
}

/// How late the robot executes what it is sent.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DelayReport {
    /// Seconds that a message waits in the robot until it is executed.
    pub robot: f64,
    /// Seconds through the network, there and back.
    pub network: f64,
}

impl From<Delays> for DelayReport {
    fn from(delays: Delays) -> DelayReport {
        let rounded = |seconds: f64| (seconds * 100.0).round() / 100.0;
        DelayReport {
            robot: rounded(delays.robot.as_secs_f64()),
            network: rounded(delays.network.as_secs_f64()),
        }
    }
}

/// A behaviour of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BehaviourListing {
    /// The behaviour's name.
    pub name: String,
    /// Its priority when several behaviours want to drive.
    pub priority: Priority,
    /// `idle`, `loading`, `running` or `ending`.
    pub state: String,
    /// Whole seconds since it started.
    pub running: Option<u64>,
    /// How it last ended in this run.
    pub exit: Option<Exit>,
}

/// How a behaviour ended.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Exit {
    /// `done`, `error`, `cancelled`, and so on.
    pub reason: EndReason,
    /// The same in words; for an error, with file and line.
    pub text: String,
    /// The line of the error in the behaviour's own file, if known.
    pub line: Option<u64>,
}

impl BehaviourListing {
    pub fn new(behaviour_status: &BehaviourStatus, now: tokio::time::Instant) -> BehaviourListing {
        let running = match behaviour_status.state {
            BehaviourState::Running { since, .. } => {
                Some(now.saturating_duration_since(since).as_secs())
            }
            _ => None,
        };
        let exit = behaviour_status.exit.as_ref().map(|exit| Exit {
            reason: exit.reason,
            text: exit.text().to_owned(),
            line: None,
        });
        BehaviourListing {
            name: behaviour_status.name.clone(),
            priority: behaviour_status.priority,
            state: behaviour_status.state.name().to_owned(),
            running,
            exit,
        }
    }
}

/// The state of link and watchdog, for people.
pub fn describe(status: &Status) -> String {
    let stopped = match (status.emergency_stop, status.stop) {
        (false, _) => None,
        (true, StopConfirmation::NotConfirmed) => Some("stopped by a person, NOT CONFIRMED"),
        (true, _) => Some("stopped by a person"),
    };
    match (stopped, status.link.absence()) {
        (Some(stopped), Some(words)) => format!("{stopped}; {words}"),
        (Some(words), None) | (None, Some(words)) => words.to_owned(),
        (None, None) => status.safety.to_string(),
    }
}
