//! The events that scripts can listen to, the tables that they carry, and the sets of names that
//! arguments and results are taken from.

use super::model::{
    Choice, Event, Object, Type, boolean, choice, number, table, text, value, whole,
};
use super::vision::FRAME;
use crate::robot::{DockEnd, MotionEnd, SafetyAction};
use crate::vision::Colour;
use crate::wire::{Sound, Stream};

/// Declares the events. Each line has the runtime's name of an event and its row of the API table.
macro_rules! events {
    ($($variant:ident: $name:literal, $payload:expr, $doc:literal;)+) => {
        /// An event that a script can listen to.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub enum EventName {
            $(#[doc = $doc] $variant,)+
        }

        impl EventName {
            pub const ALL: &'static [EventName] = &[$(EventName::$variant,)+];

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

pub(super) const BATTERY: Object = table("Battery")
    .doc("The battery's state.")
    .fields(&[
        whole(
            "percent",
            "its level; nil if it is not known, as may happen while it charges",
        )
        .unit("%")
        .optional(),
        boolean("charging", ""),
        number("age", "time since the robot reported it").unit("s"),
        number(
            "minutes_left",
            "estimated time until it is empty, at the recent consumption; nil until known, and while it charges",
        )
        .unit("min")
        .optional(),
    ]);

pub(super) const POSE_ESTIMATE: Object = table("PoseEstimate")
    .doc("The robot's estimated pose, from its tracks and its camera.")
    .fields(&[
        number("x", "ahead of the origin").unit("m"),
        number("y", "to the left of the origin").unit("m"),
        number(
            "heading",
            "how far the robot has turned to the left from the x axis; not limited to a full turn",
        )
        .unit("rad"),
        number("error", "the estimated error of the position").unit("m"),
        number(
            "heading_error",
            "the estimated error of the heading, at most pi",
        )
        .unit("rad"),
    ]);

pub(super) const INFO: Object = table("Info").doc("The identity of a robot.").fields(&[
    text("uid", "its serial number"),
    text("name", ""),
    text("firmware", "its version"),
    text("address", ""),
    boolean("simulated", ""),
]);

pub(super) const DOCK_INFO: Object = table("DockInfo").doc("Details of a docking.").fields(&[
    whole("attempts", "number of tries"),
    number("seconds", "duration").unit("s"),
]);

pub(super) const USAGE: Object = table("Usage")
    .doc("The resources that a script has used.")
    .fields(&[
        number("cpu_ms", "CPU time").unit("ms"),
        whole("memory_bytes", "").unit("bytes"),
        number("worst_callback_ms", "the longest run without waiting").unit("ms"),
    ]);

pub(super) const AUDIO: Object = table("Audio")
    .doc("A chunk of sound from the microphone.")
    .fields(&[
        whole("rate", "samples per second: 16000").unit("Hz"),
        number("rms", "its loudness, 0 to 1"),
        number("peak", "its loudest sample, 0 to 1"),
        number("dbfs", "its loudness").unit("dBFS"),
        value("samples", Type::Buffer, "signed 16-bit numbers"),
    ]);

pub(super) const NOISE: Object = table("Noise")
    .doc("A sound above the configured level.")
    .fields(&[
        number("dbfs", "its loudness").unit("dBFS"),
        boolean(
            "own",
            "whether the robot itself may be the source: it moves or makes a sound, or did just before",
        ),
    ]);

pub(super) const CONNECTED: Object = table("Connected")
    .doc("The robot was connected.")
    .fields(&[text("address", "")]);

pub(super) const DISCONNECTED: Object = table("Disconnected")
    .doc("The connection was lost.")
    .fields(&[text("reason", "")]);

pub(super) const CHARGING: Object = table("Charging")
    .doc("Charging began or ended.")
    .fields(&[boolean("on", "")]);

pub(super) const SAFETY: Object = table("Safety")
    .doc("An action of the watchdog.")
    .fields(&[choice("action", SAFETY_ACTION, ""), text("reason", "")]);

pub(super) const DRIVE_GRANT: Object = table("DriveGrant")
    .doc("Permission to drive a robot with a low battery, for a limited time.")
    .fields(&[
        number(
            "seconds",
            "the longest duration; a stop or a second without motion ends the grant earlier",
        )
        .unit("s"),
        number(
            "power",
            "the limit of each track's power; higher power is scaled down",
        )
        .unit("%"),
    ]);

pub(super) const ENGINE: Object = table("Engine")
    .doc("An engine code that is not documented.")
    .fields(&[whole("code", "")]);

pub(super) const LIGHT: &Choice = &Choice {
    name: "Light",
    what: "light",
    names: || vec!["flash", "left", "right", "all"],
};

pub(super) const SOUND: &Choice = &Choice {
    name: "Sound",
    what: "sound",
    names: || Sound::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const STREAM: &Choice = &Choice {
    name: "Stream",
    what: "stream",
    names: || Stream::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const QUEUE: &Choice = &Choice {
    name: "Queue",
    what: "queue",
    names: || vec!["latest", "all"],
};

pub(super) const COLOUR_NAME: &Choice = &Choice {
    name: "ColourName",
    what: "colour",
    names: || Colour::NAMES.to_vec(),
};

pub(super) const MOTION_CODE: &Choice = &Choice {
    name: "MotionCode",
    what: "code",
    names: || MotionEnd::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const DOCK_CODE: &Choice = &Choice {
    name: "DockCode",
    what: "code",
    names: || DockEnd::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const SAFETY_ACTION: &Choice = &Choice {
    name: "SafetyAction",
    what: "action",
    names: || SafetyAction::ALL.iter().map(|one| one.name()).collect(),
};

pub(super) const TASK_STATUS: &Choice = &Choice {
    name: "TaskStatus",
    what: "status",
    names: || vec!["running", "done", "failed", "cancelled"],
};
