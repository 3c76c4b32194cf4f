//! What a run may be asked for, and what it answers.

use std::time::Duration;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::agent::{Member, MemberState};
use crate::robot::channel::Aboard;
use crate::robot::{Battery, DockEnd, DockPlan, EndReason, Percent, Priority, RobotInfo};
use crate::timetable::View;
use crate::wire::{Led, Sound};

/// The most speech in one errand: half a minute, s16, mono, 16 kHz.
pub const MAX_SPEECH: usize = 30 * 32_000;

/// One thing that a person wants of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Errand {
    /// How things stand.
    Overview,
    /// Drive to the station.
    Dock(DockPlan),
    /// Leave the station, and wait so long for the robot's word.
    Undock(Duration),
    /// Stop the robot, and end the run.
    Stop,
    /// Switch a light.
    Led {
        /// Which.
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
    /// A picture that the camera takes from now on, waited for as long as this.
    Picture(Duration),
    /// Which behaviours there are, and how it is with each.
    Behaviours,
    /// Start or end a behaviour.
    Behaviour {
        /// Which.
        name: String,
        /// What is to become of it.
        change: Change,
    },
}

impl Errand {
    /// For the log.
    pub(super) fn words(&self) -> String {
        match self {
            Errand::Overview => "how things stand".to_owned(),
            Errand::Dock(_) => "dock".to_owned(),
            Errand::Undock(_) => "undock".to_owned(),
            Errand::Stop => "stop; the run ends".to_owned(),
            Errand::Led { led, on: true } => format!("light {} on", led.name()),
            Errand::Led { led, on: false } => format!("light {} off", led.name()),
            Errand::Play(sound) => format!("play {}", sound.name()),
            Errand::StopSound => "stop the music".to_owned(),
            Errand::Volume(percent) => format!("volume {percent}"),
            Errand::Say(_) => "talk".to_owned(),
            Errand::Picture(_) => "a picture".to_owned(),
            Errand::Behaviours => "which behaviours there are".to_owned(),
            Errand::Behaviour { name, change } => format!("{} behaviour {name:?}", change.verb()),
        }
    }
}

/// What is to become of a behaviour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Change {
    /// It begins.
    Start,
    /// It begins, and is ended after it has run for so long.
    StartFor(Duration),
    /// It ends.
    Stop,
    /// It ends if it runs, and begins anew from its file.
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

/// What becomes of an [`Errand`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Answer {
    /// How things stand.
    Overview(Box<Overview>),
    /// How a docking ended.
    Docked {
        /// How.
        end: DockEnd,
        /// Tries made.
        attempts: u32,
        /// Time taken.
        took: Duration,
    },
    /// How an undocking ended.
    Undocked(DockEnd),
    /// The pilot has been asked.
    Done,
    /// A JPEG.
    Picture(Vec<u8>),
    /// No picture came in time.
    NoPicture,
    /// All behaviours that are known or run.
    Behaviours(Vec<Listed>),
    /// The robot is out of reach just now; the run is connecting anew.
    Offline,
    /// It is not done, for this reason.
    Refused(String),
}

/// How things stand with a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Overview {
    /// Of the run's process.
    pub pid: u32,
    /// The robot as the run was told to reach it.
    pub target: String,
    /// In the run's own program.
    pub simulated: bool,
    /// How long it has been running.
    pub running: Duration,
    /// The link is up.
    pub online: bool,
    /// What the robot has said of itself, if it was ever there.
    pub robot: Option<RobotInfo>,
    /// What the watchdog is at, in words.
    pub state: String,
    /// Where the robot is, in words.
    pub place: String,
    /// On its station, as far as is known.
    pub docked: bool,
    /// The watchdog has the robot: its battery is low.
    pub low: bool,
    /// The battery, as far as it is believed.
    pub battery: Option<Battery>,
    /// The behaviours that run now.
    pub behaviours: Vec<Aboard>,
    /// The next start of the timetable, if there is one.
    pub next: Option<Next>,
    /// It is a quiet hour.
    pub quiet: bool,
}

/// A start of the timetable.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Next {
    /// When; seconds since 1970.
    pub at: i64,
    /// The behaviour.
    pub behaviour: String,
}

impl Next {
    /// What a service will do next.
    pub fn of(view: &View) -> Option<Next> {
        let next = view.next.as_ref();
        next.map(|(at, behaviour)| Next {
            at: at.as_second(),
            behaviour: behaviour.clone(),
        })
    }

    /// When.
    pub fn time(&self) -> Timestamp {
        Timestamp::from_second(self.at).unwrap_or(Timestamp::MAX)
    }
}

/// A behaviour of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Listed {
    /// What it is called.
    pub name: String,
    /// Who wins when several want to drive.
    pub priority: Priority,
    /// `idle`, `loading`, `running` or `ending`.
    pub state: String,
    /// How long it has been running.
    pub running: Option<Duration>,
    /// How it ended for the last time in this run.
    pub ending: Option<(EndReason, String)>,
}

impl Listed {
    /// How it is with a behaviour of a run.
    pub(super) fn of(member: &Member) -> Listed {
        let (state, running) = match member.state {
            MemberState::Idle => ("idle", None),
            MemberState::Loading => ("loading", None),
            MemberState::Running { since, .. } => ("running", Some(since.elapsed())),
            MemberState::Ending => ("ending", None),
        };
        let ending = member.ending.as_ref().map(|ending| {
            let words = ending.message.as_deref();
            let words = words.unwrap_or(ending.reason.sentence());
            (ending.reason, words.to_owned())
        });
        Listed {
            name: member.name.clone(),
            priority: member.priority,
            state: state.to_owned(),
            running,
            ending,
        }
    }
}
