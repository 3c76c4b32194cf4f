//! The plain tables that calls return and that events carry.

use super::choices::SAFETY_ACTION;
use super::make::{boolean, choice, number, table, text, value, whole};
use super::model::{Object, Type};

pub(super) const BATTERY: Object = table(
    "Battery",
    "The battery's state.",
    &[
        whole("percent", "its level").unit("%"),
        boolean("charging", ""),
        number("age", "time since the robot reported it").unit("s"),
        number(
            "minutes_left",
            "estimated time until it is empty, at the recent consumption; nil until known, and while it charges",
        )
        .unit("min")
        .optional(),
    ],
);

pub(super) const POSE_ESTIMATE: Object = table(
    "PoseEstimate",
    "The robot's estimated pose, from its tracks and its camera.",
    &[
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
    ],
);

pub(super) const INFO: Object = table(
    "Info",
    "The identity of a robot.",
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
    "Details of a docking.",
    &[
        whole("attempts", "number of tries"),
        number("seconds", "duration").unit("s"),
    ],
);

pub(super) const USAGE: Object = table(
    "Usage",
    "The resources that a script has used.",
    &[
        number("cpu_ms", "CPU time").unit("ms"),
        whole("memory_bytes", "").unit("bytes"),
        number("worst_callback_ms", "the longest run without waiting").unit("ms"),
    ],
);

pub(super) const AUDIO: Object = table(
    "Audio",
    "A chunk of sound from the microphone.",
    &[
        whole("rate", "samples per second: 16000").unit("Hz"),
        number("rms", "its loudness, 0 to 1"),
        number("peak", "its loudest sample, 0 to 1"),
        number("dbfs", "its loudness").unit("dBFS"),
        value("samples", Type::Buffer, "signed 16-bit numbers"),
    ],
);

pub(super) const NOISE: Object = table(
    "Noise",
    "A sound above the configured level.",
    &[
        number("dbfs", "its loudness").unit("dBFS"),
        boolean(
            "own",
            "whether the robot itself may be the source: it moves or makes a sound, or did just before",
        ),
    ],
);

pub(super) const CONNECTED: Object = table(
    "Connected",
    "The robot was connected.",
    &[text("address", "")],
);

pub(super) const DISCONNECTED: Object = table(
    "Disconnected",
    "The connection was lost.",
    &[text("reason", "")],
);

pub(super) const CHARGING: Object =
    table("Charging", "Charging began or ended.", &[boolean("on", "")]);

pub(super) const SAFETY: Object = table(
    "Safety",
    "An action of the watchdog.",
    &[choice("action", SAFETY_ACTION, ""), text("reason", "")],
);

pub(super) const DRIVE_GRANT: Object = table(
    "DriveGrant",
    "Permission to drive a robot with a low battery, for a limited time.",
    &[
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
    ],
);

pub(super) const ENGINE: Object = table(
    "Engine",
    "An engine code that is not documented.",
    &[whole("code", "")],
);
