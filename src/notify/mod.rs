//! Notifications for people who are elsewhere. A task for each target takes messages from a
//! bounded queue on the disk and retries with growing pauses, so no target delays another. A
//! target's secrets appear in no log, no error and no queue.

mod command;
mod notifier;
mod options;
mod queue;
mod rules;
mod sender;
mod template;
mod webhook;

use std::path::PathBuf;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};

use crate::clock::Zone;
use crate::robot::named;

pub use command::PROGRAM_VARIABLES;
pub use notifier::Notifier;
pub use options::{Options, PictureMode, Target};
pub use sender::{BrokerPublisher, DELIVERY_TIMEOUT, deliver};
pub use webhook::request;

named! {
    /// The events that people can be notified of.
    #[schemars(rename = "NotifyRule")]
    Rule {
        /// The watchdog sounds its alarm.
        Alarm = "alarm",
        /// The battery became low.
        Low = "low",
        /// A docking failed.
        NotDocked = "not_docked",
        /// A behaviour failed, or was given up.
        RunFailed = "run_failed",
        /// A script added an entry `moved` or `noise` to the journal.
        Moved = "moved",
        /// The robot is out of reach for long; also when it is back.
        Unreachable = "unreachable",
        /// A start of the timetable did not happen.
        StartMissed = "start_missed",
        /// A script called `notify.send`.
        Script = "script",
        /// `spykee config test-notify`; every target receives it.
        Test = "test",
    }
}

impl Rule {
    /// What happened, in plain words: the title of a message.
    pub fn title(self) -> &'static str {
        match self {
            Rule::Alarm => "Alarm",
            Rule::Low => "The battery is low",
            Rule::NotDocked => "Not on its station",
            Rule::RunFailed => "A behaviour has failed",
            Rule::Moved => "Something moved",
            Rule::Unreachable => "The connection",
            Rule::StartMissed => "Did not start",
            Rule::Script => "A message",
            Rule::Test => "A test",
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Notice {
    pub rule: Rule,
    pub text: String,
    /// The robot's name or uid; `spykee` while none is known.
    pub robot: String,
    /// When it happened, in milliseconds since the epoch.
    pub at: i64,
    /// The same in the owner's time, for people.
    #[serde(default)]
    pub time: String,
    /// A JPEG in the data folder of the behaviour that saved it.
    pub picture: Option<PathBuf>,
}

impl Notice {
    /// The same notice of something that happened then, told in the time of this zone.
    pub fn at(self, at: Timestamp, zone: &Zone) -> Notice {
        Notice {
            at: at.as_millisecond(),
            time: zone.time(at).strftime("%Y-%m-%d %H:%M:%S %:z").to_string(),
            ..self
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Delivery {
    Done,
    /// It was not delivered, and a retry may succeed; the reason in words.
    Later(String),
    /// It was not delivered, and a retry cannot succeed; the reason in words.
    Refused(String),
}
