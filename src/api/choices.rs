//! The sets of names that arguments and results are taken from.

use super::model::Choice;
use crate::robot::{DockEnd, Event, MotionEnd, SafetyAction, named};
use crate::vision::Colour;
use crate::wire::{Sound, Stream};

named! {
    /// An event that a script can listen to; its row is in `objects.luau`.
    EventName {
        Connected = "connected",
        Disconnected = "disconnected",
        Battery = "battery",
        BatteryLow = "battery_low",
        BatteryOk = "battery_ok",
        Charging = "charging",
        Charged = "charged",
        Docked = "docked",
        Undocked = "undocked",
        BaseNotFound = "base_not_found",
        Frame = "frame",
        Audio = "audio",
        Noise = "noise",
        SoundFinished = "sound_finished",
        Safety = "safety",
        DriveGrant = "drive_grant",
        Engine = "engine",
    }
}

impl EventName {
    /// The stream that must be on for this event to occur; `None` if it needs none.
    pub fn stream(self) -> Option<Stream> {
        match self {
            EventName::Frame => Some(Stream::Video),
            EventName::Audio | EventName::Noise => Some(Stream::AudioIn),
            _ => None,
        }
    }

    /// The script's name of an event; `None` for events that scripts cannot subscribe to, such as
    /// the answers to waiting calls.
    pub fn from_event(event: &Event) -> Option<EventName> {
        Some(match event {
            Event::Connected { .. } => EventName::Connected,
            Event::Disconnected { .. } => EventName::Disconnected,
            Event::Battery(_) => EventName::Battery,
            Event::BatteryLow(_) => EventName::BatteryLow,
            Event::BatteryOk(_) => EventName::BatteryOk,
            Event::Charging { .. } => EventName::Charging,
            Event::Charged => EventName::Charged,
            Event::Docked => EventName::Docked,
            Event::Undocked => EventName::Undocked,
            Event::BaseNotFound => EventName::BaseNotFound,
            Event::Audio(_) => EventName::Audio,
            Event::SoundFinished => EventName::SoundFinished,
            Event::Safety { .. } => EventName::Safety,
            Event::DriveGrant { .. } => EventName::DriveGrant,
            Event::Engine { .. } => EventName::Engine,
            Event::Moving { .. }
            | Event::Sounding
            | Event::MotionWaiting { .. }
            | Event::MotionEnded { .. }
            | Event::DockEnded { .. }
            | Event::UndockEnded { .. } => {
                return None;
            }
        })
    }

    /// Whether only the newest event is kept by default: frames and sound may arrive faster than
    /// they are handled, and old ones are useless.
    pub fn keeps_latest(self) -> bool {
        matches!(self, EventName::Frame | EventName::Audio | EventName::Noise)
    }
}

pub(super) static CHOICES: [Choice; 10] = [
    choice("Light", "light", || vec!["flash", "left", "right", "all"]),
    choice("Sound", "sound", || {
        Sound::ALL.iter().map(|one| one.name()).collect()
    }),
    choice("Stream", "stream", || {
        Stream::ALL.iter().map(|one| one.name()).collect()
    }),
    choice("EventName", "event", || {
        EventName::ALL.iter().map(|one| one.name()).collect()
    }),
    choice("Queue", "queue", || vec!["latest", "all"]),
    choice("ColourName", "colour", || Colour::NAMES.to_vec()),
    choice("MotionCode", "code", || {
        MotionEnd::ALL.iter().map(|one| one.name()).collect()
    }),
    choice("DockCode", "code", || {
        DockEnd::ALL.iter().map(|one| one.name()).collect()
    }),
    choice("SafetyAction", "action", || {
        SafetyAction::ALL.iter().map(|one| one.name()).collect()
    }),
    choice("TaskStatus", "status", || {
        vec!["running", "done", "failed", "cancelled"]
    }),
];

const fn choice(
    name: &'static str,
    what: &'static str,
    names: fn() -> Vec<&'static str>,
) -> Choice {
    Choice { name, what, names }
}
