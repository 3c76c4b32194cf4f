//! Plain tables that calls and events give.

use super::choices::SAFETY_ACTION;
use super::make::{boolean, choice, number, table, text, value, whole};
use super::terms::{Object, Type};

pub(super) const BATTERY: Object = table(
    "Battery",
    "The battery's state.",
    &[
        whole("percent", "its level").unit("%"),
        boolean("charging", ""),
        number("age", "since the robot said so").unit("s"),
        number(
            "minutes_left",
            "until it is empty, if it goes on as of late; nil until known, and while it charges",
        )
        .unit("min")
        .optional(),
    ],
);

pub(super) const POSE_ESTIMATE: Object = table(
    "PoseEstimate",
    "Where the robot is, by what its tracks did and its camera saw.",
    &[
        number("x", "ahead of where it began").unit("m"),
        number("y", "to the left of it").unit("m"),
        number(
            "heading",
            "turned to the left since; more than a full turn counts on",
        )
        .unit("rad"),
        number("error", "how far the place may be off").unit("m"),
        number(
            "heading_error",
            "how far the heading may be off, at most pi",
        )
        .unit("rad"),
    ],
);

pub(super) const INFO: Object = table(
    "Info",
    "Which robot it is.",
    &[
        text("uid", "its serial number"),
        text("name", ""),
        text("firmware", "its version"),
        text("address", ""),
        boolean("simulated", ""),
    ],
);

pub(super) const DOCK_INFO: Object = table(
    "DockInfo",
    "How docking went.",
    &[
        whole("attempts", "how many tries it took"),
        number("seconds", "how long").unit("s"),
    ],
);

pub(super) const USAGE: Object = table(
    "Usage",
    "What a script has used.",
    &[
        number("cpu_ms", "time spent running").unit("ms"),
        whole("memory_bytes", "").unit("bytes"),
        number("worst_callback_ms", "the longest time without waiting").unit("ms"),
    ],
);

pub(super) const AUDIO: Object = table(
    "Audio",
    "A chunk of sound from the microphone.",
    &[
        whole("rate", "samples a second: 16000").unit("Hz"),
        number("rms", "its loudness, 0 to 1"),
        number("peak", "its loudest sample, 0 to 1"),
        number("dbfs", "its loudness").unit("dBFS"),
        value("samples", Type::Buffer, "signed 16-bit numbers"),
    ],
);

pub(super) const NOISE: Object = table(
    "Noise",
    "A sound above the set level.",
    &[
        number("dbfs", "its loudness").unit("dBFS"),
        boolean(
            "own",
            "it may be the robot itself, which moves or makes a sound, or did just now",
        ),
    ],
);

pub(super) const CONNECTED: Object = table("Connected", "A link was made.", &[text("address", "")]);

pub(super) const DISCONNECTED: Object =
    table("Disconnected", "A link was lost.", &[text("reason", "")]);

pub(super) const CHARGING: Object =
    table("Charging", "Charging began or ended.", &[boolean("on", "")]);

pub(super) const SAFETY: Object = table(
    "Safety",
    "What the watchdog did.",
    &[choice("action", SAFETY_ACTION, ""), text("reason", "")],
);

pub(super) const LOAN: Object = table(
    "Loan",
    "The tracks of a robot with a low battery, lent for a while.",
    &[
        number(
            "seconds",
            "how long at most; a stop ends it, and so does a second without motion",
        )
        .unit("s"),
        number("power", "the most power of each track; more is scaled down").unit("%"),
        number("low_for", "since the battery has become low").unit("s"),
        value(
            "way_back",
            Type::List(&Type::Object(&PLACE)),
            "to the station, the nearest place first, as the robot came; nil unless that is known, and nothing but one search has moved it since",
        )
        .optional(),
    ],
);

pub(super) const PLACE: Object = table(
    "Place",
    "A place on a robot's way back, seen from where it stood when its battery became low. By what its tracks were told, so the farther the less exact.",
    &[
        number("x", "ahead of it, as it looked then").unit("m"),
        number("y", "to its left").unit("m"),
    ],
);

pub(super) const ENGINE: Object = table(
    "Engine",
    "An engine code that is not documented.",
    &[whole("code", "")],
);
