//! The requests that a run accepts, and its answers.

use std::time::Duration;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::agent::{BehaviourState, BehaviourStatus};
use crate::robot::channel::RunningBehaviour;
use crate::robot::{
    Battery, DockEnd, DockPlan, EndReason, Percent, Priority, RobotInfo, StopConfirmation,
    StopOutcome,
};
use crate::timetable::View;
use crate::wire::{Led, Sound};

/// Maximum length of speech in one request, in bytes: half a minute of s16, mono, 16 kHz.
pub const MAX_SPEECH: usize = 30 * 32_000;

/// One request of a person to a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum RunRequest {
    /// The state of the run.
    Overview,
    /// Drive to the station.
    Dock(DockPlan),
    /// Leave the station, and wait at most this long for the robot's confirmation.
    Undock(Duration),
    /// STOP: the robot stands until a person releases it. A run ends then, a service goes on.
    Stop,
    /// Switch a light.
    Led {
        /// Which light.
        led: Led,
        /// On or off.
        on: bool,
    },
    /// Play a sound.
    Play(Sound),
    /// Stop the music.
    StopSound,
    /// Set the volume.
    Volume(Percent),
    /// Speak: s16 little-endian, mono, 16 kHz; at most [`MAX_SPEECH`] bytes.
    Say(Vec<u8>),
    /// A picture taken by the camera after the request, with this timeout.
    Picture(Duration),
    /// List the behaviours and their states.
    Behaviours,
    /// Start or end a behaviour.
    Behaviour {
        /// The behaviour's name.
        name: String,
        /// The change.
        change: Change,
    },
    /// Release a person's STOP.
    ResetStop,
}

impl RunRequest {
    pub(super) fn describe(&self) -> String {
        match self {
            RunRequest::Overview => "the state of the run".to_owned(),
            RunRequest::Dock(_) => "dock".to_owned(),
            RunRequest::Undock(_) => "undock".to_owned(),
            RunRequest::Stop => "STOP".to_owned(),
            RunRequest::Led { led, on: true } => format!("light {} on", led.name()),
            RunRequest::Led { led, on: false } => format!("light {} off", led.name()),
            RunRequest::Play(sound) => format!("play {}", sound.name()),
            RunRequest::StopSound => "stop the music".to_owned(),
            RunRequest::Volume(percent) => format!("volume {percent}"),
            RunRequest::Say(_) => "talk".to_owned(),
            RunRequest::Picture(_) => "a picture".to_owned(),
            RunRequest::Behaviours => "the list of behaviours".to_owned(),
            RunRequest::Behaviour { name, change } => {
                format!("{} behaviour {name:?}", change.verb())
            }
            RunRequest::ResetStop => "release STOP".to_owned(),
        }
    }
}

/// A change of a behaviour's state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Change {
    /// Start it.
    Start,
    /// Start it, and end it after this time.
    StartFor(Duration),
    /// Stop it.
    Stop,
    /// Stop it if it runs, and start it again from its file.
    Restart,
}

impl Change {
    fn verb(self) -> &'static str {
        match self {
            Change::Start | Change::StartFor(_) => "start",
            Change::Stop => "stop",
            Change::Restart => "restart",
        }
    }
}

/// The result of a [`RunRequest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum RunResponse {
    /// The state of the run.
    Overview(Box<Overview>),
    /// How a docking ended.
    Docked {
        /// The outcome.
        end: DockEnd,
        /// Attempts made.
        attempts: u32,
        /// Time taken.
        took: Duration,
    },
    /// How an undocking ended.
    Undocked(DockEnd),
    /// STOP holds.
    Stopped {
        /// What is known of it.
        outcome: StopOutcome,
        /// Whether the run ends now; a service goes on.
        ends: bool,
    },
    /// The request was passed to the pilot.
    Done,
    /// A JPEG.
    Picture(Vec<u8>),
    /// No picture arrived in time.
    NoPicture,
    /// All behaviours that are known or running.
    Behaviours(Vec<BehaviourListing>),
    /// The robot is not connected; the run is reconnecting.
    Offline,
    /// The request was refused, for this reason.
    Refused(String),
}

/// The state of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Overview {
    /// The process ID of the run.
    pub pid: u32,
    /// The robot's address as given to the run.
    pub target: String,
    /// Whether the robot is simulated in the run's own program.
    pub simulated: bool,
    /// How long the run has been active.
    pub running: Duration,
    /// Whether the link is up.
    pub online: bool,
    /// The robot's own information, if it was ever connected.
    pub robot: Option<RobotInfo>,
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
    pub battery: Option<Battery>,
    /// The running behaviours.
    pub behaviours: Vec<RunningBehaviour>,
    /// The next start of the timetable, if there is one.
    pub next: Option<Next>,
    /// Whether it is a quiet hour.
    pub quiet: bool,
}

/// A start of the timetable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Next {
    /// The time, in seconds since 1970.
    pub at: i64,
    /// The behaviour.
    pub behaviour: String,
}

impl Next {
    /// The next start in this view, if there is one.
    pub fn from_view(view: &View) -> Option<Next> {
        let next = view.next.as_ref();
        next.map(|(at, behaviour)| Next {
            at: at.as_second(),
            behaviour: behaviour.clone(),
        })
    }

    /// The time.
    pub fn time(&self) -> Timestamp {
        Timestamp::from_second(self.at).unwrap_or(Timestamp::MAX)
    }
}

/// A behaviour of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BehaviourListing {
    /// The behaviour's name.
    pub name: String,
    /// Its priority when several behaviours want to drive.
    pub priority: Priority,
    /// `idle`, `loading`, `running` or `ending`.
    pub state: String,
    /// How long it has been running.
    pub running: Option<Duration>,
    /// How it last ended in this run.
    pub exit: Option<(EndReason, String)>,
}

impl BehaviourListing {
    pub(super) fn new(behaviour_status: &BehaviourStatus) -> BehaviourListing {
        let (state, running) = match behaviour_status.state {
            BehaviourState::Idle => ("idle", None),
            BehaviourState::Loading => ("loading", None),
            BehaviourState::Running { since, .. } => ("running", Some(since.elapsed())),
            BehaviourState::Ending => ("ending", None),
        };
        let exit = behaviour_status.exit.as_ref().map(|exit| {
            let words = exit.message.as_deref();
            let words = words.unwrap_or(exit.reason.sentence());
            (exit.reason, words.to_owned())
        });
        BehaviourListing {
            name: behaviour_status.name.clone(),
            priority: behaviour_status.priority,
            state: state.to_owned(),
            running,
            exit,
        }
    }
}
