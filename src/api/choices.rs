//! The sets of names that arguments and results are taken from.

use super::model::Choice;
use crate::robot::{DockEnd, MotionEnd, SafetyAction, named};
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
