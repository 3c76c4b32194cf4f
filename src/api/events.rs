//! What scripts can listen to.

use super::frame::FRAME;
use super::tables::{
    AUDIO, BATTERY, CHARGING, CONNECTED, DISCONNECTED, ENGINE, LOAN, NOISE, SAFETY,
};
use super::terms::{Choice, Event};
use crate::wire::Stream;

/// Declares the events: the runtime's name, the row.
macro_rules! events {
    ($($variant:ident: $name:literal, $payload:expr, $doc:literal;)+) => {
        /// An event that a script can listen to.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum EventName {
            $(#[doc = $doc] $variant,)+
        }

        impl EventName {
            /// All of them.
            pub const ALL: &'static [EventName] = &[$(EventName::$variant,)+];

            /// As scripts write it.
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
    BatteryOk: "battery_ok", Some(&BATTERY), "The watchdog releases a robot that was low: it charges, or its battery is full enough.";
    Charging: "charging", Some(&CHARGING), "Charging began or ended.";
    Charged: "charged", None, "The battery is full.";
    Docked: "docked", None, "The robot is on its charging station.";
    Undocked: "undocked", None, "The robot has left its charging station.";
    BaseNotFound: "base_not_found", None, "The robot has not found its charging station.";
    Frame: "frame", Some(&FRAME), "The camera has sent a picture; only the latest is kept.";
    Audio: "audio", Some(&AUDIO), "The microphone has sent a chunk of sound; only the latest is kept.";
    Noise: "noise", Some(&NOISE), "A sound exceeds the configured level, after a second without one.";
    SoundFinished: "sound_finished", None, "The robot has finished playing music.";
    Safety: "safety", Some(&SAFETY), "The watchdog has acted.";
    Loan: "loan", Some(&LOAN), "The watchdog lends this behaviour the tracks of a robot with a low battery. Only the rescue behaviour of the config receives it.";
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

    /// What must be on for it to come.
    pub fn stream(self) -> Option<Stream> {
        match self {
            EventName::Frame => Some(Stream::Video),
            EventName::Audio | EventName::Noise => Some(Stream::AudioIn),
            _ => None,
        }
    }
}
