//! The journal's rows: how an event is stored.

use serde_json::{Value, json};

use crate::robot::{AgentEvent, Battery};

/// Maximum length of an event as JSON, in bytes; an entry of a script is shorter.
const LONGEST: usize = 16 * 1024;

/// A row of the journal, its time in milliseconds of the epoch.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    pub(super) at: i64,
    /// The uid of the connected robot.
    pub(super) robot: Option<String>,
    pub(super) content: Content,
}

/// The content of a row; the variant determines the table.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Content {
    Battery {
        percent: u8,
        charging: bool,
    },
    Event {
        kind: &'static str,
        behaviour: Option<String>,
        data: String,
    },
}

impl Content {
    pub(super) fn of_battery(battery: &Battery) -> Content {
        Content::Battery {
            percent: battery.percent.get(),
            charging: battery.charging,
        }
    }

    pub(super) fn from_occurrence(what: &AgentEvent) -> Content {
        if let AgentEvent::Battery(battery) = what {
            return Content::of_battery(battery);
        }
        let kind = what.kind();
        // Serialisation cannot fail: all keys of an event are strings.
        let data =
            serde_json::to_string(what).unwrap_or_else(|_| json!({ "event": kind }).to_string());
        let data = if data.len() > LONGEST {
            json!({ "event": kind, "too_long": data.len() }).to_string()
        } else {
            data
        };
        Content::Event {
            kind,
            behaviour: behaviour(what).map(str::to_owned),
            data,
        }
    }

    /// Creates the record of this many lost events.
    pub(super) fn of_lost(count: u64) -> Content {
        let data: Value = json!({ "event": "lost", "count": count });
        Content::Event {
            kind: "lost",
            behaviour: None,
            data: data.to_string(),
        }
    }
}

fn behaviour(what: &AgentEvent) -> Option<&str> {
    use AgentEvent::{Dock, Ended, Entry, GivenUp, Notify, Picture, StartMissed, Started, Undock};
    match what {
        Dock { by, .. } => by.as_deref(),
        Undock { by, .. } => Some(by),
        Started { behaviour }
        | Ended { behaviour, .. }
        | GivenUp { behaviour, .. }
        | StartMissed { behaviour, .. }
        | Picture { behaviour, .. }
        | Entry { behaviour, .. }
        | Notify { behaviour, .. } => Some(behaviour),
        _ => None,
    }
}
