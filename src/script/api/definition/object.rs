//! What calls give and take: objects with methods, and plain tables.

use super::super::super::arguments::SECONDS;
use super::super::looking::PIXELS;
use super::terms::{
    Choice, Function, Object, SAFETY_ACTION, TASK_STATUS, Type, Value, boolean, bounded, call,
    choice, number, object, text, value, whole,
};
use super::vision::{BLOB_OPTIONS, LINE_OPTIONS, PICTURE_NAME};

const ROI: Value = value("roi", Type::Roi, "only here").optional();
const FRAME: Value = object("frame", "Frame", "");
const COLOURS: Value = value("colour", Type::Colours, "which");
const STATUS: &Choice = TASK_STATUS;

pub(super) const METHODS: &[Function] = &[
    call(
        "Frame:find_blobs",
        &[COLOURS, BLOB_OPTIONS],
        &[value(
            "blobs",
            Type::List(&Type::Object("Blob")),
            "the largest first; empty if there are none",
        )],
        "Finds patches of a colour, as OpenMV does.",
        "local ball = frame:find_blobs(\"red\", { pixels_threshold = 25 })[1]\nif ball then\n\tprint(ball.cx, ball.bearing)\nend",
    ),
    call(
        "Frame:find_line",
        &[COLOURS, LINE_OPTIONS],
        &[object("line", "Line", "nil if there is none").optional()],
        "Finds a line on the floor, to follow it.",
        "local line = frame:find_line(\"black\")\nif line then\n\trobot.drive(0.1, -line.offset)\nend",
    ),
    call(
        "Frame:find_qrcodes",
        &[],
        &[value("codes", Type::List(&Type::Object("QrCode")), "")],
        "Reads QR codes.",
        "for _, code in frame:find_qrcodes() do\n\tprint(code.text)\nend",
    ),
    call(
        "Frame:brightness",
        &[ROI],
        &[number("brightness", "0 is black, 1 is white")],
        "How bright the picture is.",
        "if frame:brightness() < 0.1 then\n\trobot.led(\"flash\", true)\nend",
    ),
    call(
        "Frame:sharpness",
        &[ROI],
        &[number("sharpness", "0 or more; more is sharper")],
        "How sharp the picture is, for comparing pictures of one place.",
        "print(frame:sharpness())",
    ),
    call(
        "Frame:get_pixel",
        &[
            bounded("x", PIXELS, "column, 0 is the left").unit("px"),
            bounded("y", PIXELS, "row, 0 is the top").unit("px"),
        ],
        &[
            whole("r", "red, 0 to 255; nil outside the picture").optional(),
            whole("g", "green").optional(),
            whole("b", "blue").optional(),
        ],
        "The colour of one pixel.",
        "local r, g, b = frame:get_pixel(160, 120)\nprint(r, g, b)",
    ),
    call(
        "Frame:save",
        &[PICTURE_NAME],
        &[
            text("path", "nil if it was not saved").optional(),
            text("why", "\"quota\" or \"io\"").optional(),
        ],
        "Saves the picture as it came from the camera. The oldest pictures make room when the folder is full; \"quota\" means that the bytes of the day are used up, or the disk is.",
        "local path, why = frame:save(\"ball.jpg\")\nprint(path or why)",
    ),
    call(
        "Task:cancel",
        &[],
        &[],
        "Ends the task; its motion stops with it.",
        "local beat = task.every(1, print)\nbeat:cancel()",
    ),
    call(
        "Task:join",
        &[bounded("timeout", SECONDS, "waits for ever without it")
            .unit("s")
            .optional()],
        &[
            boolean("ok", "whether the task is done"),
            text("status", "as `.status`, or \"timeout\""),
            text("message", "of a task that failed").optional(),
        ],
        "Waits until the task has ended.",
        "robot.blink(\"left\"):join()",
    )
    .waiting(),
    call(
        "Subscription:off",
        &[],
        &[],
        "Ends the subscription: its function is not called again.",
        "local listening = robot.on(\"noise\", print)\nlistening:off()",
    ),
    call(
        "Tracker:update",
        &[FRAME],
        &[value("tracks", Type::List(&Type::Object("Track")), "")],
        "Looks at the next frame.",
        "local balls = vision.tracker({ colour = \"red\" })\nfor _, ball in balls:update(frame) do\n\tprint(ball.id, ball.cx)\nend",
    ),
    call(
        "Tracker:best",
        &[],
        &[object("track", "Track", "nil while there is none").optional()],
        "The one to follow: seen for long enough, and the largest.",
        "local balls = vision.tracker({ colour = \"red\" })\nballs:update(frame)\nlocal ball = balls:best()\nprint(ball and ball.cx)",
    ),
    call(
        "Tracker:reset",
        &[],
        &[],
        "Forgets all that was seen.",
        "local balls = vision.tracker({ colour = \"red\" })\nballs:reset()",
    ),
    call(
        "Detector:update",
        &[FRAME],
        &[
            object(
                "motion",
                "Motion",
                "nil while anything moves the robot, and for a second after",
            )
            .optional(),
            text("why", "\"moving\"").optional(),
        ],
        "Compares the frame with the ones before.",
        "local watch = vision.motion()\nlocal motion = watch:update(frame)\nprint(motion and motion.score)",
    ),
];

const BOX: [Value; 4] = [
    whole("x", "left column of its box").unit("px"),
    whole("y", "top row of its box").unit("px"),
    whole("w", "columns of its box").unit("px"),
    whole("h", "rows of its box").unit("px"),
];

const BLOB: [Value; 18] = [
    BOX[0],
    BOX[1],
    BOX[2],
    BOX[3],
    number("cx", "column of its centroid").unit("px"),
    number("cy", "row of its centroid").unit("px"),
    whole("pixels", "how many pixels have the colour").unit("px"),
    whole("area", "pixels of its box").unit("px"),
    number("density", "`pixels / area`, 0 to 1"),
    number("rotation", "of its long axis; 0 lies flat").unit("rad"),
    number("elongation", "0 for a disc, towards 1 for a line"),
    number("roundness", "1 for a disc, 0 for a line"),
    whole("perimeter", "its border pixels").unit("px"),
    whole("code", "one bit for each colour of the list"),
    whole("count", "how many blobs were merged into it"),
    text(
        "colour",
        "the first of the names that matches; nil for a colour without a name",
    )
    .optional(),
    number("bearing", "direction of its centroid, left positive").unit("rad"),
    boolean("edge", "it touches the border of the picture"),
];

const TRACK: [Value; 23] = {
    let own = [
        whole("id", "stays the same while it is followed"),
        whole("age", "frames since it was first seen"),
        whole("lost", "frames since it was last seen; 0 while in sight"),
        number("vx", "to the right").unit("px/s"),
        number("vy", "downwards").unit("px/s"),
    ];
    let mut all = [own[0]; 23];
    let mut at = 0;
    while at < 23 {
        all[at] = if at < 18 { BLOB[at] } else { own[at - 18] };
        at += 1;
    }
    all
};

const fn table(name: &'static str, doc: &'static str, fields: &'static [Value]) -> Object {
    Object {
        name,
        doc,
        fields,
        strict: false,
    }
}

const fn strict(name: &'static str, doc: &'static str, fields: &'static [Value]) -> Object {
    Object {
        strict: true,
        ..table(name, doc, fields)
    }
}

pub(super) const OBJECTS: &[Object] = &[
    strict(
        "Frame",
        "A picture of the camera; decoded when it is first looked at.",
        &[
            whole("seq", "its number"),
            number("age", "since it came").unit("s"),
            whole("width", "").unit("px"),
            whole("height", "").unit("px"),
            whole("bytes", "of the picture as it came"),
        ],
    ),
    table("Blob", "A patch of a colour in a frame.", &BLOB),
    table(
        "Track",
        "A Blob that is followed from frame to frame.",
        &TRACK,
    ),
    strict("Tracker", "Follows blobs; made by `vision.tracker`.", &[]),
    strict("Detector", "Notices motion; made by `vision.motion`.", &[]),
    strict(
        "Colour",
        "A colour without a name; made by `vision.lab`, `vision.hsv` and `vision.learn`.",
        &[],
    ),
    strict(
        "Task",
        "A function that runs beside others.",
        &[
            choice("status", STATUS, "how it is"),
            whole("missed", "beats of `task.every` that were missed"),
        ],
    ),
    strict(
        "Subscription",
        "What `robot.on` and `robot.once` give.",
        &[],
    ),
    table(
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
    ),
    table(
        "Info",
        "Which robot it is.",
        &[
            text("uid", "its serial number"),
            text("name", ""),
            text("firmware", "its version"),
            text("address", ""),
            boolean("simulated", ""),
        ],
    ),
    table(
        "DockInfo",
        "How docking went.",
        &[
            whole("attempts", "how many tries it took"),
            number("seconds", "how long").unit("s"),
        ],
    ),
    table(
        "Usage",
        "What a script has used.",
        &[
            number("cpu_ms", "time spent running").unit("ms"),
            whole("memory_bytes", "").unit("bytes"),
            number("worst_callback_ms", "the longest time without waiting").unit("ms"),
        ],
    ),
    table(
        "Line",
        "A line on the floor.",
        &[
            number("offset", "-1 is the left border, 1 the right one"),
            number("angle", "of the line").unit("rad"),
            number("strength", "how surely, 0 to 1"),
        ],
    ),
    table(
        "QrCode",
        "A QR code in a frame.",
        &[
            text("text", "what it says"),
            value("corners", Type::List(&Type::Object("Corner")), "four"),
        ],
    ),
    table(
        "Corner",
        "A place in a frame.",
        &[number("x", "").unit("px"), number("y", "").unit("px")],
    ),
    table(
        "Motion",
        "What has moved.",
        &[
            number("score", "the part of the picture that changed, 0 to 1"),
            whole("pixels", "how many").unit("px"),
            value("blobs", Type::List(&Type::Object("Blob")), "where"),
        ],
    ),
    table(
        "Audio",
        "A chunk of sound from the microphone.",
        &[
            whole("rate", "samples a second: 16000").unit("Hz"),
            number("rms", "its loudness, 0 to 1"),
            number("peak", "its loudest sample, 0 to 1"),
            number("dbfs", "its loudness").unit("dBFS"),
            value("samples", Type::Buffer, "signed 16-bit numbers"),
        ],
    ),
    table(
        "Noise",
        "A sound above the set level.",
        &[
            number("dbfs", "its loudness").unit("dBFS"),
            boolean(
                "own",
                "it may be the robot itself, which moves or makes a sound, or did just now",
            ),
        ],
    ),
    table("Connected", "A link was made.", &[text("address", "")]),
    table("Disconnected", "A link was lost.", &[text("reason", "")]),
    table("Charging", "Charging began or ended.", &[boolean("on", "")]),
    table(
        "Safety",
        "What the watchdog did.",
        &[choice("action", SAFETY_ACTION, ""), text("reason", "")],
    ),
    table(
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
                Type::List(&Type::Object("Place")),
                "to the station, the nearest place first, as the robot came; nil unless that is known, and nothing but one search has moved it since",
            )
            .optional(),
        ],
    ),
    table(
        "Place",
        "A place on a robot's way back, seen from where it stood when its battery became low. By what its tracks were told, so the farther the less exact.",
        &[
            number("x", "ahead of it, as it looked then").unit("m"),
            number("y", "to its left").unit("m"),
        ],
    ),
    table(
        "Engine",
        "A code of the robot's that nobody knows.",
        &[whole("code", "")],
    ),
];
