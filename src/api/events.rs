//! The events that scripts can listen to.

use super::frame::FRAME;
use super::model::{Choice, Event};
use super::tables::{
    AUDIO, BATTERY, CHARGING, CONNECTED, DISCONNECTED, DRIVE_GRANT, ENGINE, NOISE, SAFETY,
};
use crate::wire::Stream;

/// Declares the events. Each line has the runtime's name of an event and its row of the API table.
macro_rules! events {
    ($($variant:ident: $name:literal, $payload:expr, $doc:literal;)+) => {
        /// An event that a script can listen to.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum EventName {
            $(#[doc = $doc] $variant,)+
        }

        impl EventName {
            /// All events.
            pub const ALL: &'static [EventName] = &[$(EventName::$variant,)+];

            /// The event's name in scripts.
            pub fn name(self) -> &'static str {
                match self { $(EventName::$variant => $name,)+ }
            }
        }

        pub(super) const EVENTS: &[Event] = &[
            $(Event { name: $name, payload: $payload, doc: $doc },)+
        ];
    };
}

events! {
    Connected: "connected", Some(&CONNECTED), "The robot is connected.";
    Disconnected: "disconnected", Some(&DISCONNECTED), "The connection to the robot is lost.";
    Battery: "battery", Some(&BATTERY), "The battery's level or charging changed.";
    BatteryLow: "battery_low", Some(&BATTERY), "The battery is low, and the watchdog takes the robot home.";
    BatteryOk: "battery_ok", Some(&BATTERY), "The watchdog gives control back to the scripts after a low battery: the robot charges, or its battery is full enough.";
    Charging: "charging", Some(&CHARGING), "Charging began or ended.";
    Charged: "charged", None, "The battery is full.";
    Docked: "docked", None, "The robot is on its charging station.";
    Undocked: "undocked", None, "The robot has left its charging station.";
    BaseNotFound: "base_not_found", None, "The robot has not found its charging station.";
    Frame: "frame", Some(&FRAME), "The camera has sent a picture; only the latest is kept.";
    Audio: "audio", Some(&AUDIO), "The microphone has sent a chunk of sound; only the latest is kept.";
    Noise: "noise", Some(&NOISE), "A sound exceeds the configured level, after at least a second without such a sound.";
    SoundFinished: "sound_finished", None, "The robot has finished playing music.";
    Safety: "safety", Some(&SAFETY), "The watchdog has acted.";
    DriveGrant: "drive_grant", Some(&DRIVE_GRANT), "The watchdog grants this behaviour the tracks of a robot with a low battery. Only the rescue behaviour receives this event.";
    Engine: "engine", Some(&ENGINE), "The robot has sent an engine code that is not documented.";
}

pub(super) const EVENT: &Choice = &Choice {
    name: "EventName",
    what: "event",
    names: || EVENTS.iter().map(|event| event.name).collect(),
};

impl EventName {
    /// The event of this name.
    pub fn from_name(name: &str) -> Option<EventName> {
        let mut all = EventName::ALL.iter().copied();
        all.find(|event| event.name() == name)
    }

    /// The stream that must be on for this event to occur; `None` if it needs none.
    pub fn stream(self) -> Option<Stream> {
        match self {
            EventName::Frame => Some(Stream::Video),
            EventName::Audio | EventName::Noise => Some(Stream::AudioIn),
            _ => None,
        }
    }
}
